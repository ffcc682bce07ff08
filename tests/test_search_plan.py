"""When a picture is searched, and how thoroughly."""

from __future__ import annotations

from dataclasses import replace

import pytest
from decode_material import Canvas, quad, square, word
from samples_material import samples_of

from ledpi.decode.cells import CellSamples
from ledpi.records import Frame, Quad
from ledpi.search_plan import SearchPlan


def shown(side: float, light: float) -> tuple[Frame, Quad, CellSamples]:
    """A frame with a lamp of level 0.4 and a square of 4 × 4 cells; the square, and the light in it."""
    canvas = Canvas()
    canvas.lamp(square(120.0, 120.0, 60.0), 0.4)
    canvas.panel(square(400.3, 240.2, side), word(7), light=light)
    frame = canvas.frame()
    at = square(400.3, 240.2, side)
    return frame, quad(at), samples_of(frame, at)


def searched(plan: SearchPlan, frame: Frame, *, all_seen: bool, read: bool) -> str:
    """How one frame is searched: not, once, again, and within."""
    begins = plan.begins(all_seen=all_seen)
    return "s" * begins + "a" * plan.goes_on(read=read) + "w" * plan.looks_within(frame, (), read=read)


def test_while_all_panels_are_seen_every_third_frame_is_searched_for_newcomers() -> None:
    """And in every fourth of these searches also for what is only bright for its surroundings."""
    frame, *_ = shown(60.0, 0.4)
    plan = SearchPlan(stream=True)
    assert [searched(plan, frame, all_seen=True, read=True) for _ in range(12)] == ["", "", "s"] * 3 + ["", "", "sa"]


def test_while_nothing_is_read_every_frame_is_searched_and_every_third_within() -> None:
    """What is within panels takes longest to be looked at. The first frame may show what no other way would."""
    frame, *_ = shown(60.0, 0.4)
    plan = SearchPlan(stream=True)
    assert [searched(plan, frame, all_seen=False, read=False) for _ in range(6)] == ["saw", "sa", "sa"] * 2


@pytest.mark.parametrize(("read", "how"), [(True, "s"), (False, "saw")])
def test_frames_that_stand_alone_are_all_searched_alike(read: bool, how: str) -> None:
    """Whatever came before: how thoroughly is told by what the frame itself has shown."""
    frame, *_ = shown(60.0, 0.4)
    plan = SearchPlan(stream=False)
    assert [searched(plan, frame, all_seen=False, read=read) for _ in range(8)] == [how] * 8


@pytest.mark.parametrize(("side", "light", "within"), [(20.0, 0.4, False), (20.0, 0.05, True), (60.0, 0.4, True)])
def test_a_frame_alone_that_has_shown_a_panel_far_away_is_not_looked_within(
    side: float, light: float, within: bool
) -> None:
    """Such a panel is small and bright. What is dim is texture, and what is large would have been read."""
    frame, at, samples = shown(side, light)
    plan = SearchPlan(stream=False)
    assert plan.begins(all_seen=False)
    assert plan.looks_within(frame, [(at, samples)], read=False) is within


def test_a_bright_square_without_cells_is_no_panel_far_away() -> None:
    """The middle of a cell nearby looks so: that panel may be told by what is within it."""
    frame, at, samples = shown(20.0, 0.4)
    plan = SearchPlan(stream=False)
    assert plan.begins(all_seen=False)
    assert plan.looks_within(frame, [(replace(at, cells_show=False), samples)], read=False)
