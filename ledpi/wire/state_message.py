"""Messages of the two-way line: the controller's odometry and clock in, where the robot is out. Pure.

Records are valid once built, as those of message.py. A controller's clock is 32 bits of µs, and its totals wrap.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from enum import IntEnum
from typing import ClassVar

from ledpi.core.errors import WireError
from ledpi.core.records import Floats
from ledpi.state.estimator import State
from ledpi.wire.numbers import POSITION_MAX_UNITS, UNITS_PER_SI, Triple, check_range

UNITS_PER_SI_S = 1000  # of a speed or a turn rate: mm/s, mrad/s
CORRELATION_STEPS = 127  # from 0 to 1
U16, U32 = 0xFFFF, 0xFFFFFFFF
TOTAL_MAX = 0x7FFFFFFF  # of either sign; what is left of the 32 bits says "unknown"


class Mode(IntEnum):
    """Ground of the state at the moment it holds."""

    NONE = 0  # there is no state
    PANELS = 1  # no odometry was heard: it goes on as it moved
    ODOMETRY = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class StateMessage:
    """map_from_base_link in the plane. Without a state, those from `position_m` to `correlations` are None."""

    name: ClassVar = "state"
    position_m: tuple[float, float] | None = None  # x, y
    yaw_rad: float | None = None
    velocity: tuple[float, float] | None = None  # ahead in m/s, turning left in rad/s
    deviations: Triple | None = None  # x and y in m, yaw in rad
    correlations: Triple | None = None  # x with y, x with yaw, y with yaw
    clock_us: int | None = None  # the controller's, at which it holds; None: not known
    panel_age_ms: int | None = None  # of the newest panel's exposure
    way_m: float | None = None  # driven since
    mode: Mode
    contested: bool = False  # another pose is possible, and the deviations span both
    panel_moved: bool = False  # a panel hangs elsewhere than the map says
    map_resets: int = 0  # modulo 256, as the next
    relocalisations: int = 0
    panels: int = 0  # that are followed in it
    t_ns: int | None = field(default=None, compare=False, repr=False)  # CLOCK_MONOTONIC; our packets hold none

    def __post_init__(self) -> None:
        pose = (self.position_m, self.yaw_rad, self.velocity, self.deviations, self.correlations)
        if (self.mode is Mode.NONE) != all(part is None for part in pose) or (self.mode and None in pose):
            raise WireError(f"mode {self.mode.name}: its pose must be whole, or there is none")
        if self.position_m and self.velocity and self.deviations and self.correlations and self.yaw_rad is not None:
            _check_numbers(self.position_m, self.yaw_rad, self.velocity, self.deviations, self.correlations)
        for name, top in (("clock_us", U32), ("panel_age_ms", None), ("panels", None)):
            if (value := getattr(self, name)) is not None:
                check_range(name, value, top)
        check_range("map_resets", self.map_resets, 0xFF)
        check_range("relocalisations", self.relocalisations, 0xFF)


def _check_numbers(
    position_m: tuple[float, float], yaw_rad: float, velocity: tuple[float, float], deviations: Triple, linked: Triple
) -> None:
    if not all(math.isfinite(v) for v in (*position_m, yaw_rad, *velocity, *deviations, *linked)):
        raise WireError(f"a state must be finite, not {position_m} {yaw_rad} {velocity}")
    if any(abs(round(v * UNITS_PER_SI)) > POSITION_MAX_UNITS for v in position_m):
        raise WireError(f"position_m {position_m} does not fit a packet: each within ±838.8607")
    if abs(yaw_rad) > 3.2 or any(abs(round(v * UNITS_PER_SI_S)) > 0x7FFF for v in velocity):
        raise WireError(f"yaw_rad {yaw_rad} or velocity {velocity} does not fit a packet")
    if min(deviations) < 0 or max(map(abs, linked)) > 1 + 1e-9:
        raise WireError(f"deviations {deviations} and correlations {linked} are no covariance's")


@dataclass(frozen=True, slots=True, kw_only=True)
class OdometryMessage:
    """The controller's running totals, so that a lost packet loses no way. They wrap at 32 bits."""

    name: ClassVar = "odometry"
    clock_us: int  # the controller's
    left_100um: int | None  # each wheel's way; both None: no wheels
    right_100um: int | None
    yaw_100urad: int | None  # of a gyro, to the left; None: no gyro
    restarted: bool = False  # the totals begin anew
    lifted: bool = False  # the robot may be anywhere
    slipping: bool = False  # the wheels tell nothing since the message before

    def __post_init__(self) -> None:
        check_range("clock_us", self.clock_us, U32)
        for total in self.totals:
            if total is not None and abs(total) > TOTAL_MAX:
                raise WireError(f"a total must be within ±{TOTAL_MAX}, not {total}")
        if (self.left_100um is None) != (self.right_100um is None):
            raise WireError("odometry of one wheel")

    @property
    def totals(self) -> tuple[int | None, int | None, int | None]:
        """Returns all three, as they are said."""
        return self.left_100um, self.right_100um, self.yaw_100urad


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeAsk:
    """A question for the controller's clock."""

    name: ClassVar = "time_ask"
    number: int

    def __post_init__(self) -> None:
        check_range("number", self.number, U16)


@dataclass(frozen=True, slots=True, kw_only=True)
class TimeAnswer:
    """The controller's clock when the question's last byte came, and when this answer's first byte leaves."""

    name: ClassVar = "time_answer"
    number: int  # the question's
    arrived_us: int
    left_us: int

    def __post_init__(self) -> None:
        check_range("number", self.number, U16)
        check_range("arrived_us", self.arrived_us, U32)
        check_range("left_us", self.left_us, U32)


def state_message(state: State | None, *, clock_us: int | None, map_resets: int = 0) -> StateMessage:
    """The message of a state, or that there is none. Raises WireError for one that must not be sent."""
    resets = map_resets % 256
    if state is None:
        return StateMessage(mode=Mode.NONE, clock_us=clock_us, map_resets=resets)
    x, y, yaw = (float(v) for v in state.pose)
    deviations, correlations = _split(state.covariance)
    return StateMessage(
        position_m=(x, y),
        yaw_rad=yaw,
        velocity=(state.speed_m_s, state.turn_rad_s),
        deviations=deviations,
        correlations=correlations,
        clock_us=clock_us,
        panel_age_ms=max(0, state.t_ns - state.panel_ns) // 1_000_000,
        way_m=state.way_m,
        mode=Mode.ODOMETRY if state.by_odometry else Mode.PANELS,
        contested=state.contested,
        panel_moved=bool(state.moved),
        map_resets=resets,
        relocalisations=state.relocalisations % 256,
        panels=state.panels,
        t_ns=state.t_ns,
    )


def _split(covariance: Floats) -> tuple[Triple, Triple]:
    """Deviations and correlations, these drawn toward 0 so far that rounding leaves them a covariance's.

    Rounding changes each by half a step at most, and so an eigenvalue by a step; C + (I − C)/steps has none below that.
    """
    a, b, c = (math.sqrt(max(float(covariance[i, i]), 1e-12)) for i in range(3))
    xy, x_yaw, y_yaw = covariance[0, 1] / (a * b), covariance[0, 2] / (a * c), covariance[1, 2] / (b * c)
    kept = 1 - 1 / CORRELATION_STEPS
    within = [kept * max(-1.0, min(1.0, float(v))) for v in (xy, x_yaw, y_yaw)]
    return (a, b, c), (within[0], within[1], within[2])
