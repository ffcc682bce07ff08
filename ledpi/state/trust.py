"""Trust in odometry: looks at one panel show how the robot moved, and so does odometry, of which they know nothing.

Wheels that turn the wrong way, a scale that is twice too large, or a robot that pushes against a wall: no filter mends
that, and panels that contradict it would be the ones that are refused.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from ledpi.state.filter import RANGE_FADES_S
from ledpi.state.inputs import Look, Step

APART_M, APART_RAD = 0.4, 0.4  # motion by odometry, after which two looks at a panel tell
LATEST_NS = 5_000_000_000  # the second, as the decoder's error of distance has faded then
SHARE = 0.07  # odometry's scale, and slip, that are no contradiction
UNMEASURED_M_S, UNMEASURED_RAD_S = 1.0, 1.0  # of a robot without wheels, or without a gyro
CHANCE = 13.8  # χ² of 2 that chance exceeds once in 1,000 times
DOUBTS, MOST_DOUBTS = 6, 8  # pairs that contradict, less those that agree: a robot that was carried off has fewer


class Moved(NamedTuple):
    """Motion by odometry since the start: a pose in the plane, sums of ways and turns, and how far these may be off."""

    x_m: float = 0.0
    y_m: float = 0.0
    yaw_rad: float = 0.0
    way_m: float = 0.0
    turn_rad: float = 0.0
    off_m: float = 0.0
    off_rad: float = 0.0
    variance_m2: float = 0.0
    variance_rad2: float = 0.0

    def after(self, step: Step) -> Moved:
        way, turn = step.way_m or 0.0, step.turn_rad or 0.0
        return Moved(
            x_m=self.x_m + way * math.cos(self.yaw_rad + turn / 2),
            y_m=self.y_m + way * math.sin(self.yaw_rad + turn / 2),
            yaw_rad=self.yaw_rad + turn,
            way_m=self.way_m + abs(way),
            turn_rad=self.turn_rad + abs(turn),
            off_m=self.off_m + (UNMEASURED_M_S * step.dt_s if step.way_m is None else SHARE * abs(way)),
            off_rad=self.off_rad + (UNMEASURED_RAD_S * step.dt_s if step.turn_rad is None else SHARE * abs(turn)),
            variance_m2=self.variance_m2 + step.way_variance,
            variance_rad2=self.variance_rad2 + step.yaw_variance,
        )


@dataclass(slots=True)
class Trust:
    """The motion so far, each panel's look that waits for a second one, and what was found."""

    moved: Moved = field(default_factory=Moved)
    looks: dict[int, tuple[Look, Moved]] = field(default_factory=dict)
    doubts: int = 0
    is_lost: bool = False

    def copy(self) -> Trust:
        return replace(self, looks=self.looks.copy())

    def hear(self, look: Look, scale_is_off: bool) -> bool:
        """Takes a look. Returns whether trust is lost by it; it comes back where all doubts are gone.

        `scale_is_off`: the filter has found odometry's scale beyond what can be.
        """
        first, then = self.looks.get(look.panel, (look, self.moved))
        now, stays = self.moved, False
        if 0 < look.t_ns - first.t_ns < LATEST_NS:
            stays = now.way_m - then.way_m < APART_M and now.turn_rad - then.turn_rad < APART_RAD
            if not stays:
                contradicts = _chi2(first, then, look, now) > CHANCE
                self.doubts = min(self.doubts + 1, MOST_DOUBTS) if contradicts else max(self.doubts - 1, 0)
        if not stays:
            self.looks[look.panel] = look, now
        if scale_is_off:
            self.doubts = MOST_DOUBTS
        had, self.is_lost = not self.is_lost, self.doubts >= DOUBTS or (self.is_lost and self.doubts > 0)
        return had and self.is_lost


def _chi2(first: Look, then: Moved, second: Look, now: Moved) -> float:
    """χ² of the panel's place in base_link at the second look, beside where the first and odometry have it."""
    turn, x, y = now.yaw_rad - then.yaw_rad, now.x_m - then.x_m, now.y_m - then.y_m
    c, s = math.cos(then.yaw_rad), math.sin(then.yaw_rad)
    rotation = np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
    before, after = first.pose.value[:2], second.pose.value[:2]
    error = after - rotation @ (before - (c * x + s * y, c * y - s * x))
    distance = math.hypot(*after)
    off_m2 = (now.off_m - then.off_m) ** 2 + now.variance_m2 - then.variance_m2
    off_m2 += distance**2 * ((now.off_rad - then.off_rad) ** 2 + now.variance_rad2 - then.variance_rad2)
    fades = 2 * (1 - math.exp((first.t_ns - second.t_ns) * 1e-9 / RANGE_FADES_S))
    nearer = math.hypot(*before) - distance
    along_m2 = second.range_share**2 * (fades + (nearer / distance) ** 2)
    covariance = second.pose.covariance[:2, :2] + rotation @ first.pose.covariance[:2, :2] @ rotation.T
    covariance += off_m2 * np.eye(2) + along_m2 * np.outer(after, after)
    return float(error @ np.linalg.solve(covariance, error))
