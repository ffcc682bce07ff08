"""Messages → MAVLink 2, in the frames that autopilots expect, by pymavlink's own packer. Knows neither clock nor port.

Frames: the vehicle's body is FRD (x ahead, y right, z down), the local frame NED (x north, y east, z down); a map is
ENU (x east, y north, z up; REP-103). docs/mavlink.md says what ArduPilot and PX4 do with each field.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

import numpy as np

from ledpi.core.errors import ConfigError, WireError, install_command
from ledpi.core.geometry import matrix_from_quaternion, matrix_from_rpy_deg, quaternion_from_matrix, rpy_deg_from_matrix
from ledpi.core.records import Floats, PanelMap
from ledpi.pose.bodies import FIRST_ID as FIRST_BODY_ID
from ledpi.wire.mavlink_heard import TimeQuestions, own_component
from ledpi.wire.message import FixMessage, MarkerMessage, Message, NoFix, State, StatusMessage, SyncAnswer
from ledpi.wire.state_message import U16, StateMessage, TimeAsk

Profile: TypeAlias = Literal["ardupilot", "px4"]

HEARTBEAT_PERIOD_NS = 1_000_000_000  # once a second, as https://mavlink.io/en/services/heartbeat.html says
# A fix has jumped where no robot of a room could have moved so far since the last: a step for the noise of a poor fix,
# and the fastest indoor drones' speeds.
JUMP_M, JUMP_M_S = 0.5, 10.0
JUMP_RAD, JUMP_RAD_S = math.radians(30.0), 2.0 * math.pi
# PX4 meets a target's direction with the ground. Nearer to the horizon a degree of tilt is more than a tenth of the
# height, and a panel above has no such point at all.
PX4_STEEPEST_TANGENT = math.tan(math.radians(60.0))

# A floor that a robot drives on may be a slope; a storey above the map's origin is another map.
FLOOR_M, FLOOR_RAD = 1.0, math.radians(5.0)
_PLANE = [0, 1, 5]  # x, y, yaw among x, y, z, roll, pitch, yaw

NED_FROM_ENU = np.array([[0.0, 1, 0], [1, 0, 0], [0, 0, -1]])
FRD_FROM_FLU = np.diag([1.0, -1, -1])


def load_dialect(key: str = "serial.protocol") -> Any:
    """pymavlink's module of MAVLink 2's common messages. Raises ConfigError where it is not installed.

    `key`: of the configuration, which asks for it.
    """
    try:
        from pymavlink.dialects.v20 import common
    except ImportError:
        raise ConfigError(
            f"{key}: mavlink needs pymavlink, which is not installed: {install_command('mavlink')}"
        ) from None
    return common


class Mavlink:
    """Encodes what an Outbox gives. Holds the packets' number, and the last fix to see where one has jumped."""

    def __init__(
        self,
        *,
        base_link_from_camera: Floats,
        profile: Profile,
        system: int = 1,
        resets: Resets | None = None,
        tells_state: bool = False,
    ) -> None:
        """`system`: the vehicle's, of which we are a part. `resets`: where jumps are counted, also those before.

        `tells_state`: in place of the fixes, which are in it. Raises ConfigError without pymavlink.
        """
        self._dialect = load_dialect()
        component = own_component(self._dialect)
        self._packer: Any = self._dialect.MAVLink(None, srcSystem=system, srcComponent=component)
        self._tells_state = tells_state
        self.questions = TimeQuestions(self._dialect)
        self._frd_from_camera = FRD_FROM_FLU @ base_link_from_camera[:3]
        self._profile = profile
        self._last_fix: tuple[int, Floats, Floats] | None = None  # when in µs, position, rotation
        self._resets = resets or Resets()
        self._told: tuple[int, int] | None = None  # relocalisations and maps of the state that was told last

    def encode(self, message: Message, first_byte_ns: int) -> bytes | None:
        """A whole packet; None where MAVLink, or the autopilot, has no place for this.

        `first_byte_ns` is the moment that `age_us` runs to. Raises WireError for what must not be sent.
        """
        match message:
            case MarkerMessage():
                fields = self._landing_target(message, _picture_us(first_byte_ns, message.age_us))
            case FixMessage() if not self._tells_state:
                fields = self._vision_position(message, _picture_us(first_byte_ns, message.age_us))
            case StatusMessage():
                fields = self._heartbeat(message)
            case StateMessage():
                fields = self._odometry(message)
            case TimeAsk():  # its number is in the lowest bits of the time, which comes back as it is
                fields = self._dialect.MAVLink_timesync_message(0, first_byte_ns & ~U16 | message.number)
            case SyncAnswer():  # the middle of its stay here, so that it does not matter how long that was
                held_ns = (message.arrived_ns + first_byte_ns) // 2
                fields = self._dialect.MAVLink_timesync_message(held_ns, message.asked_ns)
            case _:
                return None
        if fields is None:
            return None
        return bytes(fields.pack(self._packer))

    def count_sent(self) -> None:
        """The packet that was encoded last has gone out: the next has the next number."""
        self._packer.seq = (self._packer.seq + 1) % 256

    def continue_after(self, other: Mavlink) -> None:
        """Goes on with the other's packet number."""
        self._packer.seq = other._packer.seq

    def _heartbeat(self, status: StatusMessage) -> Any:
        d = self._dialect
        states = {
            State.STARTING: d.MAV_STATE_BOOT,
            State.RUNNING: d.MAV_STATE_ACTIVE,
            State.CAMERA_LOST: d.MAV_STATE_CRITICAL,
            State.STOPPING: d.MAV_STATE_POWEROFF,
        }
        state = states.get(status.state, d.MAV_STATE_UNINIT)
        if status.no_fix is NoFix.BEHIND:  # to an autopilot that is the same: no pose comes
            state = d.MAV_STATE_CRITICAL
        return d.MAVLink_heartbeat_message(d.MAV_TYPE_ONBOARD_CONTROLLER, d.MAV_AUTOPILOT_INVALID, 0, 0, state, 3)

    def _landing_target(self, marker: MarkerMessage, picture_us: int) -> Any:
        if marker.pose is None or marker.alternate or marker.id >= FIRST_BODY_ID:
            return None
        if marker.id > 0xFF:
            raise WireError(f"marker {marker.id}: LANDING_TARGET's target_num holds 0 to 255")
        in_camera = np.array(marker.pose.position_m)
        x, y, z = (float(v) for v in self._frd_from_camera @ [*in_camera, 1.0])
        distance_m = math.hypot(x, y, z)
        kind = self._dialect.LANDING_TARGET_TYPE_VISION_FIDUCIAL
        if self._profile == "px4":
            if math.hypot(x, y) > PX4_STEEPEST_TANGENT * z:
                return None
            return self._dialect.MAVLink_landing_target_message(
                picture_us, marker.id, self._dialect.MAV_FRAME_BODY_FRD, x / z, y / z, distance_m, 0, 0, type=kind
            )
        angle_x, angle_y = (math.atan2(v, in_camera[2]) for v in in_camera[:2])
        turned = quaternion_from_matrix(
            self._frd_from_camera[:, :3] @ matrix_from_quaternion(np.array(marker.pose.quaternion_wxyz))
        )
        return self._dialect.MAVLink_landing_target_message(
            picture_us,
            marker.id,
            self._dialect.MAV_FRAME_BODY_FRD,
            angle_x,
            angle_y,
            distance_m,
            0,
            0,
            x,
            y,
            z,
            [0.0] * 4 if marker.ambiguous else turned.tolist(),
            kind,
            1,
        )

    def _vision_position(self, fix: FixMessage, picture_us: int) -> Any:
        map_from_base_link = matrix_from_quaternion(np.array(fix.pose.quaternion_wxyz))
        rotation = NED_FROM_ENU @ map_from_base_link @ FRD_FROM_FLU
        position_m = NED_FROM_ENU @ np.array(fix.pose.position_m)
        self._count_jump(picture_us, position_m, rotation)
        return self._dialect.MAVLink_vision_position_estimate_message(
            picture_us,
            *position_m.tolist(),
            *(math.radians(angle) for angle in rpy_deg_from_matrix(rotation)),
            _upper_triangle(fix.pose.covariance, rotation),
            (self._resets.jumps + fix.map_resets) % 256,
        )

    def _odometry(self, state: StateMessage) -> Any:
        """The state in the plane; of height, roll and pitch it knows no more than that the robot stands on a floor."""
        if state.position_m is None or state.t_ns is None:
            self._told = None  # and where it is next is another beginning
            return None
        told = state.relocalisations, state.map_resets
        self._resets.jumps += told != self._told
        self._told = told
        assert state.yaw_rad is not None
        assert state.velocity is not None
        rotation = NED_FROM_ENU @ matrix_from_rpy_deg(0.0, 0.0, math.degrees(state.yaw_rad)) @ FRD_FROM_FLU
        frames = self._dialect.MAV_FRAME_LOCAL_NED, self._dialect.MAV_FRAME_LOCAL_FRD
        return self._dialect.MAVLink_odometry_message(
            state.t_ns // 1000,
            frames[self._profile == "ardupilot"],  # which takes no other, and takes it for north, east and down
            self._dialect.MAV_FRAME_BODY_FRD,
            *(NED_FROM_ENU @ [*state.position_m, 0.0]).tolist(),
            quaternion_from_matrix(rotation).tolist(),
            *(state.velocity[0], 0.0, 0.0),
            *(0.0, 0.0, -state.velocity[1]),
            _upper_triangle(_in_space(state, self._profile), rotation),
            _UNKNOWN,
            self._resets.jumps % 256,
            self._dialect.MAV_ESTIMATOR_TYPE_VISION,
        )

    def _count_jump(self, picture_us: int, position_m: Floats, rotation: Floats) -> None:
        if self._last_fix is not None:
            last_us, last_position_m, last_rotation = self._last_fix
            seconds = abs(picture_us - last_us) / 1e6
            moved_m = float(np.linalg.norm(position_m - last_position_m))
            cosine = (float(np.trace(rotation @ last_rotation.T)) - 1.0) / 2.0
            turned_rad = math.acos(max(-1.0, min(1.0, cosine)))
            self._resets.jumps += moved_m > JUMP_M + JUMP_M_S * seconds or turned_rad > JUMP_RAD + JUMP_RAD_S * seconds
        self._last_fix = (picture_us, position_m, rotation)


_UNKNOWN = [math.nan] + [0.0] * 20  # both autopilots look at the first; ArduPilot adds others up


def _picture_us(first_byte_ns: int, age_us: int) -> int:
    """Mid-exposure on the clock of `first_byte_ns`, in µs."""
    return first_byte_ns // 1000 - age_us


def _upper_triangle(covariance: Floats | None, ned_from_frd: Floats) -> list[float]:
    """The 21 numbers, row by row, of (x, y, z, roll, pitch, yaw); a first NaN where they are not known.

    Rotations about fixed axes become roll, pitch and yaw by the inverse of ω = J·(roll', pitch', yaw'), whose columns
    are the axes that each angle turns about. Where the vehicle stands on its nose or tail there is no inverse.
    """
    roll_axis = ned_from_frd[:, 0]
    level = math.hypot(roll_axis[0], roll_axis[1])
    if covariance is None or level < 1e-3:
        return _UNKNOWN
    pitch_axis = np.array([-roll_axis[1], roll_axis[0], 0.0]) / level
    angles_from_axes = np.linalg.inv(np.column_stack([roll_axis, pitch_axis, [0.0, 0.0, 1.0]]))
    change = np.zeros((6, 6))
    change[:3, :3] = NED_FROM_ENU
    change[3:, 3:] = angles_from_axes @ NED_FROM_ENU
    values: Floats = (change @ covariance @ change.T)[np.triu_indices(6)]
    fit = np.all(np.abs(values) < np.finfo(np.float32).max) and np.all(values[[0, 6, 11, 15, 18, 20]] >= 0)
    return [float(value) for value in values] if fit else _UNKNOWN


def _in_space(state: StateMessage, profile: Profile) -> Floats:
    """(6, 6) of x, y, z and the rotation about them, of a state's in x, y and yaw.

    ArduPilot makes one deviation of all three axes', and would take the place for as uncertain as the height: to it
    that is as sure as the place.
    """
    assert state.deviations is not None
    assert state.correlations is not None
    xy, x_yaw, y_yaw = state.correlations
    linked = np.array([[1.0, xy, x_yaw], [xy, 1.0, y_yaw], [x_yaw, y_yaw, 1.0]])
    height_m = max(state.deviations[:2]) if profile == "ardupilot" else FLOOR_M
    covariance = np.diag([0.0, 0.0, height_m**2, FLOOR_RAD**2, FLOOR_RAD**2, 0.0])
    covariance[np.ix_(_PLANE, _PLANE)] = np.outer(state.deviations, state.deviations) * linked
    return covariance


@dataclass
class Resets:
    """Numbers by which a receiver tells fixes that do not belong together. Not thread-safe: one thread writes each."""

    jumps: int = 0  # of a fix, further than a robot can have gone
    maps: int = 0  # other maps after the first
    _panels: PanelMap | None = None  # of the newest map

    def update_map(self, panels: PanelMap | None) -> None:
        """From now on fixes are in this map."""
        if panels is None:
            return
        if self._panels is not None and not _same_frame(self._panels, panels):
            self.maps += 1
        self._panels = panels


def _same_frame(before: PanelMap, now: PanelMap) -> bool:
    """Tells whether the panels that both maps hold are where they were; there must be one."""
    common = before.keys() & now.keys()
    return bool(common) and all(np.array_equal(before[i].map_from_marker, now[i].map_from_marker) for i in common)
