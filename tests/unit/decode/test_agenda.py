"""Which candidates of a stream are looked at in which frame."""

from __future__ import annotations

import numpy as np
import pytest

from ledpi.decode.agenda import SEARCH_EVERY, Agenda
from ledpi.decode.proposals import Candidate
from tests.builders.decode import candidate, square


def candidates(*places: tuple[float, float], side: float = 40.0) -> list[Candidate]:
    return [candidate(square(x, y, side)) for x, y in places]


ROW = [(60.0 + 50 * n, 200.0) for n in range(10)]


def looked_at(agenda: Agenda, proposed: list[Candidate], budget: int) -> list[int]:
    """Which of them a frame looks at, that can look at so many."""
    agenda.is_due([False])
    order = agenda.schedule(proposed)[:budget]
    for one in order:
        agenda.tried(one)
    return [next(k for k, each in enumerate(proposed) if each is one) for one in order]


def test_the_best_is_looked_at_first_and_in_every_frame() -> None:
    """In the order in which they were proposed, each once; the best however often in vain: it may be hidden."""
    agenda, proposed = Agenda(), candidates(*ROW)
    assert looked_at(agenda, proposed, budget=99) == list(range(10))
    assert all(0 in looked_at(agenda, proposed, budget=2) for _ in range(6))


@pytest.mark.parametrize("budget", [1, 2, 3, 4])
def test_everybody_gets_a_turn(budget: int) -> None:
    """The first look is by turn, and every other: ten candidates are all looked at, and again, where one takes all."""
    agenda, proposed = Agenda(), candidates(*ROW)
    frames = -(-10 // -(-budget // 2))
    for _ in range(2):
        seen = {k for _ in range(frames) for k in looked_at(agenda, proposed, budget)}
        assert seen == set(range(10))


def test_who_waited_longest_comes_first() -> None:
    """After three of five were looked at, the fourth; the fifth; then the second again."""
    agenda, proposed = Agenda(), candidates(*ROW[:5])
    assert looked_at(agenda, proposed, budget=3) == [0, 1, 2]
    assert [looked_at(agenda, proposed, budget=2)[0] for _ in range(3)] == [3, 4, 1]


def test_a_new_place_comes_before_those_that_were_tried() -> None:
    """Though it is the worst proposal of all."""
    agenda, proposed = Agenda(), candidates(*ROW[:5])
    looked_at(agenda, proposed, budget=99)
    assert looked_at(agenda, [*proposed, *candidates((300.0, 400.0))], budget=2) == [5, 0]


def test_places_are_recognised_although_they_move() -> None:
    """By a tenth of the side from frame to frame."""
    agenda = Agenda()
    assert looked_at(agenda, candidates(*ROW[:4]), budget=2) == [0, 1]
    assert looked_at(agenda, candidates(*((x + 4, y) for x, y in ROW[:4])), budget=2) == [2, 0]
    assert looked_at(agenda, candidates(*((x + 8, y) for x, y in ROW[:4])), budget=2) == [3, 0]


def test_where_nothing_was_proposed_again_is_forgotten() -> None:
    """A place that comes back later is new, and comes before what was tried since."""
    agenda, proposed = Agenda(), candidates(*ROW[:4])
    looked_at(agenda, proposed, budget=99)
    looked_at(agenda, proposed[:3], budget=99)
    assert looked_at(agenda, proposed, budget=2) == [3, 0]
    assert looked_at(agenda, [], budget=2) == []
    assert looked_at(agenda, proposed, budget=99) == [0, 1, 2, 3]


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
    """However long a stream is: as many places as were proposed."""
    agenda, rng = Agenda(), np.random.default_rng(1)
    for _ in range(50):
        proposed = candidates(*rng.uniform(50, 400, (8, 2)).tolist())
        looked_at(agenda, proposed, budget=99)
    assert len(agenda.turns) < 100
