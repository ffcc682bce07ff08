"""A robot that was carried off, and panels that hang elsewhere than the map says."""

from __future__ import annotations

import numpy as np
import pytest

from ledpi.state.estimator import Estimator
from ledpi.state.inputs import Odometry
from tests.builders.state import (
    FACES,
    RATE,
    SEAT,
    SECOND_NS,
    drive,
    heard,
    look,
    odometry,
    on_circle,
    room,
    state_at,
    still,
)

HERE, THERE = (0.0, 0.0, 0.0), (1.0, -1.0, 1.0)


def settled(panels: tuple[int, ...]) -> Estimator:
    """A state that rests on these panels."""
    estimator = Estimator(room(), SEAT)
    still(estimator, dict.fromkeys(panels, 0.0), HERE, 0.0, 1.0)
    return estimator


def test_two_panels_that_agree_name_a_third_that_hangs_elsewhere() -> None:
    """While it is refused both poses are spanned; once both witnesses are seen again it is not listened to."""
    estimator = settled((1, 2))
    still(estimator, {3: 0.6}, HERE, 1.0, 0.4)
    contested = state_at(estimator, 1.4)
    assert contested.contested
    assert np.sqrt(contested.covariance[1, 1]) > 0.5
    still(estimator, {3: 0.6, 1: 0.0, 2: 0.0}, HERE, 1.4, 0.4)
    state = state_at(estimator, 1.8)
    assert (state.moved, state.contested) == ((3,), False)
    assert [(event.kind, event.panel) for event in state.events] == [("panel_moved", 3)]
    assert np.hypot(*state.pose[:2]) < 0.01


def test_a_panel_that_hangs_right_again_is_listened_to_again() -> None:
    """After as many looks as one pass has."""
    estimator = settled((1, 2))
    still(estimator, {3: 0.6, 1: 0.0, 2: 0.0}, HERE, 1.0, 0.5)
    assert state_at(estimator, 1.5).moved == (3,)
    still(estimator, {3: 0.0, 1: 0.0, 2: 0.0}, HERE, 2.5, 0.5)
    assert state_at(estimator, 3.0).moved == ()


def test_a_state_that_rests_on_one_panel_accuses_nobody() -> None:
    """It began at a panel that hangs elsewhere: two others that agree take over, and are innocent."""
    estimator = Estimator(room(), SEAT)
    still(estimator, {1: 0.3}, HERE, 0.0, 0.5)
    still(estimator, {1: 0.3, 2: 0.0}, HERE, 0.5, 0.5)
    assert state_at(estimator, 1.0).contested
    assert state_at(estimator, 1.0).moved == ()
    still(estimator, {1: 0.3, 2: 0.0, 4: 0.0}, HERE, 1.0, 0.5)
    state = state_at(estimator, 1.5)
    assert state.moved == (1,)
    assert np.hypot(*state.pose[:2]) < 0.02


def test_a_robot_that_was_carried_off_is_found_again() -> None:
    """A panel that had agreed says otherwise for half a second, or another agrees with it at once."""
    alone, together = settled((1, 2)), settled((1, 2))
    still(alone, {2: 0.0}, THERE, 1.0, 0.3)
    assert state_at(alone, 1.3).relocalisations == 0
    still(alone, {2: 0.0}, THERE, 1.3, 0.3)
    still(together, {2: 0.0, 3: 0.0}, THERE, 1.0, 0.15)
    for estimator, t_s in ((alone, 1.6), (together, 1.15)):
        state = state_at(estimator, t_s)
        assert state.relocalisations == 1
        assert state.moved == ()
        assert np.allclose(state.pose, THERE, atol=0.03)


def test_one_bad_look_is_no_rival_for_long() -> None:
    """The next good one ends it."""
    estimator = settled((1, 2))
    heard(estimator, look(2, HERE, 1.05, aside_m=0.5))
    assert state_at(estimator, 1.05).contested
    heard(estimator, look(2, HERE, 1.1))
    assert not state_at(estimator, 1.1).contested


@pytest.mark.parametrize("scale", [2.0, pytest.param(-1.0, marks=pytest.mark.slow)])
def test_odometry_that_contradicts_the_panels_is_named_and_not_used(scale: float) -> None:
    """Totals that run by twice as much, or backward: the state goes by panels alone, until the totals are right."""
    estimator = Estimator(room(), SEAT)
    for each in drive(9.0):
        if isinstance(each, Odometry):
            total = scale * RATE * each.t_ns * 1e-9
            if each.t_ns > 4 * SECOND_NS:  # its totals begin anew, and run as they should
                total = RATE * each.t_ns * 1e-9
            each = odometry(each.t_ns * 1e-9, way_m=total, yaw_rad=total)
        heard(estimator, each)
        if each.t_ns == 4 * SECOND_NS:
            state = state_at(estimator, 4.0)
            assert [event.kind for event in state.events][-1] == "odometry_contradicts"
            assert (state.by_odometry, state.contested, state.moved) == (False, False, ())
            assert np.hypot(*(state.pose[:2] - on_circle(4.0)[:2])) < 0.03
    assert state_at(estimator, 9.0).by_odometry


def test_one_lucky_look_of_many_makes_no_witness() -> None:
    """Ten that say neither, and one that would agree by itself: none is used. Once most agree, they are."""
    estimator = Estimator(room(place_m=0.05, angle_rad=0.03), SEAT)
    still(estimator, {1: 0.0}, HERE, 0.0, 1.0)
    for n, aside_m in enumerate([*[0.24] * 10, 0.18, *[0.0] * 7]):
        t_s = 1.0 + 0.05 * n
        heard(estimator, odometry(t_s), look(2, HERE, t_s, aside_m, mirror_rad=1.0))
        assert (state_at(estimator, t_s).panel_ns >= SECOND_NS) is (n >= 15)


def test_a_panel_that_creeps_away_does_not_take_the_robot_along() -> None:
    """By 5 mm a second, while it stands: no mount explains that more and more."""
    estimator = Estimator(room(), SEAT)
    for t_s in np.arange(0.0, 12.0, 0.05).tolist():
        heard(estimator, odometry(t_s), *(look(i, HERE, t_s, 0.005 * t_s if i == 3 else 0.0) for i in FACES))
    state = state_at(estimator, 12.0)
    assert np.hypot(*(state.pose[:2] - HERE[:2])) < 0.05
    assert not state.mount_rad[0].any()  # of a robot that stands nothing shows it


def test_a_gyro_that_turns_by_itself_is_not_used() -> None:
    """The robot stands, and its wheels say so: panels show that it does not turn."""
    estimator = Estimator(room(), SEAT)
    for t_s in np.arange(0.0, 4.0, 0.05).tolist():
        heard(estimator, odometry(t_s, yaw_rad=0.5 * t_s), look(1, HERE, t_s), look(2, HERE, t_s))
    state = state_at(estimator, 4.0)
    assert (state.by_odometry, state.events[-1].kind) == (False, "odometry_contradicts")
    assert np.allclose(state.pose, HERE, atol=0.02)
