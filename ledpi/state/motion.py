"""The motion of a robot that drives the way it heads, and what is not known of it.

Own part of the state: x, y, yaw of base_link in the map; speed and turn rate; what odometry errs by: drift of the yaw
(rad/s of a gyro, rad/m of wheels), scale of the way, scale of the yaw.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ledpi.core.records import Floats
from ledpi.state.inputs import Odometry, OdometryNoise, wrapped

X, Y, YAW, SPEED, TURN, DRIFT, WAY_SCALE, YAW_SCALE = range(8)
POSE, OWN = 3, 8

# Deviations before anything is known, but the pose's: of the velocity m/s and rad/s, and of the way's scale.
PRIORS = 0.0, 0.0, 0.0, 1.0, 1.5, 0.0, 0.02, 0.0
# … of the yaw's drift and scale: rad/s of a gyro; rad/m of wheels 0.3 m apart whose diameters differ by 0.4 %.
GYRO_PRIORS, WHEEL_PRIORS = (math.radians(0.6), 0.012), (0.015, 0.03)
MEASURED_SPEED, MEASURED_TURN = 0.05, 0.05  # m/s, rad/s: steps of encoders, and what changes within a message
DRIFT_WALK = math.radians(0.01)  # rad/s/√s
ACCELERATIONS = 0.8, 2.0  # m/s/√s, rad/s/√s: without odometry the velocity walks
SIDEWAYS = 0.25  # across the way, as a share of the deviation along it
FASTEST_M_S, FASTEST_RAD_S = 10.0, 20.0  # no wheels do more
SILENT_NS = 250_000_000  # odometry that is interrupted for longer tells nothing of the time between


@dataclass(frozen=True, slots=True)
class Step:
    """The motion within a time, and the variance of what is measured of it."""

    dt_s: float
    way_m: float | None = None  # None: not measured
    turn_rad: float | None = None
    way_variance: float = 0.0
    yaw_variance: float = 0.0
    drifts_with: float = 0.0  # s or m: what the yaw's drift is a rate of
    turn_priors: tuple[float, float] = GYRO_PRIORS  # of what measured the turn


def are_linked(one: Odometry, two: Odometry) -> bool:
    """Tells whether the motion between two messages is what their totals differ by: if that is what wheels can do."""
    dt_s = (two.t_ns - one.t_ns) * 1e-9
    both = zip(one.totals, two.totals, (FASTEST_M_S, FASTEST_M_S, FASTEST_RAD_S), strict=True)
    leaps = any(a is not None and b is not None and abs(b - a) > fastest * dt_s for a, b, fastest in both)
    return not two.restarted and two.t_ns - one.t_ns <= SILENT_NS and not leaps


def between(one: Odometry, two: Odometry, t_ns: int) -> Odometry:
    """The totals at a time between two messages, at constant speed."""
    share, both = (t_ns - one.t_ns) / (two.t_ns - one.t_ns), zip(one.totals, two.totals, strict=True)
    left, right, yaw = (None if a is None or b is None else a + share * (b - a) for a, b in both)
    return Odometry(t_ns=t_ns, left_m=left, right_m=right, yaw_rad=yaw, slipping=two.slipping)


def step_between(one: Odometry, two: Odometry, noise: OdometryNoise) -> Step:
    """The motion between two totals.

    Each wheel slips by itself: its way's variance is way_per_m²·|way|. The mean of two has a quarter of both, and a yaw
    of wheels both over base_m², turning on the spot too. A gyro says more of the yaw than wheels do.
    """
    dt_s = (two.t_ns - one.t_ns) * 1e-9
    both = zip(one.totals, two.totals, strict=True)
    left, right, yaw = (None if a is None or b is None else b - a for a, b in both)
    way = turn = None
    priors = GYRO_PRIORS
    way_variance = yaw_variance = drifts_with = 0.0
    if left is not None and right is not None and not two.slipping:
        slipped = noise.way_per_m**2 * (abs(left) + abs(right))
        way, way_variance = (left + right) / 2, slipped / 4
        yaw_variance = noise.yaw_per_m**2 * abs(way)
        if noise.base_m is not None and yaw is None:
            turn, drifts_with, priors = (right - left) / noise.base_m, way, WHEEL_PRIORS
            yaw_variance += slipped / noise.base_m**2
    if yaw is not None:
        turn, drifts_with = yaw, dt_s
        yaw_variance += noise.yaw_per_s**2 * dt_s
    return Step(dt_s, way, turn, way_variance, yaw_variance, drifts_with, priors)


def propagate(x: Floats, P: Floats, step: Step) -> None:
    """Moves a state (n,) and its covariance (n, n), n ≥ OWN, in place.

    x' = x + w·cos(yaw + a/2), y' = y + w·sin(yaw + a/2), yaw' = yaw + a, with the way w and the turn a: measured, less
    drift and scales, or else speed and turn rate times dt. P' = F·P·Fᵀ + Q, where only the pose's rows of F differ from
    a unit matrix.
    """
    dt = step.dt_s
    east, north, yaw, speed, rate, drift, way_scale, yaw_scale = x[:OWN].tolist()
    by_way, by_turn = [0.0] * 6, [0.0] * 6  # slopes of w and a, by the own part from YAW on
    if step.way_m is None:
        way, by_way[1] = speed * dt, dt
    else:
        way, by_way[4] = step.way_m * (1 + way_scale), step.way_m
    if step.turn_rad is None:
        turn, by_turn[2] = rate * dt, dt
    else:
        turn = step.turn_rad * (1 + yaw_scale) - drift * step.drifts_with
        by_turn[3], by_turn[5] = -step.drifts_with, step.turn_rad
    c, s = math.cos(yaw + turn / 2), math.sin(yaw + turn / 2)
    x[:POSE] = east + way * c, north + way * s, wrapped(yaw + turn)
    aside = [way, *(way * a / 2 for a in by_turn[1:])]  # slopes of the way across
    slopes = np.array([[c * w - s * b for w, b in zip(by_way, aside, strict=True)],
                       [s * w + c * b for w, b in zip(by_way, aside, strict=True)], by_turn])  # fmt: skip
    P[:POSE] += slopes @ P[YAW:OWN]
    P[POSE:, :POSE] = P[:POSE, POSE:].T
    along, across = step.way_variance, SIDEWAYS**2 * step.way_variance
    xx, xy, yy = along * c * c + across * s * s, (along - across) * c * s, along * s * s + across * c * c
    corner = P[:POSE, :POSE] + P[:POSE, YAW:OWN] @ slopes.T
    P[:POSE, :POSE] = (corner + corner.T) / 2 + np.array([[xx, xy, 0], [xy, yy, 0], [0, 0, step.yaw_variance]])
    P[DRIFT, DRIFT] += DRIFT_WALK**2 * dt
    _follow(x, P, SPEED, None if step.way_m is None else way, MEASURED_SPEED, np.array([c, s, 0.0]), dt)
    _follow(x, P, TURN, None if step.turn_rad is None else turn, MEASURED_TURN, np.array([0.0, 0.0, 1.0]), dt)


def _follow(x: Floats, P: Floats, at: int, moved: float | None, sigma: float, along: Floats, dt: float) -> None:
    """Takes a velocity from what was measured, or lets it walk.

    A walk of density q adds q·dt to the velocity's variance, q·dt³/3 to the way's and q·dt²/2 between both.
    """
    if moved is None:
        q = ACCELERATIONS[at - SPEED] ** 2 * dt
        P[at, at] += q
        P[at, :POSE] += q * dt / 2 * along
        P[:POSE, at] += q * dt / 2 * along
        P[:POSE, :POSE] += q * dt**2 / 3 * np.outer(along, along)
        return
    x[at] = moved / dt
    if P[at, at] != sigma**2:  # else nothing has been correlated with it since it was measured
        P[at], P[:, at] = 0.0, 0.0
        P[at, at] = sigma**2
