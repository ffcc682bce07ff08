"""The examples for who receives the stream: what they decide and what they pass on."""

from __future__ import annotations

import os
import select
import sys
import time
import tty
from collections.abc import Callable
from dataclasses import astuple, field, make_dataclass, replace
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any

import pytest

from examples.linux_robot import Guard, Narrator, heard
from examples.linux_robot import main as linux_main
from examples.ros2_node import UNKNOWN_VARIANCE, pose_fields
from examples.ros2_node import main as ros2_main
from examples.tap_robot import Wheels, drive, go_through
from ledpi import connect_tap
from ledpi.daemon.tap.protocol import Request
from ledpi.wire import FixMessage, MarkerMessage, Message, NoFix, State, StatusMessage, WirePose
from ledpi.wire.codec import encode
from tests.builders.tap import tap_at

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


@pytest.mark.parametrize(
    ("name", "start"), [("examples/linux_robot.py", linux_main), ("-m examples.ros2_node", ros2_main)]
)
def test_an_example_without_a_port_says_how_it_is_called(
    name: str, start: Callable[[], None], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As whoever tries it first sees it, with a command's status for what was called wrongly."""
    monkeypatch.setattr(sys, "argv", [name])
    with pytest.raises(SystemExit, match="2"):
        start()
    assert f"usage: python {name} PORT" in capsys.readouterr().err


@pytest.mark.parametrize("port", ["/dev/nope", __file__])
def test_what_is_no_port_is_named(
    port: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One that is not there, and a file."""
    monkeypatch.setattr(sys, "argv", ["linux_robot.py", port])
    with pytest.raises(SystemExit, match="2"):
        linux_main()
    assert capsys.readouterr().err.startswith(f"{port}: ")


@pytest.mark.parametrize(("no_fix", "drives"), [(NoFix.NONE, True), (NoFix.NO_PANEL, False), (NoFix.UNKNOWN, False)])
def test_a_status_without_a_fix_stops_it(no_fix: NoFix, drives: bool) -> None:
    """At once."""
    guard = Guard()
    guard.take(FIX, 10.0)
    guard.take(StatusMessage(state=State.RUNNING, no_fix=no_fix), 10.01)
    assert guard.may_drive(10.02) is drives


def test_the_robot_says_why_it_stands_and_no_more_than_a_person_can_read() -> None:
    """A second without a panel is one line with the reason; of a second's drive, three."""
    guard, narrator = Guard(), Narrator()
    guard.take(StatusMessage(state=State.RUNNING, no_fix=NoFix.NO_PANEL), 0.0)
    turns = [narrator.line(f"stop: {guard.why_not()}", "", turn / 100) for turn in range(100)]
    assert [said for said in turns if said] == ["stop: no panel"]
    turns = [narrator.line("drive", "at 1.000 2.000 m", 1.0 + turn / 100) for turn in range(101)]
    assert [said for said in turns if said] == 3 * ["drive at 1.000 2.000 m"]


def test_what_piled_up_while_nobody_read_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """A process that was held up for four seconds finds fixes in the port's buffer that say they are 20 ms old."""
    now_s = iter([0.0, 0.02, 4.02, 4.04])
    monkeypatch.setattr("examples.linux_robot.time", SimpleNamespace(monotonic=lambda: next(now_s)))
    master, slave = os.openpty()
    tty.setraw(slave)
    turns = heard(os.ttyname(slave))
    found = []
    for number in range(4):
        os.write(master, b"\0" + encode(FIX, number))
        select.select([slave], [], [])
        found.append(len(next(turns)[0]))
    assert found == [0, 1, 0, 1]


def test_a_stream_that_stops_is_a_reason_too() -> None:
    """The last status spoke of a fix, and nothing came since."""
    guard = Guard()
    guard.take(StatusMessage(state=State.RUNNING, no_fix=NoFix.NONE), 0.0)
    assert guard.why_not() == "no fix for 0.3 s"


def test_a_robot_on_the_tap_outlives_a_reload(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Between two daemons nobody takes its odometry: it stands, and goes on with the next one."""

    def take(request: Request) -> dict[str, str]:
        state = {"type": "robot_state", "mode": "odometry", "contested": False, "t_ns": time.monotonic_ns()}
        tap.tell_state(state)
        return {}

    class Asked(Wheels):
        """Until it was asked three times there is no daemon."""

        times = 0

        def totals(self) -> dict[str, float]:
            self.times += 1
            if self.times == 3:
                tap.offer("odometry", take)
            return super().totals()

    with tap_at(tmp_path / "tap.sock") as tap, connect_tap(tap.path) as client:
        drive(client, Asked(), go_through([]))
    assert capsys.readouterr().out.endswith("there\n0.000 m/s, 0.000 rad/s\n")


def test_a_fix_becomes_a_ros_pose() -> None:
    """Stamped when the picture was taken, w last, deviations squared on the diagonal, unknown ones without weight."""
    fields = pose_fields(POSE, 20_000, 5_000_000_000)
    assert fields.stamp_ns == 4_980_000_000
    assert fields.position_m == (1.0, 2.0, 0.0)
    assert fields.orientation_xyzw == (0.0, 0.0, 0.6, 0.8)
    assert fields.covariance[::7] == pytest.approx([0.01, 0.04, 0.09, *[UNKNOWN_VARIANCE] * 3])
    assert sum(value != 0.0 for value in fields.covariance) == 6
    assert pose_fields(replace(POSE, deviation_m=None), 0, 0).covariance[::7] == [UNKNOWN_VARIANCE] * 6


def stand_in(name: str, **fields: type) -> Any:
    """A message's class, each field begun by its type: as rclpy's own it refuses another name."""
    return make_dataclass(name, [(key, Any, field(default_factory=of)) for key, of in fields.items()], slots=True)


Xyzw = stand_in("Xyzw", x=float, y=float, z=float, w=float)  # Point, Vector3 and Quaternion
Pose = stand_in("Pose", position=Xyzw, orientation=Xyzw)
PoseWithCovariance = stand_in("PoseWithCovariance", pose=Pose, covariance=list)
Header = stand_in("Header", stamp=int, frame_id=str)
PoseWithCovarianceStamped = stand_in("PoseWithCovarianceStamped", header=Header, pose=PoseWithCovariance)
Transform = stand_in("Transform", translation=Xyzw, rotation=Xyzw)
TransformStamped = stand_in("TransformStamped", header=Header, child_frame_id=str, transform=Transform)


Published = list[tuple[str, Any]]  # topic, message


def ros(published: Published, ends_after: int) -> dict[str, ModuleType]:
    """As much of ROS as the example uses; rclpy is ok until so many messages were published."""

    def publisher(kind: type, name: str, depth: int) -> SimpleNamespace:
        assert (kind, depth) == (PoseWithCovarianceStamped, 10)
        return SimpleNamespace(publish=lambda message: published.append((name, message)))

    node = SimpleNamespace(
        create_publisher=publisher,
        get_clock=lambda: SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=5_000_000_000)),
        declare_parameter=lambda name, default: {"camera_frame": SimpleNamespace(value=default)}[name],
    )
    names = ("rclpy", "rclpy.time", "geometry_msgs", "geometry_msgs.msg", "tf2_ros")
    modules = {name: ModuleType(name) for name in names}
    vars(modules["rclpy"]).update(
        init=lambda: None, create_node=lambda name: node, ok=lambda: len(published) < ends_after
    )
    vars(modules["rclpy.time"]).update(Time=lambda *, nanoseconds: SimpleNamespace(to_msg=lambda: nanoseconds))
    vars(modules["geometry_msgs.msg"]).update(
        PoseWithCovarianceStamped=PoseWithCovarianceStamped, TransformStamped=TransformStamped
    )
    broadcast = SimpleNamespace(sendTransform=lambda message: published.append(("/tf", message)))
    vars(modules["tf2_ros"]).update(TransformBroadcaster=lambda node: broadcast)
    return modules


@pytest.fixture
def publishes(monkeypatch: pytest.MonkeyPatch) -> Callable[..., Published]:
    """Returns what the node publishes of these messages, which come over a pty, until it has published so many."""

    def of(*messages: Message, count: int) -> Published:
        published: Published = []
        for name, module in ros(published, count).items():
            monkeypatch.setitem(sys.modules, name, module)
        master, slave = os.openpty()
        tty.setraw(slave)
        stream = b"\0" + b"".join(encode(message, number) for number, message in enumerate(messages))
        monkeypatch.setattr(sys, "argv", ["ros2_node.py", os.ttyname(slave)])
        monkeypatch.setattr("serial.Serial.reset_input_buffer", lambda line: os.write(master, stream))
        ros2_main()
        os.close(master)
        os.close(slave)
        return published

    return of


def test_the_ros_node_publishes_a_fix(publishes: Callable[..., Published]) -> None:
    """In the map; with stand-ins for ROS, whose fields are those of its own message definitions."""
    ((topic, message),) = publishes(FIX, count=1)
    assert topic == "ledpi/pose"
    assert (message.header.frame_id, message.header.stamp) == ("map", 4_980_000_000)
    assert message.pose.pose.position == Xyzw(1.0, 2.0, 0.0)
    assert astuple(message.pose.pose.orientation) == pytest.approx((0.0, 0.0, 0.6, 0.8), abs=1 / 32767)
    assert len(message.pose.covariance) == 36


PANEL = MarkerMessage(id=7, age_us=20_000, pose=POSE)


def test_the_ros_node_publishes_a_panel_and_its_frame(publishes: Callable[..., Published]) -> None:
    """In the camera's optical frame: where the wire has it, too."""
    (topic, pose), (tf, frame) = publishes(PANEL, count=2)
    assert (topic, tf) == ("ledpi/panel_7", "/tf")
    for message in (pose, frame):
        assert (message.header.frame_id, message.header.stamp) == ("camera_optical_frame", 4_980_000_000)
    assert frame.child_frame_id == "panel_7"
    for at, turned in (astuple(pose.pose.pose), astuple(frame.transform)):
        assert at[:3] == (1.0, 2.0, 0.0)
        assert turned == pytest.approx((0.0, 0.0, 0.6, 0.8), abs=1 / 32767)
    assert pose.pose.covariance[0] == pytest.approx(0.01, rel=0.1)


def test_the_ros_node_publishes_no_uncertain_panel(publishes: Callable[..., Published]) -> None:
    """Neither of two mirror poses, and none without a pose; what comes after them is."""
    mirrored = [replace(PANEL, ambiguous=True), replace(PANEL, ambiguous=True, alternate=True)]
    without = replace(PANEL, pose=None, uncalibrated=True)
    status = StatusMessage(state=State.RUNNING, no_fix=NoFix.NO_MAP)
    ((topic, _),) = publishes(*mirrored, without, status, FIX, count=1)
    assert topic == "ledpi/pose"
