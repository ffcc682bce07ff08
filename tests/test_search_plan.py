"""When a picture is searched, and how thoroughly."""

from __future__ import annotations

import pytest
from decode_material import Canvas, square, word
from samples_material import samples_of

from ledpi.decode.cells import CellSamples
from ledpi.records import Frame
from ledpi.search_plan import SearchPlan


def shown(side: float, light: float) -> tuple[Frame, CellSamples]:
    """A frame with a lamp of level 0.4 and a square of 4 × 4 cells, and the light in it."""
    canvas = Canvas()
    canvas.lamp(square(120.0, 120.0, 60.0), 0.4)
    canvas.panel(square(400.3, 240.2, side), word(7), light=light)
    frame = canvas.frame()
    samples = samples_of(frame, square(400.3, 240.2, side))
    return frame, samples


def searched(plan: SearchPlan, frame: Frame, *, all_seen: bool, read: bool) -> str:
    """How one frame is searched: not, once, again, and within."""
    begins = plan.begins(all_seen=all_seen)
    return "s" * begins + "a" * plan.goes_on(read=read) + "w" * plan.looks_within(frame, (), read=read)


def test_while_all_panels_are_seen_every_third_frame_is_searched_for_newcomers() -> None:
    """And in every fourth of these searches also for what is only bright for its surroundings."""
    frame, _ = shown(60.0, 0.4)
    plan = SearchPlan(stream=True)
    assert [searched(plan, frame, all_seen=True, read=True) for _ in range(12)] == ["", "", "s"] * 3 + ["", "", "sa"]


def test_while_nothing_is_read_every_frame_is_searched_and_every_third_within() -> None:
    """What is within panels takes longest to be looked at."""
    frame, _ = shown(60.0, 0.4)
    plan = SearchPlan(stream=True)
    assert [searched(plan, frame, all_seen=False, read=False) for _ in range(6)] == ["sa", "sa", "saw"] * 2


@pytest.mark.parametrize(("read", "how"), [(True, "s"), (False, "saw")])
def test_frames_that_stand_alone_are_all_searched_alike(read: bool, how: str) -> None:
    """Whatever came before: how thoroughly is told by what the frame itself has shown."""
    frame, _ = shown(60.0, 0.4)
    plan = SearchPlan(stream=False)
    assert [searched(plan, frame, all_seen=False, read=read) for _ in range(8)] == [how] * 8


@pytest.mark.parametrize(("side", "light", "within"), [(20.0, 0.4, False), (20.0, 0.05, True), (60.0, 0.4, True)])
def test_a_frame_alone_that_has_shown_a_panel_far_away_is_not_looked_within(
    side: float, light: float, within: bool
) -> None:
    """Such a panel is small and bright. What is dim is texture, and what is large would have been read."""
    frame, samples = shown(side, light)
    plan = SearchPlan(stream=False)
    assert plan.begins(all_seen=False)
    assert plan.looks_within(frame, [samples], read=False) is within
