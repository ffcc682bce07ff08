"""Fixes of a robot in a row: the last one may settle what a frame leaves open, and may not mislead."""

from __future__ import annotations

import numpy as np

from ledpi.core.records import Rejected
from ledpi.pose.fix_history import AMBIGUOUS, CONTRADICTION, Candidate, FixHistory
from tests.builders.map import PERIOD_NS, pose


def candidate(x_m: float, *used: int, rejected: tuple[int, ...] = ()) -> Candidate:
    """Makes a pose so far along the map's x axis, known to 1 cm and 0.01 rad."""
    return Candidate(map_from_base=pose((x_m, 0.0, 0.0)), covariance=np.diag([1e-4] * 6), used=used, rejected=rejected)


def after(*frames: list[Candidate]) -> list[Candidate | Rejected]:
    """Returns what is chosen in each of these frames."""
    history = FixHistory()
    return [history.choose(candidates, k * PERIOD_NS) for k, candidates in enumerate(frames, start=1)]


def test_no_robot_leaps_by_six_deviations_of_its_way() -> None:
    """0.3 m from frame to frame are 18 m/s: the panel that says so contradicts those before it."""
    *_, last = after([candidate(0.0, 7, 9)], [candidate(0.3, 8)])
    assert last is CONTRADICTION


def test_the_same_leap_is_not_believed_for_being_looked_at_again() -> None:
    """8 leaves two poses open, both too far off; a few frames later a robot might have come there."""
    open_poses = [candidate(0.3, 8), candidate(-0.4, 8)]
    _, *later, last = after([candidate(0.0, 7, 9)], *[open_poses] * 5, [candidate(0.3, 8)])
    assert set(later) == {CONTRADICTION}
    assert last is CONTRADICTION


def test_a_fix_by_a_panel_that_none_speaks_for_settles_no_other_panels_pose() -> None:
    """7 may hang elsewhere: that one of 8's poses goes on from there is no reason to believe it."""
    *_, last = after([candidate(0.0, 7)], [candidate(0.05, 8), candidate(1.0, 8)])
    assert last is AMBIGUOUS


def test_a_fix_by_panels_that_speak_for_each_other_settles_another_ones_pose() -> None:
    """The same, after 7 and 9 have agreed."""
    near = candidate(0.05, 8)
    *_, last = after([candidate(0.0, 7, 9)], [near, candidate(1.0, 8)])
    assert last is near


def test_a_fix_by_one_panel_settles_that_panels_next_pose() -> None:
    """It goes on from itself, rightly or wrongly hung."""
    near = candidate(0.01, 7)
    *_, last = after([candidate(0.0, 7)], [near, candidate(1.0, 7)])
    assert last is near


def test_a_way_that_a_robot_may_have_come_makes_no_witness() -> None:
    """8 is 0.15 m beside 7's fix, where a robot at 9 m/s would be: it is not heard against 9 for that."""
    both = [candidate(0.15, 8, rejected=(9,)), candidate(0.0, 9, rejected=(8,))]
    *_, last = after([candidate(0.0, 7)], [candidate(0.15, 8)], both)
    assert last is CONTRADICTION


def contradiction(one: int, other: int) -> list[Candidate]:
    """Makes what a frame leaves that shows two panels, of which one hangs elsewhere."""
    return [candidate(0.5, one, rejected=(other,)), candidate(0.0, other, rejected=(one,))]


def test_a_panel_that_contradicts_two_others_is_the_one_that_hangs_elsewhere() -> None:
    """That explains all that was seen; that both others do is a thousand times less likely."""
    *_, last = after(contradiction(7, 8), contradiction(7, 9))
    assert isinstance(last, Candidate)
    assert last.used == (9,)


def test_to_have_been_accused_by_fewer_is_no_merit_where_one_panel_explains_not_all() -> None:
    """10 has contradicted two others, and those three each; but 7 is not all that is wrong with this map, nor 9."""
    pairs = [(7, 8), (9, 10), (7, 9), (8, 9), (7, 10)]
    assert set(after(*[contradiction(*pair) for pair in pairs])) == {CONTRADICTION}
