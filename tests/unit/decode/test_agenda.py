"""Which candidates of a stream are looked at in which frame."""

from __future__ import annotations

import numpy as np

from ledpi.decode.agenda import SEARCH_EVERY, Agenda
from ledpi.decode.proposals import Candidate
from tests.builders.decode import candidate, square


def candidates(*places: tuple[float, float], side: float = 40.0) -> list[Candidate]:
    return [candidate(square(x, y, side)) for x, y in places]


ROW = [(60.0 + 50 * n, 200.0) for n in range(10)]


def looked_at(agenda: Agenda, proposed: list[Candidate], budget: int, *, in_vain: bool = False) -> list[int]:
    """Which of them a frame looks at, that can look at so many, beside a panel that is followed."""
    while not agenda.is_due([True]):
        pass
    order = agenda.schedule(proposed, is_urgent=False)[:budget]
    for one in order:
        agenda.tried(one, in_vain=in_vain)
    return [next(k for k, each in enumerate(proposed) if each is one) for one in order]


def test_who_waited_longest_comes_first() -> None:
    """In the order in which they were proposed: after three of five were looked at, the other two; then the first."""
    agenda, proposed = Agenda(), candidates(*ROW[:5])
    assert looked_at(agenda, proposed, budget=3) == [0, 1, 2]
    assert [looked_at(agenda, proposed, budget=2) for _ in range(3)] == [[3, 4], [0, 1], [2, 3]]


def test_a_new_place_comes_before_those_that_were_tried() -> None:
    """Though it is the worst proposal of all."""
    agenda, proposed = Agenda(), candidates(*ROW[:5])
    looked_at(agenda, proposed, budget=99)
    assert looked_at(agenda, [*proposed, *candidates((300.0, 400.0))], budget=2) == [5, 0]


def test_a_place_where_there_is_nothing_waits_twice_as_long_each_time() -> None:
    """For 1, 2, 4 … 32 searches, though it moves; once something was there, it has its turn again in each search."""
    agenda = Agenda()
    seen = [turn for turn in range(1, 100) if looked_at(agenda, candidates((60.0 + turn, 200.0)), 1, in_vain=True)]
    assert seen == [1, 2, 4, 8, 16, 32, 64, 96]
    agenda.tried(candidates((159.0, 200.0))[0], in_vain=False)
    assert looked_at(agenda, candidates((160.0, 200.0)), budget=1) == [0]


def test_who_waits_comes_last_where_no_panel_is_followed() -> None:
    """As it delays nothing then. What surely is none waits longest."""
    agenda, proposed = Agenda(), candidates(*ROW[:3])
    agenda.refuse(proposed[0].corners_px)
    assert looked_at(agenda, proposed, budget=99) == [1, 2]
    order = agenda.schedule(proposed, is_urgent=True)
    assert [next(k for k, each in enumerate(proposed) if each is one) for one in order] == [1, 2, 0]


def test_the_picture_is_searched_every_third_frame_while_all_panels_are_seen() -> None:
    """And in each frame in which one is not, or none is shown; the first is searched anyway."""
    agenda = Agenda()
    assert [(agenda.is_due_next, agenda.is_due([True])) for _ in range(7)] == [
        (due, due) for due in (True, False, False, True, False, False, True)
    ]
    assert [agenda.is_due([False]) for _ in range(6)] == [True] * 6
    assert [agenda.is_due([True]) for _ in range(SEARCH_EVERY)] == [False, False, True]
    assert agenda.is_due([True, False])


def test_a_missing_panel_is_searched_for_less_and_less_often() -> None:
    """A search in vain delays the panels that are there: so after one frame, two, three; and anew once it was back."""
    agenda = Agenda()
    missing = [agenda.is_due([True, False]) for _ in range(12)]
    assert missing == [True, False, True, False, False, True, False, False, True, False, False, True]
    assert not agenda.is_due([True, True])
    assert agenda.is_due([True, False])


def test_what_was_tried_is_kept_small() -> None:
    """However long a stream is: as many places as were proposed while one may wait."""
    agenda, rng = Agenda(), np.random.default_rng(1)
    for _ in range(100):
        looked_at(agenda, candidates(*rng.uniform(50, 400, (8, 2)).tolist()), budget=99)
    assert len(agenda.places) <= 8 * 33
