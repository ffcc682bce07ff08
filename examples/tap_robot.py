"""The robot's controller as a program beside ledpi: it tells its wheels over the tap, hears where it is, and drives.

Through points of the map, in metres, while ledpi runs with `odometry: {source: tap}`:

    python examples/tap_robot.py 1,1 3,1
"""

from __future__ import annotations

import math
import signal
import sys
import time
from cmath import isfinite, phase, rect
from collections.abc import Generator
from typing import Any, NamedTuple

from ledpi import LedpiError, connect_tap

FASTEST_M_S, SLOWEST_M_S = 0.35, 0.09
SETTLES_S = 0.18  # from a command until it is obeyed
NEAR_M = 0.1  # of a point
PERIOD_S, STALE_S = 0.02, 0.15  # of odometry; a state that is older is none

Motion = tuple[float, float]  # ahead, m/s; to the left, rad/s
STAND: Motion = (0.0, 0.0)


class Wheels:
    """Yours belong here. These stand, and say what they are told."""

    def drive(self, speed_m_s: float, turn_rad_s: float) -> None:
        print(f"{speed_m_s:.3f} m/s, {turn_rad_s:.3f} rad/s")

    def totals(self) -> dict[str, float]:
        """Running totals: of each wheel; with a gyro also `yaw_rad`."""
        return {"left_m": 0.0, "right_m": 0.0}


class Seen(NamedTuple):
    """A line `robot_state` of the tap, and the time."""

    state: dict[str, Any]
    now_ns: int

    def is_known(self) -> bool:
        young = abs(self.now_ns - self.state["t_ns"]) < STALE_S * 1e9
        return young and self.state["mode"] != "none" and not self.state["contested"]

    def is_vague(self, left_m: float, least_m: float) -> bool:
        """Tells whether the deviations are too large for how far there is to go."""
        return math.sqrt(self.state["covariance"][0] + self.state["covariance"][4]) > least_m + 0.2 * left_m

    def ahead(self, seconds: float = SETTLES_S) -> tuple[complex, float]:
        """Place and yaw so many seconds from now, if it goes on as it moves."""
        (speed, rate), yaw = self.state["velocity"], self.state["yaw_rad"]
        s = seconds + (self.now_ns - self.state["t_ns"]) * 1e-9
        return complex(*self.state["position_m"]) + rect(speed * s, yaw + rate * s / 2), yaw + rate * s


Steering = Generator[Motion, Seen, None]  # is sent what is seen, yields what to do; ends where the robot is there


def toward(aside_rad: float, speed_m_s: float) -> Motion:
    """Turns on the spot first, if it is far aside."""
    speed = max(SLOWEST_M_S, speed_m_s * math.cos(aside_rad))
    return (0.0, math.copysign(1.0, aside_rad)) if abs(aside_rad) > 1 else (speed, 2.5 * aside_rad)


def go_through(points: list[complex]) -> Steering:
    seen = yield STAND
    for point in points:
        while abs(point - complex(*seen.state["position_m"])) > NEAR_M:
            at, yaw = seen.ahead()
            left = (point - at) * rect(1, -yaw)
            seen = yield STAND if seen.is_vague(abs(left), 0.2) else toward(phase(left), FASTEST_M_S)


def drive(tap: Any, wheels: Wheels, steering: Steering) -> None:
    """Until it is there. It stands while the state is not known, and at the end, whatever ends it."""
    state: dict[str, Any] = {"t_ns": 0}
    told_ns = 0
    next(steering)
    try:
        for line in tap.lines(tick_s=PERIOD_S):
            if line["type"] == "error" and not line.get("again"):  # again: the daemon reads its configuration
                raise LedpiError(line["error"])
            if line["type"] == "robot_state":
                state = line
            now_ns = time.monotonic_ns()
            if now_ns - told_ns >= PERIOD_S * 1e9:
                told_ns = now_ns
                tap.send("odometry", t_ns=now_ns, **wheels.totals())
                seen = Seen(state, now_ns)
                wheels.drive(*(steering.send(seen) if seen.is_known() else STAND))
        raise LedpiError("the daemon has ended")
    except StopIteration:
        print("there")
    finally:
        wheels.drive(*STAND)


def main(steering: Steering) -> None:
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())  # so that it stands at the end, whoever ends it
    try:
        with connect_tap() as tap:
            drive(tap, Wheels(), steering)
    except LedpiError as error:
        sys.exit(str(error))


if __name__ == "__main__":
    try:
        to = [complex(*(float(metres) for metres in point.split(",", 1))) for point in sys.argv[1:]]
    except ValueError:
        to = []
    if not to or not all(map(isfinite, to)):
        print("usage: python examples/tap_robot.py X,Y [X,Y ...]", file=sys.stderr)
        sys.exit(2)
    main(go_through(to))
