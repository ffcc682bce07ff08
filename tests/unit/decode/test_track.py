"""Tracks: which lit square of a frame continues which of the last, and for how long one is remembered."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ledpi.core.records import Floats, Quad
from ledpi.decode.history import Identity
from ledpi.decode.identify.decision import Reading
from ledpi.decode.states import State
from ledpi.decode.track import SAME_START, Track, Tracker
from tests.builders.decode import SPEC, quad, square

FRAME_NS = 16_970_000  # 504 rows of 33.67 µs
PLACE = square(300, 200, 60)
SHOWN = Identity(
    group=0,
    reading=Reading(
        id=7, quarter_turns=0, margin=20.0, likelihood=20.0, amplitude=(0.1, 0.1), cell_bands=np.zeros((16, 4))
    ),
)


def follow(tracker: Tracker, number: int, *corners: Floats) -> list[Track]:
    """The track of each square of frame `number`, in the order of the squares."""
    tracker.begin_frame(number * FRAME_NS)
    return [track_of(tracker, quad(c)) for c in corners]


def track_of(tracker: Tracker, found: Quad) -> Track:
    """That a square continues or begins; it must be new in this frame."""
    followed = tracker.associate(found)
    assert followed is not None
    return followed[1]


@pytest.fixture
def tracker() -> Tracker:
    return Tracker((SPEC,), 4)


@pytest.mark.parametrize(
    ("corners", "goes_on"),
    [
        (square(304, 198, 61), True),
        (square(400, 200, 60), False),
        (square(300, 250, 60), False),
        (square(300, 200, 90), False),
        (square(300, 200, 40), False),
    ],
)
def test_a_square_is_followed_where_it_was(tracker: Tracker, corners: Floats, *, goes_on: bool) -> None:
    """In the next frame, a little off and a little larger; one a side away, or half as large again, is another."""
    (first,) = follow(tracker, 1, PLACE)
    (second,) = follow(tracker, 2, corners)
    assert (second is first) is goes_on


def test_a_track_outlives_frames_that_do_not_show_its_square(tracker: Tracker) -> None:
    """Something passed in front of it for 0.4 s."""
    (first,) = follow(tracker, 1, PLACE)
    for number in range(2, 25):
        follow(tracker, number)
    assert follow(tracker, 25, PLACE) == [first]


@pytest.mark.parametrize("between", [[], [10, 20, 30]])
def test_a_track_dies_after_half_a_second(tracker: Tracker, between: list[int]) -> None:
    """Frames came in between, or time jumped as between the takes of a recording."""
    (first,) = follow(tracker, 1, PLACE)
    for number in between:
        follow(tracker, number)
    (second,) = follow(tracker, 31, PLACE)
    assert second is not first


def test_time_that_does_not_advance_ends_every_track(tracker: Tracker) -> None:
    """Frames of two moments cannot be at one: whatever went wrong, nothing is carried over."""
    (first,) = follow(tracker, 5, PLACE)
    (second,) = follow(tracker, 5, PLACE)
    (third,) = follow(tracker, 4, PLACE)
    assert first is not second
    assert third is not second


@pytest.mark.parametrize(("x", "goes_on"), [(148, True), (108, False)])
def test_a_moving_square_is_sought_ahead(tracker: Tracker, x: float, *, goes_on: bool) -> None:
    """At 10 px a frame a square of 25 px is two sides further on after five frames unseen; where it was, is another."""
    follow(tracker, 1, square(100, 200, 25))
    (moving,) = follow(tracker, 2, square(108, 200, 25))
    (later,) = follow(tracker, 7, square(x, 200, 25))
    assert (later is moving) is goes_on


def test_two_squares_side_by_side_do_not_swap(tracker: Tracker) -> None:
    """Both move on by a third of a side, in whichever order they are found."""
    left, right = follow(tracker, 1, square(200, 200, 40), square(245, 200, 40))
    assert left is not right
    assert follow(tracker, 2, square(257, 200, 40), square(212, 200, 40)) == [right, left]


def test_a_square_continues_the_nearest_track(tracker: Tracker) -> None:
    """It may come from the places of two; each of them is continued once."""
    first, second = follow(tracker, 1, PLACE, square(334, 200, 60))
    assert follow(tracker, 2, square(319, 200, 60)) == [second]
    assert follow(tracker, 3, square(319, 200, 60), square(280, 200, 60)) == [second, first]


@pytest.mark.parametrize(("height", "goes_on"), [(1.0, True), (0.85, True), (0.7, False)])
def test_a_square_that_is_a_third_lower_at_once_is_another(tracker: Tracker, height: float, goes_on: bool) -> None:
    """As a part of what has jumped aside, which lies where the panel was; nothing turns so far from frame to frame."""
    (first,) = follow(tracker, 1, PLACE)
    middle = PLACE.mean(axis=0)
    (second,) = follow(tracker, 2, middle + (PLACE - middle) * (1.0, height))
    assert (second is first) is goes_on


def test_corners_keep_the_tracks_order(tracker: Tracker) -> None:
    """A square that turns past 45° is found from another corner on; its corners, and what is known of them, stay."""
    tracker.begin_frame(FRAME_NS)
    tracker.associate(quad(square(300, 200, 60, 42)))
    found, variances = square(300, 200, 60, 48), np.arange(1.0, 9.0)
    tracker.begin_frame(2 * FRAME_NS)
    turned = Quad(corners_px=np.roll(found, 1, axis=0), covariance_px2=np.diag(np.roll(variances, 2)))
    followed = tracker.associate(turned)
    assert followed is not None
    np.testing.assert_allclose(followed[0].corners_px, found)
    assert followed[0].covariance_px2 is not None
    np.testing.assert_array_equal(followed[0].covariance_px2, np.diag(variances))


def test_a_velocity_is_as_exact_as_the_corners_that_it_is_from(tracker: Tracker) -> None:
    """500 tracks of three frames, corners off by 0.1 px: the velocity's variance is two thirds of what is said.

    Steps share a frame, so that their errors cancel in part: nothing is promised that does not hold."""
    rng, velocities = np.random.default_rng(3), []
    for _ in range(500):
        tracker = Tracker((SPEC,), 4)
        for number in (1, 2, 3):
            tracker.begin_frame(number * FRAME_NS)
            corners = PLACE + rng.normal(0.0, 0.1, (4, 2))
            track = track_of(tracker, Quad(corners_px=corners, covariance_px2=0.01 * np.eye(8)))
        velocities.append(track.state.velocity_px_s)
    said = track.state.velocity_covariance
    assert said is not None
    assert 0.55 < np.var(velocities, axis=0).mean() / np.diag(said).mean() < 0.75


def test_a_square_is_not_followed_twice(tracker: Tracker) -> None:
    """A frame is searched after its tracks were sought; what the search finds may be one of their squares again."""
    (first,) = follow(tracker, 1, PLACE)
    tracker.begin_frame(2 * FRAME_NS)
    assert tracker.continue_track(first, quad(PLACE)) is not None
    assert tracker.associate(quad(PLACE + 0.1)) is None
    beside = track_of(tracker, quad(square(400, 200, 60)))
    assert beside is not first
    tracker.begin_frame(3 * FRAME_NS)
    assert tracker.unread_tracks() == [beside, first]


def test_a_square_that_had_no_turn_is_first_in_the_next_frame(tracker: Tracker) -> None:
    """Else where a frame's time is too short for all, the older ones would never be read."""
    waiting, other = follow(tracker, 1, PLACE, square(400, 200, 60))
    tracker.begin_frame(2 * FRAME_NS)
    waiting.waits = True
    assert tracker.continue_track(other, quad(square(400, 200, 60))) is not None
    tracker.begin_frame(3 * FRAME_NS)
    assert tracker.unread_tracks() == [waiting, other]


def test_a_panel_is_missing_until_it_is_shown(tracker: Tracker) -> None:
    """Its place is known; what surely is no panel ends with the frame."""
    read, lamp = follow(tracker, 1, PLACE, square(400, 200, 60))
    read.history, lamp.is_none = read.history.enter(State.READ, SHOWN), True
    tracker.begin_frame(2 * FRAME_NS)
    (missing,) = tracker.missing_px()
    assert missing == pytest.approx(PLACE, abs=0.1)
    assert tracker.unread_tracks() == []
    assert tracker.continue_track(read, quad(PLACE)) is not None
    assert tracker.missing_px() == []


# Four columns, of which three are PLACE; and a bezel around it.
AROUND_PLACE = [np.array([[270.0, 170], [350, 170], [350, 230], [270, 230]]), square(300, 200, 66)]


@pytest.mark.parametrize("around", AROUND_PLACE)
def test_a_square_that_was_not_read_does_not_hide_one_around_it(tracker: Tracker, around: Floats) -> None:
    """It may be a part of a panel; a candidate a pixel off leads to it again. Of both that is one which leaves less."""
    tracker.begin_frame(FRAME_NS)
    first = track_of(tracker, replace(quad(PLACE), residual=0.02))
    assert tracker.is_followed(PLACE + 1.0)
    assert not tracker.is_followed(around)
    assert tracker.associate(replace(quad(around), residual=0.03)) is None
    other = track_of(tracker, replace(quad(around), residual=0.01))
    tracker.begin_frame(2 * FRAME_NS)
    assert tracker.unread_tracks() == [other] != [first]


def test_a_candidate_within_half_a_cell_of_what_was_fitted_leads_there_again(tracker: Tracker) -> None:
    """Cells are 15 px: from 7 px aside, not from 11, as from there the next lattice may be as near."""
    follow(tracker, 1, PLACE)
    assert tracker.is_followed(PLACE + np.array([7.0, 0.0]), SAME_START)
    assert not tracker.is_followed(PLACE + np.array([11.0, 0.0]), SAME_START)


def test_a_part_that_leaves_more_than_the_whole_is_no_panel(tracker: Tracker) -> None:
    """Half of a panel, found before the whole and after it; what leaves less, as a single even cell may, stays too."""
    part, whole, cell = square(300, 215, 38), square(300, 200, 60), square(310, 210, 20)
    tracker.begin_frame(FRAME_NS)
    track_of(tracker, replace(quad(part), residual=0.02))
    panel = track_of(tracker, replace(quad(whole), residual=0.01))
    assert tracker.associate(replace(quad(part), residual=0.02)) is None
    beside = track_of(tracker, replace(quad(cell), residual=0.005))
    tracker.begin_frame(2 * FRAME_NS)
    assert tracker.unread_tracks() == [beside, panel]


@pytest.mark.parametrize("around", AROUND_PLACE)
def test_a_panel_that_was_read_hides_what_is_around_it(tracker: Tracker, around: Floats) -> None:
    """Its ID is known, and so is where it is."""
    (first,) = follow(tracker, 1, PLACE)
    first.history = first.history.enter(State.READ, SHOWN)
    assert tracker.is_followed(around)
    assert tracker.associate(quad(around)) is None


def test_tracks_that_meet_become_one(tracker: Tracker) -> None:
    """A bezel and the panel within it, say, one of which had been told wrongly before."""
    first, second = follow(tracker, 1, PLACE, square(302, 200, 78))
    tracker.begin_frame(2 * FRAME_NS)
    between = square(301, 200, 68)
    assert tracker.continue_track(first, quad(between)) is not None
    assert tracker.continue_track(second, quad(between + 0.01)) is None
    tracker.begin_frame(3 * FRAME_NS)
    assert tracker.unread_tracks() == [first]


def test_what_overlaps_a_panel_is_followed_no_longer(tracker: Tracker) -> None:
    """However much older it is: a part of the panel, or what is around it."""
    _, second = follow(tracker, 1, PLACE, square(302, 200, 78))
    second.history = second.history.enter(State.READ, SHOWN)
    tracker.begin_frame(2 * FRAME_NS)
    assert tracker.read_tracks() == [second]
    assert tracker.continue_track(second, quad(square(302, 200, 78))) is not None
    assert tracker.unread_tracks() == []


def test_panels_are_those_that_the_last_frame_showed(tracker: Tracker) -> None:
    """A panel that was out of view for a frame is left to a search, and so are squares that were not read."""
    first, second = follow(tracker, 1, PLACE, square(450, 200, 60))
    first.history = first.history.enter(State.READ, SHOWN)
    tracker.begin_frame(2 * FRAME_NS)
    assert (tracker.read_tracks(), tracker.unread_tracks()) == ([first], [second])
    tracker.begin_frame(3 * FRAME_NS)
    assert (tracker.read_tracks(), tracker.unread_tracks()) == ([], [])


@pytest.mark.parametrize(
    ("state", "frames", "followed"),
    [(State.UNREAD, 15, True), (State.UNREAD, 16, False), (State.SEARCHING, 16, False), (State.DOUBTED, 16, True)],
)
def test_what_is_not_read_in_sixteen_frames_is_left_to_a_search(
    tracker: Tracker, state: State, frames: int, followed: bool
) -> None:
    """It is a lamp or a window; a panel that was read before stays one."""
    (first,) = follow(tracker, 1, PLACE)
    memory = first.history.memories[0]._replace(frames=frames)
    first.history = first.history._replace(memories=(memory,), state=state)
    tracker.begin_frame(2 * FRAME_NS)
    assert (tracker.unread_tracks() == [first]) is followed


def test_whether_panels_are_seen(tracker: Tracker) -> None:
    """Those count that were read; without any there are none to see."""
    tracker.begin_frame(FRAME_NS)
    assert tracker.panels_shown() == []
    first, _ = follow(tracker, 1, PLACE, square(450, 200, 60))
    first.history = first.history.enter(State.READ, SHOWN)
    assert tracker.panels_shown() == [True]
    tracker.begin_frame(2 * FRAME_NS)
    assert tracker.panels_shown() == [False]
    assert tracker.continue_track(first, quad(PLACE)) is not None
    assert tracker.panels_shown() == [True]
