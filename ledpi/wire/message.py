"""Messages of poses and status to the motor controller, and how they are made of the path's records. Pure.

Records are valid once built: a value that must not be sent raises WireError here, before it reaches the line.
codec.py puts them into bytes; docs/wire.md is the contract.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields
from enum import IntEnum
from typing import ClassVar, TypeAlias

from ledpi.core.errors import WireError
from ledpi.core.records import BodyPose, Floats, MarkerPose, Pose, RobotFix
from ledpi.wire.numbers import POSITION_MAX_UNITS, UNITS_PER_SI, Triple, check_range
from ledpi.wire.state_message import OdometryMessage, StateMessage, TimeAnswer, TimeAsk

Quadruple: TypeAlias = tuple[float, float, float, float]


class State(IntEnum):
    """The daemon's state. A value that is not known here reads as UNKNOWN."""

    STARTING = 0
    RUNNING = 1
    CAMERA_LOST = 2
    STOPPING = 3
    UNKNOWN = 255

    @classmethod
    def _missing_(cls, value: object) -> State:
        return cls.UNKNOWN


class NoFix(IntEnum):
    """Why there is no fix; NONE where there is one. A value that is not known here reads as UNKNOWN."""

    NONE = 0
    NOT_RUNNING = 1  # starting or stopping
    NO_FRAMES = 2  # the camera delivers nothing
    UNCALIBRATED = 3  # the camera has no intrinsics
    NO_MAP = 4  # no map is configured
    NO_PANEL = 5  # no panel in view
    NOT_IN_MAP = 6  # panels in view, none of them in the map
    REJECTED = 7  # a fix was solved and not believed
    STALE = 8  # the last fix is older than serial.max_age_ms
    BEHIND = 9  # the camera delivers, and frames are decoded too late
    UNKNOWN = 255

    @classmethod
    def _missing_(cls, value: object) -> NoFix:
        return cls.UNKNOWN


@dataclass(frozen=True, slots=True, kw_only=True)
class WirePose:
    """A pose with the standard deviation of each axis; three deviations together are None where not known."""

    position_m: Triple  # each within ±838.8607
    quaternion_wxyz: Quadruple  # unit length; q and −q are the same rotation, w ≥ 0 is sent
    deviation_m: Triple | None  # along x, y, z
    deviation_rad: Triple | None  # of the rotation about x, y, z; fixed axes, as ROS
    covariance: Floats | None = field(default=None, compare=False, repr=False)  # the Pose's own; our packets hold none

    def __post_init__(self) -> None:
        if not all(math.isfinite(v) for v in (*self.position_m, *self.quaternion_wxyz)):
            raise WireError(f"a pose must be finite, not {self.position_m} {self.quaternion_wxyz}")
        if any(abs(round(v * UNITS_PER_SI)) > POSITION_MAX_UNITS for v in self.position_m):
            raise WireError(f"position_m {self.position_m} does not fit a packet: each within ±838.8607")
        if abs(math.hypot(*self.quaternion_wxyz) - 1.0) > 1e-3:
            raise WireError(f"quaternion_wxyz {self.quaternion_wxyz} must have length 1")
        for deviations in (self.deviation_m, self.deviation_rad):
            if deviations is not None and not all(math.isfinite(d) and d >= 0 for d in deviations):
                raise WireError(f"deviations must be finite and not negative, not {deviations}")


@dataclass(frozen=True, slots=True, kw_only=True)
class MarkerMessage:
    """One panel, or a body of several: camera_from_marker, in OpenCV's optical frame."""

    name: ClassVar = "marker"
    id: int  # 0 to 65535
    age_us: int  # at the frame's first byte on the wire, from mid-exposure of the panel's centre row
    pose: WirePose | None
    uncalibrated: bool = False  # the camera has no intrinsics: an ID, no pose
    ambiguous: bool = False  # the square's other planar pose could not be excluded
    alternate: bool = False  # this is that other pose

    def __post_init__(self) -> None:
        check_range("id", self.id, 0xFFFF)
        check_range("age_us", self.age_us)
        if self.uncalibrated and self.pose is not None:
            raise WireError(f"marker {self.id}: an uncalibrated camera gives no pose")
        if self.alternate and not self.ambiguous:
            raise WireError(f"marker {self.id}: only an ambiguous pose has an alternate")


@dataclass(frozen=True, slots=True, kw_only=True)
class FixMessage:
    """The robot: map_from_base_link."""

    name: ClassVar = "fix"
    age_us: int  # as a marker's
    pose: WirePose
    panels_used: int  # 255 on the wire: that many or more
    map_resets: int = 0  # changes of the map since the daemon started, modulo 256

    def __post_init__(self) -> None:
        check_range("age_us", self.age_us)
        check_range("panels_used", self.panels_used)
        check_range("map_resets", self.map_resets, 0xFF)


@dataclass(frozen=True, slots=True, kw_only=True)
class StatusMessage:
    """The heartbeat. None is unknown. Counters are totals since the daemon started."""

    name: ClassVar = "status"
    state: State
    no_fix: NoFix
    panels_in_view: int | None = None
    temperature_c: int | None = None  # of the processor
    throttling: int | None = None  # the firmware's get_throttled: its bits 0–3 as they are, its 16–19 as 8–11
    uptime_s: int | None = None
    frames: int | None = None  # delivered by the camera
    frames_dropped: int | None = None  # of these, not decoded
    markers: int | None = None  # panels read, summed over the frames
    packets_dropped: int | None = None  # poses that never reached the line
    decode_p50_us: int | None = None  # find to pose: median of the recent frames
    decode_p99_us: int | None = None

    def __post_init__(self) -> None:
        for name in (item.name for item in fields(self)):
            value = getattr(self, name)
            if value is not None and name != "temperature_c":
                check_range(name, value, 0x0F0F if name == "throttling" else None)


@dataclass(frozen=True, slots=True, kw_only=True)
class SyncAnswer:
    """The answer to an autopilot's TIMESYNC; of MAVLink only."""

    name: ClassVar = "time_sync"
    asked_ns: int  # on its clock, as it said
    arrived_ns: int  # CLOCK_MONOTONIC


Message: TypeAlias = (
    MarkerMessage | FixMessage | StatusMessage | StateMessage | OdometryMessage | TimeAsk | TimeAnswer | SyncAnswer
)


def marker_message(marker: MarkerPose | BodyPose, *, age_us: int, alternate: bool = False) -> MarkerMessage:
    """The message of a marker, of its alternate, or of a body. Raises WireError for a pose that must not be sent."""
    if isinstance(marker, BodyPose):
        return MarkerMessage(id=marker.id, age_us=age_us, pose=wire_pose(marker.camera_from_body))
    solution = marker.alternate if alternate else marker.solution
    return MarkerMessage(
        id=marker.detection.id,
        age_us=age_us,
        pose=None if solution is None else wire_pose(solution.camera_from_marker),
        uncalibrated=solution is None,
        ambiguous=marker.alternate is not None,
        alternate=alternate,
    )


def fix_message(fix: RobotFix, *, age_us: int, map_resets: int = 0) -> FixMessage:
    """The message of a robot's fix. Raises WireError for a pose that must not be sent."""
    pose = wire_pose(fix.map_from_base_link)
    return FixMessage(age_us=age_us, pose=pose, panels_used=len(fix.panels_used), map_resets=map_resets % 256)


def wire_pose(pose: Pose) -> WirePose:
    """A pose with the deviations of its covariance. Raises WireError for one that must not be sent."""
    x, y, z = (float(v) for v in pose.position_m)
    qw, qx, qy, qz = (float(v) for v in pose.quaternion_wxyz)
    return WirePose(
        position_m=(x, y, z),
        quaternion_wxyz=(qw, qx, qy, qz),
        deviation_m=_deviations(pose.covariance, 0),
        deviation_rad=_deviations(pose.covariance, 3),
        covariance=pose.covariance,
    )


def _deviations(covariance: Floats | None, first: int) -> Triple | None:
    """Square roots of three variances; None where one of them is no variance (a degenerate solution)."""
    if covariance is None:
        return None
    a, b, c = (float(covariance[i, i]) for i in range(first, first + 3))
    if not all(math.isfinite(v) and v >= 0 for v in (a, b, c)):
        return None
    return math.sqrt(a), math.sqrt(b), math.sqrt(c)
