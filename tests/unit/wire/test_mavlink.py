"""MAVLink: what pymavlink reads of what the daemon writes, against frames worked out by hand."""

from __future__ import annotations

import dataclasses
import itertools
import math
import os
import select
import signal
import sys
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import cv2
import numpy as np
import pytest
from pymavlink.dialects.v20 import common

from ledpi.config.settings import SerialSettings, load_config
from ledpi.core.errors import ConfigError, WireError
from ledpi.core.geometry import (
    CAMERA_LINK_FROM_CAMERA,
    matrix_from_rpy_deg,
    quaternion_from_matrix,
    rpy_deg_from_matrix,
    transform,
)
from ledpi.core.records import Floats, Pose, RobotFix
from ledpi.state.estimator import State as RobotState
from ledpi.wire.mavlink import FRD_FROM_FLU, HEARTBEAT_PERIOD_NS, NED_FROM_ENU, Mavlink, Profile, Resets
from ledpi.wire.mavlink_heard import AutopilotReceiver
from ledpi.wire.message import MarkerMessage, NoFix, State, StatusMessage, fix_message, marker_message
from ledpi.wire.outbox import Outbox
from ledpi.wire.publisher import Publisher
from ledpi.wire.state_message import OdometryMessage, TimeAnswer, TimeAsk, state_message
from ledpi.workshop.doctor.checks import examine
from tests.builders.daemon import SIMULATED, daemon, end
from tests.builders.waiting import wait_until
from tests.builders.wire import decoded, marker_pose, robot_fix

STATE = RobotState(
    t_ns=8_000_000,
    pose=np.zeros(3),
    covariance=np.eye(3),
    speed_m_s=0.5,
    turn_rad_s=0.2,
    panel_ns=0,
    way_m=0.0,
    by_odometry=True,
    panels=1,
    contested=False,
    moved=(),
    relocalisations=0,
    mount_rad=np.zeros((2, 3)),
    events=(),
)
FACING = np.array([0.0, 1.0, 0.0, 0.0])  # a panel that hangs upright and faces the camera


def codec(
    rpy_deg: tuple[float, float, float] = (0, 0, 0),
    position_m: tuple[float, float, float] = (0, 0, 0),
    profile: Profile = "ardupilot",
) -> Mavlink:
    rotation = matrix_from_rpy_deg(*rpy_deg) @ CAMERA_LINK_FROM_CAMERA
    return Mavlink(base_link_from_camera=transform(rotation, np.array(position_m)), profile=profile)


def parse(packet: bytes | None) -> Any:
    """The one message that pymavlink finds in these bytes."""
    assert packet is not None
    (message,) = common.MAVLink(None).parse_buffer(packet)
    assert message.get_type() != "BAD_DATA"
    return message


def marker_at(*camera_m: float, marker_id: int = 7, ambiguous: bool = False) -> MarkerMessage:
    pose = Pose(position_m=np.array(camera_m), quaternion_wxyz=FACING)
    return marker_message(marker_pose(marker_id, 0, pose=pose, ambiguous=ambiguous), age_us=2000)


def fix_at(
    position_m: tuple[float, float, float],
    rpy_deg: tuple[float, float, float] = (0, 0, 0),
    covariance: Floats | None = None,
) -> RobotFix:
    quaternion = quaternion_from_matrix(matrix_from_rpy_deg(*rpy_deg))
    pose = Pose(position_m=np.array(position_m), quaternion_wxyz=quaternion, covariance=covariance)
    return RobotFix(map_from_base_link=pose, mid_exposure_ns=0, panels_used=(7,))


def send_fix(mavlink: Mavlink, fix: RobotFix, first_byte_ns: int = 10_000_000) -> Any:
    return parse(mavlink.encode(fix_message(fix, age_us=2000), first_byte_ns))


def test_a_panel_straight_ahead() -> None:
    """1 m in front of a camera that looks ahead: x is 1 in the body's frame; the time is that of the picture."""
    target = parse(codec().encode(marker_at(0, 0, 1), 10_000_000))
    assert target.get_type() == "LANDING_TARGET"
    assert (target.target_num, target.frame, target.position_valid) == (7, common.MAV_FRAME_BODY_FRD, 1)
    assert target.type == common.LANDING_TARGET_TYPE_VISION_FIDUCIAL
    assert (target.x, target.y, target.z) == pytest.approx((1, 0, 0), abs=1e-6)
    assert (target.angle_x, target.angle_y, target.distance) == pytest.approx((0, 0, 1), abs=1e-6)
    assert target.q == pytest.approx((0.5, -0.5, -0.5, 0.5), abs=1e-6)  # its x is our right, its y up, its z astern
    assert target.time_usec == 10_000 - 2000


def test_a_panel_to_the_right_of_a_camera_off_the_centre() -> None:
    """1 m ahead and 1 m right of a camera that sits 0.1 m ahead, 0.2 m left and 0.3 m above the vehicle's centre."""
    target = parse(codec(position_m=(0.1, 0.2, 0.3)).encode(marker_at(1, 0, 1), 10_000_000))
    assert (target.x, target.y, target.z) == pytest.approx((1.1, 0.8, -0.3), abs=1e-6)
    assert (target.angle_x, target.angle_y) == pytest.approx((math.pi / 4, 0), abs=1e-6)
    assert target.distance == pytest.approx(math.sqrt(1.21 + 0.64 + 0.09), abs=1e-6)


def test_a_panel_below_a_camera_that_looks_down() -> None:
    """0.2 m ahead, 0.5 m right and 2 m below; ArduPilot reads (−tan angle_y, tan angle_x, 1) as ahead, right, down."""
    target = parse(codec(rpy_deg=(0, 90, 0)).encode(marker_at(0.5, -0.2, 2), 10_000_000))
    assert (target.x, target.y, target.z) == pytest.approx((0.2, 0.5, 2), abs=1e-6)
    assert (-math.tan(target.angle_y), math.tan(target.angle_x)) == pytest.approx((0.1, 0.25), abs=1e-6)


def test_px4_gets_the_tangents_of_a_panel_below() -> None:
    """PX4 refuses positions in the body's frame; the two angles' fields are tangents to it, ahead and right."""
    down = codec(rpy_deg=(0, 90, 0), profile="px4")
    target = parse(down.encode(marker_at(0.5, -0.2, 2), 10_000_000))
    assert (target.angle_x, target.angle_y, target.position_valid) == pytest.approx((0.1, 0.25, 0), abs=1e-6)


@pytest.mark.parametrize("rpy_deg", [(0, 0, 0), (0, -90, 0)])
def test_px4_gets_no_panel_that_is_not_below(rpy_deg: tuple[float, float, float]) -> None:
    """PX4 meets the direction with the ground: a panel ahead or above is not there."""
    assert codec(rpy_deg=rpy_deg, profile="px4").encode(marker_at(0, 0, 1), 10_000_000) is None


def test_an_ambiguous_panel_has_a_place_but_no_attitude() -> None:
    """The likelier place is sent, once, with MAVLink's zero quaternion for unknown."""
    target = parse(codec().encode(marker_at(0, 0, 1, ambiguous=True), 10_000_000))
    assert (target.x, target.q) == (pytest.approx(1), [0, 0, 0, 0])
    other = marker_message(marker_pose(7, 0, ambiguous=True), age_us=0, alternate=True)
    assert codec().encode(other, 10_000_000) is None


def test_an_id_that_does_not_fit_is_refused() -> None:
    """Cut to a byte, 256 would be panel 0."""
    assert parse(codec().encode(marker_at(0, 0, 1, marker_id=255), 10_000_000)).target_num == 255
    assert (
        codec().encode(marker_at(0, 0, 1, marker_id=60000), 10_000_000) is None
    )  # a body, of which MAVLink knows none
    with pytest.raises(WireError, match="marker 256"):
        codec().encode(marker_at(0, 0, 1, marker_id=256), 10_000_000)


@pytest.mark.parametrize(
    ("rpy_deg", "ned_rpy_deg"),
    [
        ((0, 0, 0), (0, 0, 90)),  # faces east
        ((0, 0, 90), (0, 0, 0)),  # faces north
        ((5, -10, 0), (5, 10, 90)),  # left side up by 5°, nose up by 10°
        ((0, 0, 180), (0, 0, -90)),  # faces west
    ],
)
def test_a_fix_in_the_local_frame(rpy_deg: tuple[float, float, float], ned_rpy_deg: tuple[float, float, float]) -> None:
    """1 m east, 2 m north, 3 m up of the map's origin."""
    fix = send_fix(codec(), fix_at((1, 2, 3), rpy_deg))
    assert fix.get_type() == "VISION_POSITION_ESTIMATE"
    assert fix.usec == 10_000 - 2000
    assert (fix.x, fix.y, fix.z) == pytest.approx((2, 1, -3), abs=1e-6)
    assert np.degrees([fix.roll, fix.pitch, fix.yaw]) == pytest.approx(ned_rpy_deg, abs=1e-4)


def test_the_covariance_row_by_row() -> None:
    """Facing north, the map's east axis is pitch, its north axis roll; down and right turns change the signs."""
    covariance = np.diag([1.0, 2, 3, 4, 5, 6])
    covariance[0, 2] = covariance[2, 0] = 0.3  # east and up
    covariance[0, 5] = covariance[5, 0] = 0.7  # east and a turn to the left
    got = send_fix(codec(), fix_at((0, 0, 0), (0, 0, 90), covariance * 1e-4)).covariance
    # fmt: off
    rows = [2, 0,    0, 0, 0,    0,
               1, -0.3, 0, 0, -0.7,
                     3, 0, 0,    0,
                        5, 0,    0,
                           4,    0,
                                 6]
    # fmt: on
    assert np.array(got) == pytest.approx(np.array(rows) * 1e-4, abs=1e-10)


def test_the_angles_covariance_follows_the_attitude() -> None:
    """Against the change of roll, pitch and yaw when a tilted robot is turned a little about each of the map's axes."""
    tilted = (20.0, 35.0, 50.0)
    rotation = matrix_from_rpy_deg(*tilted)

    def angles(turn: Floats) -> Floats:
        ned = NED_FROM_ENU @ cv2.Rodrigues(turn)[0] @ rotation @ FRD_FROM_FLU
        return np.radians(rpy_deg_from_matrix(ned))

    step = 1e-6
    slope = np.column_stack([(angles(step * axis) - angles(-step * axis)) / (2 * step) for axis in np.eye(3)])
    covariance = np.diag([0, 0, 0, 1.0, 2.0, 3.0]) * 1e-4
    wanted = slope @ covariance[3:, 3:] @ slope.T
    got = send_fix(codec(), fix_at((0, 0, 0), tilted, covariance)).covariance
    assert got[15:] == pytest.approx(wanted[np.triu_indices(3)], rel=1e-4, abs=1e-9)


@pytest.mark.parametrize("covariance", [None, np.full((6, 6), np.nan), np.diag([1e40] * 6)])
def test_an_unknown_covariance_begins_with_nan(covariance: Floats | None) -> None:
    """As MAVLink has it; the others are zero, for ArduPilot adds some of them up."""
    first, *others = send_fix(codec(), fix_at((0, 0, 0), covariance=covariance)).covariance
    assert math.isnan(first)
    assert others == [0.0] * 20


@pytest.mark.parametrize(
    ("second", "jumps"),
    [
        (fix_at((0.6, 0, 0)), 0),  # 6 m/s for 0.1 s
        (fix_at((1.6, 0, 0)), 1),  # more than 0.5 m and 10 m/s for 0.1 s
        (fix_at((0, 0, 0), (0, 0, 60)), 0),
        (fix_at((0, 0, 0), (0, 0, 90)), 1),  # more than 30° and a turn a second for 0.1 s
    ],
)
def test_the_reset_counter_goes_up_where_a_fix_jumps(second: RobotFix, jumps: int) -> None:
    """Further than a robot can have gone since the last; it does not go down again."""
    mavlink = codec()
    assert send_fix(mavlink, fix_at((0, 0, 0))).reset_counter == 0
    assert send_fix(mavlink, second, 110_000_000).reset_counter == jumps
    assert send_fix(mavlink, second, 210_000_000).reset_counter == jumps


def test_the_reset_counter_outlives_a_reload() -> None:
    """A new codec goes on counting, and another map counts, too."""
    resets = Resets(jumps=254, maps=1)
    mavlink = Mavlink(base_link_from_camera=np.eye(4), profile="ardupilot", resets=resets)
    for x_m, counter in [(0.0, 255), (5.0, 0)]:
        message = fix_message(fix_at((x_m, 0, 0)), age_us=2000, map_resets=resets.maps)
        assert parse(mavlink.encode(message, 10_000_000)).reset_counter == counter


@pytest.mark.parametrize(
    ("state", "no_fix", "system_status"),
    [
        (State.STARTING, NoFix.NO_PANEL, common.MAV_STATE_BOOT),
        (State.RUNNING, NoFix.NO_PANEL, common.MAV_STATE_ACTIVE),
        (State.RUNNING, NoFix.BEHIND, common.MAV_STATE_CRITICAL),  # no pose comes that could be used
        (State.CAMERA_LOST, NoFix.NO_PANEL, common.MAV_STATE_CRITICAL),
        (State.STOPPING, NoFix.NO_PANEL, common.MAV_STATE_POWEROFF),
    ],
)
def test_the_heartbeat_is_that_of_an_onboard_controller(state: State, no_fix: NoFix, system_status: int) -> None:
    """Part of the vehicle, no autopilot; it says how the daemon does."""
    heartbeat = parse(codec().encode(StatusMessage(state=state, no_fix=no_fix), 0))
    assert heartbeat.get_type() == "HEARTBEAT"
    assert (heartbeat.type, heartbeat.autopilot) == (common.MAV_TYPE_ONBOARD_CONTROLLER, common.MAV_AUTOPILOT_INVALID)
    assert heartbeat.system_status == system_status
    assert (heartbeat.get_srcSystem(), heartbeat.get_srcComponent()) == (1, common.MAV_COMP_ID_VISUAL_INERTIAL_ODOMETRY)


def test_a_heartbeat_is_due_once_a_second() -> None:
    """Not five times, as our own protocol's."""
    outbox = Outbox(max_age_ms=100.0, status_period_ns=HEARTBEAT_PERIOD_NS)
    sent_ns = [now for now in range(0, 3_000_000_001, 10_000_000) if outbox.take(now) is not None]
    assert sent_ns == [0, 1_000_000_000, 2_000_000_000, 3_000_000_000]


def test_packets_are_numbered_without_a_gap() -> None:
    """Also where a message was not for MAVLink, or a packet was not sent; 255 is followed by 0."""
    mavlink = codec()
    numbers = []
    for n in range(300):
        assert mavlink.encode(MarkerMessage(id=n, age_us=0, pose=None, uncalibrated=True), 0) is None
        mavlink.encode(marker_at(0, 0, 1), 10_000_000)  # held up, so that it is made again
        numbers.append(parse(mavlink.encode(marker_at(0, 0, 1), 10_000_000)).get_seq())
        mavlink.count_sent()
    assert all((b - a) % 256 == 1 for a, b in itertools.pairwise(numbers))


class Autopilot:
    """The far end of a pty, where pymavlink listens."""

    def __init__(self) -> None:
        self._master, self._slave = os.openpty()
        tty.setraw(self._master)
        self.path = os.ttyname(self._slave)
        self._parser = common.MAVLink(None)
        self._parser.robust_parsing = True  # a byte that is none of a packet is passed over, as an autopilot does
        self.messages: list[Any] = []

    def read_until(self, condition: Callable[[], bool]) -> None:
        wait_until(condition, meanwhile=self._read)

    def _read(self) -> None:
        if select.select([self._master], [], [], 0.02)[0]:
            self.messages += self._parser.parse_buffer(os.read(self._master, 4096)) or []

    def say(self, *packets: bytes) -> None:
        os.write(self._master, b"".join(packets))

    def of(self, kind: str) -> list[Any]:
        return [message for message in self.messages if message.get_type() == kind]

    def close(self) -> None:
        os.close(self._master)
        os.close(self._slave)


@contextmanager
def line(**settings: Any) -> Iterator[tuple[Autopilot, Publisher]]:
    """A publisher that speaks MAVLink, and who listens."""
    autopilot = Autopilot()
    publisher = Publisher(SerialSettings(port=autopilot.path, protocol="mavlink", **settings), codec())
    publisher.start()
    try:
        autopilot.read_until(lambda: bool(autopilot.of("HEARTBEAT")))
        yield autopilot, publisher
    finally:
        publisher.stop()
        autopilot.close()


def test_poses_arrive_over_the_line_with_the_fix_first() -> None:
    """One frame with two panels and a fix, all of one picture's time on this machine's monotonic clock.

    An ID that does not fit is counted, and the line goes on; the daemon's end is told.
    """
    with line() as (autopilot, publisher):
        mid_ns = time.monotonic_ns() - 5_000_000
        markers = (marker_pose(marker_id, mid_ns) for marker_id in (3, 256, 9))
        publisher.publish(decoded(*markers, robot=robot_fix(mid_ns, x=4.0)))
        autopilot.read_until(lambda: len(autopilot.of("LANDING_TARGET")) == 2)
        poses = [message for message in autopilot.messages if message.get_type() not in ("HEARTBEAT", "BAD_DATA")]
        assert [message.get_type() for message in poses] == [
            "VISION_POSITION_ESTIMATE",
            "LANDING_TARGET",
            "LANDING_TARGET",
        ]
        assert [message.target_num for message in poses[1:]] == [3, 9]
        assert poses[0].y == pytest.approx(4.0)
        times_us = [poses[0].usec, poses[1].time_usec, poses[2].time_usec]
        assert times_us == pytest.approx([mid_ns / 1000] * 3, abs=2)
        assert publisher.counters.refused == 1
        publisher.stop()
        autopilot.read_until(lambda: autopilot.of("HEARTBEAT")[-1].system_status == common.MAV_STATE_POWEROFF)


def test_the_autopilot_learns_our_clock() -> None:
    """It asks among other packets, one of them damaged; an answer of another and an echo are not answered.

    By question and answer it knows our clock within half of the time between.
    """
    other = common.MAVLink(None, srcSystem=1, srcComponent=1)
    attitude = common.MAVLink_attitude_message(0, 0, 0, 0, 0, 0, 0).pack(other)
    with line() as (autopilot, _):
        asked_ns = time.monotonic_ns()
        question = common.MAVLink_timesync_message(0, asked_ns).pack(other)
        damaged = bytes([*question[:-1], question[-1] ^ 1])
        answered = common.MAVLink_timesync_message(5, 7).pack(other)
        autopilot.say(b"\xfd\x10\x00", damaged, attitude, answered, question[:9])
        autopilot.say(question[9:], attitude)
        autopilot.read_until(lambda: bool(autopilot.of("TIMESYNC")))
        came_ns = time.monotonic_ns()
        autopilot.say(b"".join(bytes(message.get_msgbuf()) for message in autopilot.of("TIMESYNC")))
        autopilot.say(common.MAVLink_timesync_message(0, asked_ns + 1).pack(other))
        autopilot.read_until(lambda: len(autopilot.of("TIMESYNC")) > 1)
    first, second = autopilot.of("TIMESYNC")
    assert (first.ts1, second.ts1) == (asked_ns, asked_ns + 1)
    assert asked_ns < first.tc1 < came_ns + 1e6  # the time at which it is to leave, as expected of packets before


def test_the_state_goes_out_as_odometry_in_place_of_fixes() -> None:
    """1 m east, 2 m north, facing west, 0.5 m/s ahead, turning left; its covariance with all three correlations.

    ArduPilot takes LOCAL_FRD alone. Without a state nothing is said.
    """
    covariance = np.array([[0.04, 0.006, 0.002], [0.006, 0.01, -0.001], [0.002, -0.001, 0.0025]])
    state = dataclasses.replace(STATE, pose=np.array([1.0, 2.0, math.pi]), covariance=covariance, relocalisations=3)
    frames, heights = {}, {}
    for profile in ("ardupilot", "px4"):
        mavlink = Mavlink(base_link_from_camera=np.eye(4), profile=profile, tells_state=True)
        assert mavlink.encode(fix_message(fix_at((1, 2, 3)), age_us=2000), 10_000_000) is None
        assert mavlink.encode(state_message(None, clock_us=None), 10_000_000) is None
        told = parse(mavlink.encode(state_message(state, clock_us=None, map_resets=2), 10_000_000))
        frames[profile], heights[profile] = told.frame_id, told.pose_covariance[11]
    assert frames == {"ardupilot": common.MAV_FRAME_LOCAL_FRD, "px4": common.MAV_FRAME_LOCAL_NED}
    assert (told.get_type(), told.child_frame_id) == ("ODOMETRY", common.MAV_FRAME_BODY_FRD)
    assert told.time_usec == 8000
    assert (told.x, told.y, told.z) == pytest.approx((2, 1, 0), abs=1e-6)
    assert np.abs(told.q) == pytest.approx([math.sqrt(0.5), 0, 0, math.sqrt(0.5)], abs=1e-6)
    assert told.q[0] * told.q[3] < 0  # −90°: west
    assert (told.vx, told.vy, told.yawspeed) == pytest.approx((0.5, 0, -0.2))
    upper = np.zeros((6, 6))
    upper[np.triu_indices(6)] = told.pose_covariance
    north_east_right = upper[np.ix_([0, 1, 5], [0, 1, 5])]
    expected = np.array([[0.01, 0.006, 0.001], [0, 0.04, -0.002], [0, 0, 0.0025]])
    np.testing.assert_allclose(north_east_right, expected, atol=1e-4)
    assert heights == pytest.approx({"ardupilot": 0.04, "px4": 1.0}, abs=1e-4)  # one deviation of all axes to the first
    assert math.isnan(told.velocity_covariance[0])


def test_a_state_that_begins_anew_is_a_reset() -> None:
    """In its first message, after none, where it turns out to be elsewhere, and in another map; not in between."""
    mavlink = Mavlink(base_link_from_camera=np.eye(4), profile="px4", tells_state=True)
    elsewhere = dataclasses.replace(STATE, relocalisations=1)
    states = [(STATE, 0), (STATE, 0), (None, 0), (STATE, 0), (elsewhere, 0), (elsewhere, 0), (STATE, 1), (STATE, 1)]
    sent = [mavlink.encode(state_message(of, clock_us=None, map_resets=maps), 10_000_000) for of, maps in states]
    assert [parse(packet).reset_counter for packet in sent if packet] == [1, 1, 2, 3, 3, 4, 4]
    further = [mavlink.encode(state_message(STATE, clock_us=None, map_resets=2 + k), 10_000_000) for k in range(253)]
    assert [parse(packet).reset_counter for packet in further if packet][-3:] == [255, 0, 1]  # a byte


def test_an_autopilot_s_wheels_and_rate_of_turn_are_odometry() -> None:
    """A turn to the right at 0.5 rad/s for a second: −0.5 rad, told with each wheel's way. Without wheels by itself.

    Its wheels' stamps are of 32 bits, as a Rover's, and wrap meanwhile. Its pose, another part's packets, and another
    vehicle's are not read. It answers with its clock.
    """
    autopilot, gimbal, other = (
        common.MAVLink(None, srcSystem=s, srcComponent=c) for s, c in ((1, 1), (1, 154), (2, 1))
    )
    heard = AutopilotReceiver(common, system=1)
    said: list[bytes] = []
    for ms in range(5000, 6001, 50):
        boot_ms = 4_289_500 + ms
        attitude = common.MAVLink_attitude_message(boot_ms, 0, 0, 2.0, 0, 0, 0.5)
        wrong = common.MAVLink_attitude_message(boot_ms, 0, 0, 0, 0, 0, 9.0)
        stamp_us = (1000 * boot_ms + 10_000) % 2**32
        wheels = common.MAVLink_wheel_distance_message(stamp_us, 2, [0.001 * ms, 0.002 * ms, *[0.0] * 14])
        pose = common.MAVLink_local_position_ned_message(ms, 9, 9, 9, 9, 9, 9)
        said += [attitude.pack(autopilot), wrong.pack(gimbal), wrong.pack(other), pose.pack(autopilot)]
        said += [wheels.pack(autopilot)] if ms >= 5500 else []
    line = b"\xfd\x00" + b"".join(said)
    told = [message for at in range(0, len(line), 7) for message in heard.feed(line[at : at + 7])]
    assert all(isinstance(message, OdometryMessage) for message in told)
    first, *_, last = (message for message in told if isinstance(message, OdometryMessage))
    assert (first.clock_us, first.left_100um, first.yaw_100urad, first.restarted) == (4_294_500_000, None, 0, True)
    assert (last.clock_us, last.left_100um, last.right_100um) == (542_704, 60_000, 120_000)
    assert (last.yaw_100urad, last.restarted) == (-5050, False)
    assert len(told) == 11 + 11
    wild = [common.MAVLink_wheel_distance_message(0, 2, [1e306, 0.0, *[0.0] * 14]).pack(autopilot)]
    wild += [common.MAVLink_attitude_message(4_300_000, 0, 0, 0, 0, 0, 3e30).pack(autopilot)]
    assert heard.feed(b"".join(wild)) == []
    asked = parse(codec().encode(TimeAsk(number=4711), 123_456_789_012))
    assert asked.tc1 == 0
    answered = common.MAVLink_timesync_message(7_000_000_000, asked.ts1).pack(autopilot)
    assert heard.feed(answered) == [TimeAnswer(number=4711, arrived_us=7_000_000, left_us=7_000_000)]


def test_a_rate_that_looks_older_than_its_wheels_does_not_take_their_place() -> None:
    """An autopilot that stamps wheels in microseconds, and its attitude in whole milliseconds."""
    autopilot, heard, told = common.MAVLink(None, srcSystem=1, srcComponent=1), AutopilotReceiver(common, system=1), []
    for ms in range(1000, 2000, 20):
        wheels = common.MAVLink_wheel_distance_message(1000 * ms + 300, 2, [0.001 * ms, 0.001 * ms, *[0.0] * 14])
        attitude = common.MAVLink_attitude_message(ms, 0, 0, 0, 0, 0, 0.1)
        told += heard.feed(wheels.pack(autopilot) + attitude.pack(autopilot))
    assert len(told) == 50
    assert all(isinstance(message, OdometryMessage) and message.left_100um is not None for message in told)


def test_without_pymavlink_the_codec_says_how_to_install_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """One line with the key and the remedy."""
    monkeypatch.setitem(sys.modules, "pymavlink.dialects.v20", None)
    with pytest.raises(ConfigError, match=r"serial.protocol: mavlink needs pymavlink.*pip install 'ledpi\[mavlink\]'"):
        codec()


@pytest.mark.slow
def test_without_pymavlink_doctor_says_that_the_daemon_would_not_run(monkeypatch: pytest.MonkeyPatch) -> None:
    """With the same words as the daemon's, and a remedy."""
    settings = ("panels.side_m=0.16", "camera.source=simulated", "serial.protocol=mavlink")
    monkeypatch.setitem(sys.modules, "pymavlink.dialects.v20", None)
    (finding,) = [f for f in examine(load_config(None, settings)) if f.name == "mavlink"]
    assert finding.stops_daemon
    assert "pip install 'ledpi[mavlink]'" in finding.said


@pytest.mark.slow
def test_the_daemon_speaks_mavlink() -> None:
    """The simulated drive's two panels, ahead of the vehicle; its last word is power off."""
    autopilot = Autopilot()
    with daemon(
        *SIMULATED, "serial.protocol=mavlink", "serial.mavlink_system=9", f"serial.port={autopilot.path}"
    ) as process:
        autopilot.read_until(lambda: {target.target_num for target in autopilot.of("LANDING_TARGET")} == {7, 23})
        ended = end(process, signal.SIGTERM)
        autopilot.read_until(lambda: autopilot.of("HEARTBEAT")[-1].system_status == common.MAV_STATE_POWEROFF)
    autopilot.close()
    assert ended.status == 0
    assert all(0.5 < target.x < 3.0 and target.position_valid for target in autopilot.of("LANDING_TARGET"))
    assert {message.get_srcSystem() for message in autopilot.of("HEARTBEAT")} == {9}
