"""The examples for who receives the stream: what they decide and what they pass on."""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

import pytest

from ledpi.wire import FixMessage, NoFix, State, StatusMessage, WirePose

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))
from linux_robot import Guard
from ros2_node import UNKNOWN_VARIANCE, pose_fields

POSE = WirePose(
    position_m=(1.0, 2.0, 0.0), quaternion_wxyz=(0.8, 0.0, 0.0, 0.6), deviation_m=(0.1, 0.2, 0.3), deviation_rad=None
)
FIX = FixMessage(age_us=20_000, pose=POSE, panels_used=1)


def test_a_robot_drives_on_a_young_fix_only() -> None:
    """For 300 ms from the picture on; not before the first fix."""
    guard = Guard()
    assert not guard.may_drive(10.0)
    guard.take(FIX, 10.0)
    assert [guard.may_drive(t) for t in (10.0, 10.27, 10.29)] == [True, True, False]


@pytest.mark.parametrize(("no_fix", "drives"), [(NoFix.NONE, True), (NoFix.NO_PANEL, False), (NoFix.UNKNOWN, False)])
def test_a_status_without_a_fix_stops_it(no_fix: NoFix, drives: bool) -> None:
    """At once."""
    guard = Guard()
    guard.take(FIX, 10.0)
    guard.take(StatusMessage(state=State.RUNNING, no_fix=no_fix), 10.01)
    assert guard.may_drive(10.02) is drives


def test_a_fix_becomes_a_ros_pose() -> None:
    """Stamped when the picture was taken, w last, deviations squared on the diagonal, unknown ones without weight."""
    fields = pose_fields(FIX, 5_000_000_000)
    assert fields.stamp_ns == 4_980_000_000
    assert fields.position_m == (1.0, 2.0, 0.0)
    assert fields.orientation_xyzw == (0.0, 0.0, 0.6, 0.8)
    assert fields.covariance[::7] == pytest.approx([0.01, 0.04, 0.09, *[UNKNOWN_VARIANCE] * 3])
    assert sum(value != 0.0 for value in fields.covariance) == 6


def test_unknown_deviations_of_the_place_have_no_weight() -> None:
    """As those of the rotation."""
    unknown = replace(FIX, pose=replace(POSE, deviation_m=None))
    assert pose_fields(unknown, 0).covariance[::7] == [UNKNOWN_VARIANCE] * 6
