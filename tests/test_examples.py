"""The examples for who receives the stream: what they decide and what they pass on."""

from __future__ import annotations

import os
import sys
import tty
from collections.abc import Callable
from dataclasses import astuple, dataclass, field, replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from ledpi.wire import FixMessage, NoFix, State, StatusMessage, WirePose
from ledpi.wire.codec import encode

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "examples"))
from linux_robot import Guard
from linux_robot import main as linux_main
from ros2_node import UNKNOWN_VARIANCE, pose_fields
from ros2_node import main as ros2_main

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


@pytest.mark.parametrize(("name", "start"), [("linux_robot.py", linux_main), ("ros2_node.py", ros2_main)])
def test_an_example_without_a_port_says_how_it_is_called(
    name: str, start: Callable[[], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    """As whoever tries it first sees it."""
    monkeypatch.setattr(sys, "argv", [name])
    with pytest.raises(SystemExit, match=f"usage: python examples/{name} PORT"):
        start()


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


@dataclass(slots=True)
class Xyzw:
    """geometry_msgs' Point and Quaternion: rclpy's own refuse another name, and what is no float."""

    x: float = 0.0
    y: float = 0.0
    z: float = 0.0
    w: float = 0.0


@dataclass(slots=True)
class Pose:
    position: Xyzw = field(default_factory=Xyzw)
    orientation: Xyzw = field(default_factory=Xyzw)


@dataclass(slots=True)
class PoseWithCovariance:
    pose: Pose = field(default_factory=Pose)
    covariance: list[float] = field(default_factory=list)


@dataclass(slots=True)
class Header:
    stamp: Any = None
    frame_id: str = ""


@dataclass(slots=True)
class PoseWithCovarianceStamped:
    header: Header = field(default_factory=Header)
    pose: PoseWithCovariance = field(default_factory=PoseWithCovariance)


def ros(published: list[PoseWithCovarianceStamped]) -> dict[str, ModuleType]:
    """As much of rclpy as the example uses; it is ok until something was published."""
    topic = SimpleNamespace(publish=published.append)
    now = SimpleNamespace(nanoseconds=5_000_000_000)
    node = SimpleNamespace(
        create_publisher=lambda kind, name, depth: {(PoseWithCovarianceStamped, "ledpi/pose"): topic}[kind, name],
        get_clock=lambda: SimpleNamespace(now=lambda: now),
    )
    rclpy, time, msg = ModuleType("rclpy"), ModuleType("rclpy.time"), ModuleType("geometry_msgs.msg")
    vars(rclpy).update(init=lambda: None, create_node=lambda name: node, ok=lambda: not published, time=time)
    vars(time).update(Time=lambda *, nanoseconds: SimpleNamespace(to_msg=lambda: nanoseconds))
    vars(msg).update(PoseWithCovarianceStamped=PoseWithCovarianceStamped)
    return {"rclpy": rclpy, "rclpy.time": time, "geometry_msgs": ModuleType("geometry_msgs"), "geometry_msgs.msg": msg}


def test_the_ros_node_publishes_what_comes_over_the_line(monkeypatch: pytest.MonkeyPatch) -> None:
    """A fix on a pty, with stand-ins for rclpy: their fields are those of ROS's own message definitions."""
    published: list[PoseWithCovarianceStamped] = []
    for name, module in ros(published).items():
        monkeypatch.setitem(sys.modules, name, module)
    master, slave = os.openpty()
    tty.setraw(slave)
    monkeypatch.setattr(sys, "argv", ["ros2_node.py", os.ttyname(slave)])
    monkeypatch.setattr("serial.Serial.reset_input_buffer", lambda line: os.write(master, b"\0" + encode(FIX, 0)))
    ros2_main()
    os.close(master)
    os.close(slave)
    (message,) = published
    assert (message.header.frame_id, message.header.stamp) == ("map", 4_980_000_000)
    assert message.pose.pose.position == Xyzw(1.0, 2.0, 0.0)
    assert astuple(message.pose.pose.orientation) == pytest.approx((0.0, 0.0, 0.6, 0.8), abs=1 / 32767)
    assert len(message.pose.covariance) == 36
