"""Inputs of the state, and what comes out of it. Times are of one clock."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from ledpi.core.records import Floats, Rejected

EventKind = Literal["panel_moved", "relocalised", "map_contradicts"]

NOT_STARTED = Rejected(stage="state", reason="not_started")
NOT_IN_MAP = Rejected(stage="state", reason="not_in_map")
NO_POSE = Rejected(stage="state", reason="no_pose")
TOO_OLD = Rejected(stage="state", reason="too_old")
IN_FUTURE = Rejected(stage="state", reason="in_future")
NO_NUMBER = Rejected(stage="state", reason="no_number")
LEAP = Rejected(stage="state", reason="odometry_leap")


@dataclass(frozen=True, slots=True, kw_only=True)
class OdometryNoise:
    """Errors of odometry: standard deviations, those of a random walk per root of what it grows with."""

    base_m: float | None = None  # between the wheels; needed only where no gyro turns
    way_per_m: float = 0.02  # m/√m of each wheel: 3 % of slip that lasts 0.5 s, at 0.5 m/s
    yaw_per_m: float = math.radians(0.1)  # rad/√m, bumps; what wheels slip is counted from `way_per_m`
    yaw_per_s: float = math.radians(0.1)  # rad/√s of a gyro


@dataclass(frozen=True, slots=True, kw_only=True)
class Odometry:
    """Running totals of a controller: a message that is lost loses no way."""

    t_ns: int
    left_m: float | None = None  # each wheel's way; None: no wheels
    right_m: float | None = None
    yaw_rad: float | None = None  # of the gyro, to the left; not wrapped; None: no gyro
    restarted: bool = False  # the totals begin anew here
    lifted: bool = False  # the robot may be anywhere
    slipping: bool = False  # since the message before, the wheels' way tells nothing

    @property
    def totals(self) -> tuple[float | None, float | None, float | None]:
        return self.left_m, self.right_m, self.yaw_rad


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Measured:
    """A panel's pose in the plane of base_link: its centre's x and y, and the heading of base_link in the map."""

    value: Floats  # (3,)
    covariance: Floats  # (3, 3) of what is new in each look


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Look:
    """One look at one panel."""

    t_ns: int  # mid-exposure of its centre row
    panel: int
    pose: Measured
    alternate: Measured | None  # its mirror pose, where that is not excluded: the same place, another heading
    range_share: float  # deviation of its distance that stays the same from look to look, as a share
    heading_rad: float  # such a deviation of the heading


@dataclass(frozen=True, slots=True, kw_only=True)
class Event:
    """Something that somebody should know of."""

    t_ns: int
    kind: EventKind
    panel: int


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class State:
    """map_from_base_link in the plane at a moment."""

    t_ns: int
    pose: Floats  # (3,) x, y, yaw
    covariance: Floats  # (3, 3); spans both while another pose is possible
    speed_m_s: float
    turn_rad_s: float
    panel_ns: int  # when a panel was last used
    panels: int  # that are followed in the state
    contested: bool  # another pose is possible
    moved: tuple[int, ...]  # panels that hang elsewhere than the map says
    relocalisations: int
    events: tuple[Event, ...]  # the last ones


def wrapped(angle: float) -> float:
    """Returns it within -π to π."""
    return math.remainder(angle, math.tau)
