"""The estimator: any order of arrival, odometry of every kind, and garbage."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ledpi.core.records import Rejected
from ledpi.state.estimator import Estimator, State
from ledpi.state.inputs import Look, Odometry, OdometryNoise
from tests.builders.state import (
    RATE,
    SEAT,
    SECOND_NS,
    by_turned_camera,
    drive,
    heard,
    look,
    odometry,
    on_circle,
    room,
    state_at,
    still,
)


def test_the_order_of_arrival_changes_no_bit() -> None:
    """Looks that are late by 30 to 90 ms, odometry by up to 20; or all looks together, backward: as with no delay."""
    inputs, rng = drive(), np.random.default_rng(4)
    delays = [rng.uniform(0.03, 0.09) if isinstance(each, Look) else rng.uniform(0, 0.02) for each in inputs]
    late = [inputs[k] for k in np.argsort([each.t_ns * 1e-9 + d for each, d in zip(inputs, delays, strict=True)])]
    one, other = Estimator(room(), SEAT), Estimator(room(), SEAT)
    assert heard(one, *inputs) == []
    for each in late:
        add = other.add_look if isinstance(each, Look) else other.add_odometry
        assert add(each, 2 * SECOND_NS) is None  # type: ignore[operator]
    together = Estimator(room(), SEAT)
    assert heard(together, *(each for each in inputs if isinstance(each, Odometry))) == []
    assert together.add_looks([each for each in inputs[::-1] if isinstance(each, Look)], 2 * SECOND_NS) == ()
    states = [state_at(each, 1.6) for each in (one, other, together)]
    for each in states[1:]:
        assert np.array_equal(states[0].pose, each.pose)
        assert np.array_equal(states[0].covariance, each.covariance)
    assert np.hypot(*(states[0].pose[:2] - on_circle(states[0].t_ns * 1e-9)[:2])) < 0.02


@pytest.mark.parametrize("kind", ["wheels", "turns", "none"])
def test_without_a_part_of_the_odometry_the_rest_holds(kind: str) -> None:
    """Wheels alone, a gyro alone, or nothing but panels: a robot on a circle is found, and its speed."""
    noise = OdometryNoise(base_m=0.3) if kind == "wheels" else OdometryNoise()
    estimator = Estimator(room(), SEAT, noise)
    for each in drive():
        if isinstance(each, Odometry):
            t_s, half = each.t_ns * 1e-9, 0.15 * RATE * each.t_ns * 1e-9
            wheels = replace(each, left_m=RATE * t_s - half, right_m=RATE * t_s + half, yaw_rad=None)
            each = wheels if kind == "wheels" else replace(each, left_m=None, right_m=None)
        if kind != "none" or isinstance(each, Look):
            assert heard(estimator, each) == []
    state = state_at(estimator, 1.5)
    error = state.pose[:2] - on_circle(1.5)[:2]
    assert error @ np.linalg.solve(state.covariance[:2, :2], error) < 13.8
    assert state.speed_m_s == pytest.approx(RATE, abs=0.1)
    assert state.turn_rad_s == pytest.approx(RATE, abs=0.2)


def there_by_turned_camera(mount_deg: tuple[float, float, float]) -> State:
    """The state after 3 m ahead, and half a turn, between three panels that hang 1 m above the camera."""
    estimator = Estimator(room(0.001, 0.001), SEAT)
    for t_s in np.arange(0, 12, 0.05).tolist():
        way, turned = min(0.5 * t_s, 3.0), max(0.0, t_s - 6.0) * math.pi / 6
        looks = (look(i, (way - 1.5, 0.0, turned), t_s) for i in (1, 2, 4))
        told = [by_turned_camera(each, *np.radians(mount_deg)) for each in looks]
        heard(estimator, odometry(t_s, way_m=way, yaw_rad=turned), *told)
    return state_at(estimator, 12.0)


@pytest.mark.parametrize("mount_deg", [(0.0, 0.0, 2.0), (0.0, 2.0, 0.0), (-2.0, 0.0, 0.0)])
def test_a_camera_that_is_turned_is_found(mount_deg: tuple[float, float, float]) -> None:
    """By yaw it would head 2° aside, by pitch or roll it would be 35 mm off."""
    state = there_by_turned_camera(mount_deg)
    assert np.hypot(*(state.pose[:2] - (1.5, 0.0))) < 0.01
    assert math.degrees(abs(state.pose[2])) == pytest.approx(180.0, abs=0.5)
    assert state.events == ()
    turned, deviations = np.degrees(state.mount_rad)
    assert turned == pytest.approx(mount_deg, abs=0.3)
    assert (deviations < 0.5).all()


def test_a_mount_that_is_off_by_more_than_it_may_is_named() -> None:
    """The configuration has its yaw wrong by 8°; the panels, of whom none is accused, agree with each other."""
    state = there_by_turned_camera((0.0, 0.0, 8.0))
    assert [event.kind for event in state.events] == ["mount_contradicts"]


def test_nothing_says_that_a_robot_has_not_turned_once_its_odometry_is_silent() -> None:
    """Half a second later it knows its heading a tenth as well, and soon it may be anywhere."""
    estimator = Estimator(room(), SEAT, OdometryNoise())
    still(estimator, {1: 0.0, 2: 0.0}, (0.0, 0.0, 0.0), 0.0, 1.0)
    deviations = [math.sqrt(state_at(estimator, t_s).covariance[2, 2]) for t_s in (1.0, 1.5)]
    assert deviations[1] > 10 * deviations[0]
    assert isinstance(estimator.at(3 * SECOND_NS), Rejected)


def test_a_gyro_tells_the_yaw_also_where_wheels_could() -> None:
    """A wheel spins by half a metre, which is a turn of 1.7 rad to the wheels; once the gyro is silent they tell it."""
    estimator = Estimator(room(), SEAT, OdometryNoise(base_m=0.3))
    still(estimator, {1: 0.0, 2: 0.0}, (0.0, 0.0, 0.0), 0.0, 1.0)
    for k in range(11):
        heard(estimator, replace(odometry(1 + 0.05 * k), right_m=0.05 * k))
    state = state_at(estimator, 1.5)
    assert state.pose[2] == pytest.approx(0.0, abs=0.01)
    assert state.covariance[2, 2] < 0.02**2
    for k in range(11):
        heard(estimator, replace(odometry(1.55 + 0.05 * k), left_m=0.01 * k, right_m=0.5, yaw_rad=None))
    turned = state_at(estimator, 2.05)
    assert turned.pose[2] - state.pose[2] == pytest.approx(-0.1 / 0.3, abs=0.01)
    assert turned.covariance[2, 2] > state.covariance[2, 2]


def test_garbage_is_counted_and_changes_nothing() -> None:
    """Old, of the future, not finite, of no panel of the map, or leaping: it is told, and the state stays."""
    estimator = Estimator(room(), SEAT)
    still(estimator, {1: 0.0, 2: 0.0}, (0.0, 0.0, 0.0), 10.0, 1.0)
    stranger = replace(look(1, (0.0, 0.0, 0.0), 10.9), panel=50)
    assert heard(estimator, odometry(5.0), odometry(10.95, way_m=math.nan), stranger) == [
        "state.too_old",
        "state.no_number",
        "state.not_in_map",
    ]
    future = estimator.add_odometry(odometry(99.0), 11 * SECOND_NS)
    assert isinstance(future, Rejected)
    assert future.key == "state.in_future"
    assert heard(estimator, odometry(11.0, way_m=-2000.0), odometry(11.05, way_m=-2000.0)) == ["state.odometry_leap"]
    assert np.hypot(*state_at(estimator, 11.1).pose[:2]) < 0.01


def test_a_lifted_robot_is_nowhere_until_a_panel_is_seen() -> None:
    """The controller says so; the panel that leaves no choice is where it begins anew."""
    estimator = Estimator(room(), SEAT)
    assert estimator.at(0) == Rejected(stage="state", reason="not_started")
    still(estimator, {1: 0.0, 2: 0.0}, (0.0, 0.0, 0.0), 0.0, 0.5)
    heard(estimator, replace(odometry(0.6), lifted=True))
    assert isinstance(estimator.at(SECOND_NS), Rejected)
    heard(estimator, look(3, (1.0, 1.0, 2.0), 0.7))
    assert np.allclose(state_at(estimator, 0.7).pose, [1.0, 1.0, 2.0], atol=1e-6)


def test_who_lifts_a_robot_does_not_make_its_odometry_a_liar() -> None:
    """Its wheels turn by half a metre meanwhile; then it sees eight panels from elsewhere: it is still believed."""
    four = room()
    estimator = Estimator(four | {10 + panel: four[panel] for panel in four}, SEAT)

    def see(pose: tuple[float, float, float], t_s: float) -> None:
        looks = [look(panel, pose, t_s) for panel in four]
        heard(estimator, *looks, *(replace(each, panel=10 + each.panel) for each in looks))

    for k in range(31):
        heard(estimator, replace(odometry(0.05 * k, way_m=max(0.0, 0.05 * (k - 20))), lifted=k == 30))
        if k < 20:
            see((0.0, 0.0, 0.0), 0.05 * k)
    for k in range(20):
        heard(estimator, odometry(1.55 + 0.05 * k, way_m=0.5))
        see((1.0, 1.0, 2.0), 1.56 + 0.05 * k)
    state = state_at(estimator, 2.52)
    assert state.by_odometry
    assert np.allclose(state.pose, [1.0, 1.0, 2.0], atol=0.02)
