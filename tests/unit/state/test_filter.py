"""The filter's equations, against finite differences and by hand."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
import pytest

from ledpi.core.records import Floats
from ledpi.state.filter import FIRST, MOUNT_RAD, Filter
from ledpi.state.inputs import OWN, POSE, Step, propagate
from tests.builders.state import look, room

GYRO = Step(0.1, 0.3, 0.2, drifts_with=0.1)
WHEELS = Step(0.1, 0.3, 0.2, drifts_with=0.3)
TURNS_ONLY, NOTHING = Step(0.1, None, 0.2, drifts_with=0.1), Step(0.1)


def slopes(of: Callable[[Floats], Floats], at: Floats) -> Floats:
    """Central differences."""
    steps = np.eye(len(at)) * 1e-6
    return np.stack([(of(at + e) - of(at - e)) / 2e-6 for e in steps], axis=1)


@pytest.mark.parametrize("step", [GYRO, WHEELS, TURNS_ONLY, NOTHING])
def test_the_covariance_moves_by_the_slopes_of_the_motion(step: Step) -> None:
    """P' − Q = F·P·Fᵀ of the pose, with F by finite differences; Q is what a certain state comes to have."""
    x = np.array([1.0, 2.0, 0.7, 0.4, 0.5, 0.02, 0.03, -0.02])
    root = np.random.default_rng(1).normal(size=(OWN, OWN))

    def moved(at: Floats) -> Floats:
        at = at.copy()
        propagate(at, np.zeros((OWN, OWN)), step)
        return at

    noise, P = np.zeros((OWN, OWN)), root @ root.T
    propagate(x.copy(), noise, step)
    F = slopes(moved, x)[:POSE]
    expected = F @ P @ F.T + noise[:POSE, :POSE]
    propagate(x.copy(), P, step)
    assert np.allclose(P[:POSE, :POSE], expected, atol=1e-6)
    assert np.allclose(P, P.T, atol=1e-12)


def test_a_way_is_uncertain_along_itself() -> None:
    """North-east by wheels that may be off by 4 cm: by as much that way, and by a quarter of it across."""
    x, noise = np.zeros(OWN), np.zeros((OWN, OWN))
    x[2] = math.pi / 4
    propagate(x, noise, Step(0.1, 0.3, 0.0, way_variance=0.04**2))
    assert np.allclose(noise[:2, :2] * 1e4, [[8.5, 7.5], [7.5, 8.5]])  # half the sum of 16 and 1, half what they differ


def test_one_look_is_weighed_with_the_state_as_by_hand() -> None:
    """Ahead of a panel 4 m away, both certain but for the way: variances 4 and 1 make a fifth of the difference."""
    states = Filter(room(1e-9, 1e-9), (0.0, 0.0))
    states.P[0, 0], states.P[OWN:FIRST], states.has_pose = 4e-4, 0.0, True  # its mount is exact
    seen = look(1, (0.1, 0.0, 0.0), 0.0)
    object.__setattr__(seen, "range_share", 1e-9)
    object.__setattr__(seen, "heading_rad", 1e-9)
    states.update(states.compare(seen))
    assert np.allclose(states.x[:POSE], [0.1 * 4 / 5, 0.0, 0.0], atol=1e-6)
    assert states.P[0, 0] == pytest.approx(4e-4 * 1 / 5, rel=1e-6)


def test_a_start_is_where_the_panel_says_and_as_uncertain_as_panel_and_look() -> None:
    """From 4 m: the map's angle of 0.01 rad is 4 cm aside; along the ray its 1 cm, 1 % of 4 m, and the look's 1 cm.

    The camera's mount turns the heading, and nothing aside by that; tilted, it moves a panel that hangs 1 m above it.
    """
    states = Filter(room(), (0.0, 0.0))
    states.start(look(1, (0.0, 0.0, 0.3), 0.0))
    assert np.allclose(states.x[:POSE], [0.0, 0.0, 0.3], atol=1e-9)
    yaw = 0.01**2 + 0.01**2 + 1e-4  # map's, decoder's, and the look's own
    c, s = math.cos(0.3), math.sin(0.3)
    assert states.P[2, 2] == pytest.approx(yaw + MOUNT_RAD**2)
    placed = 0.01**2 + MOUNT_RAD**2
    assert states.P[1, 1] == pytest.approx(placed + 16 * yaw + s * s * 1e-4 + c * c * 1e-5, rel=1e-6)
    assert states.P[0, 0] == pytest.approx(placed + 0.04**2 + c * c * 1e-4 + s * s * 1e-5, rel=1e-6)


def test_a_panel_that_seems_nearer_says_nothing_of_the_heading() -> None:
    """Straight ahead it says a heading of 0.2 rad, then of 0; then it is 5 cm nearer: so is the robot, unturned."""

    def from_circle(yaw: float, away_m: float) -> tuple[float, float, float]:
        return 4.0 - away_m * math.cos(yaw), -away_m * math.sin(yaw), yaw

    states = Filter(room(1e-6), (0.0, 0.0))
    states.start(look(1, from_circle(0.2, 4.0), 0.0))
    states.update(states.compare(look(1, from_circle(0.0, 4.0), 0.05)))
    heading = float(states.x[2])
    assert np.allclose(states.x[:2], from_circle(heading, 4.0)[:2], atol=1e-3)
    states.update(states.compare(look(1, from_circle(heading, 3.95), 0.1)))
    assert states.x[2] == pytest.approx(heading, abs=2e-3)


def test_of_two_mirror_poses_the_state_takes_the_one_that_leads() -> None:
    """A heading 0.5 rad aside is excluded by a state that knows it; one that does not takes the place alone."""
    states = Filter(room(), (0.0, 0.0))
    states.start(look(1, (0.0, 0.0, 0.0), 0.0))
    first, second = look(1, (0.0, 0.0, 0.0), 0.05, mirror_rad=0.5), look(1, (0.0, 0.0, 0.5), 0.05, mirror_rad=-0.5)
    object.__setattr__(second, "pose", first.alternate)
    object.__setattr__(second, "alternate", first.pose)
    assert [states.compare(each).error[2] == pytest.approx(0.0, abs=1e-9) for each in (first, second)] == [True, True]
    states.P[:POSE, :POSE] += np.diag([1.0, 1.0, 0.3**2])
    assert len(states.compare(first).error) == 2


def test_a_panel_beyond_four_of_its_deviations_contradicts_the_map() -> None:
    """The map says 1 cm of its place, the look 1 % of its distance."""
    states = Filter(room(), (0.0, 0.0))
    states.start(look(1, (0.0, 0.0, 0.0), 0.0))
    told = []
    for number, value in ((0, 0.039), (0, -0.041), (3, 0.039), (3, 0.041)):
        states.x[FIRST : FIRST + 4] = 0.0
        states.x[FIRST + number] = value
        told.append(states.contradicts_map(1))
    assert told == [False, True, False, True]
