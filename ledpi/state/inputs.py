"""Inputs of the state: odometry, and panels in the plane; and the motion of a robot that drives the way it heads.

Height, roll and pitch are free. Own part of the state: x, y, yaw of base_link in the map; speed and turn rate; what
odometry errs by: drift of the yaw (rad/s of a gyro, rad/m of wheels), scale of the way, scale of the yaw.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ledpi.core.geometry import matrix_from_quaternion
from ledpi.core.records import Floats, MapPanel, MarkerPose, Pose, Rejected

NO_POSE = Rejected(stage="state", reason="no_pose")

TILT_RAD = math.radians(0.3)  # deviation of a chassis on an even floor: moves a panel at the height h by that · h
SAME_RANGE, SAME_HEADING = 0.9, 0.75  # shares of the stated variance that are the same in the look 50 ms later
ACROSS_REPEATS = 16.0  # so often is that across counted, instead of a number of the state: it is 100 times smaller
SIZE_SHARE = 0.004  # deviation of a panel's size and of the lens's focal length, as a share
MOST_RANGE_SHARE = 0.03  # corners are within half a pixel: a range that is stated to be worse is not
LEAST_HEADING_RAD = math.radians(0.1)


@dataclass(frozen=True, slots=True, kw_only=True)
class OdometryNoise:
    """Errors of odometry: standard deviations, those of a random walk per root of what it grows with."""

    base_m: float | None = None  # between the wheels; needed only where no gyro tells the yaw
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


@dataclass(frozen=True, slots=True, eq=False)
class Measured:
    """A panel's pose in the plane of base_link: its centre's x and y, and the heading of base_link in the map."""

    value: Floats  # (3,)
    covariance: Floats  # (3, 3) of what is new in each look


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """One look at one panel."""

    t_ns: int  # mid-exposure of its centre row
    panel: int
    pose: Measured
    alternate: Measured | None  # its mirror pose, where that is not excluded: the same place, another heading
    range_share: float  # deviation of its distance that stays the same from look to look, as a share
    heading_rad: float  # such a deviation of the heading
    above_m: float  # of the panel above the camera: by that a tilt of the camera moves it


def look_of(marker: MarkerPose, panel: MapPanel, base_from_camera: Floats) -> Look | Rejected:
    """Returns a panel's look; `base_from_camera` (4, 4) is the camera's seat."""
    poses = [each.camera_from_marker for each in (marker.solution, marker.alternate) if each is not None]
    if not poses or not all(_is_whole(pose) for pose in poses):
        return NO_POSE
    (pose, share, heading), *other = (_measured(each, panel, base_from_camera) for each in poses)
    mirror, above_m = other[0][0] if other else None, float(base_from_camera[2, :3] @ poses[0].position_m)
    return Look(marker.mid_exposure_ns, marker.detection.id, pose, mirror, share, heading, above_m)


def _is_whole(pose: Pose) -> bool:
    """Tells whether a pose is before the camera, and how sure it is."""
    covariance = pose.covariance
    if covariance is None or not np.isfinite([*pose.position_m, *pose.quaternion_wxyz, *covariance.flat]).all():
        return False
    return bool(pose.position_m[2] > 0 and np.linalg.eigvalsh(covariance)[0] > 0)


def _measured(pose: Pose, panel: MapPanel, seat: Floats) -> tuple[Measured, float, float]:
    """The pose in the plane, and the deviations of what repeats.

    With A = base_from_camera·camera_from_marker and M = map_from_marker, M·A⁻¹ turns base_link into the map: its yaw is
    the heading. An error ω of A's attitude turns that by -ω_z.
    """
    assert pose.covariance is not None
    turn = seat[:3, :3]
    centre = turn @ pose.position_m + seat[:3, 3]
    map_from_base = panel.map_from_marker[:3, :3] @ (turn @ matrix_from_quaternion(pose.quaternion_wxyz)).T
    heading = math.atan2(map_from_base[1, 0], map_from_base[0, 0])
    to_plane = np.zeros((3, 6))
    to_plane[:2, :3], to_plane[2, 3:] = turn[:2], -turn[2]
    covariance = to_plane @ pose.covariance @ to_plane.T
    value = np.array([centre[0], centre[1], heading])
    return split_noise(value, covariance, seat[:2, 3], float(centre[2]))


def split_noise(value: Floats, stated: Floats, camera_xy: Floats, height_m: float) -> tuple[Measured, float, float]:
    """Splits a stated covariance (3, 3) into what is new in each look, and deviations of range share and heading.

    In axes along the ray, across it, and heading: D·stated·D, where D scales each deviation to its new part.
    """
    ray = value[:2] - camera_xy
    if not ray.any():  # right above the camera all directions are alike
        ray = np.array([1e-6, 0.0])
    distance = math.hypot(*ray)
    axes = np.eye(3)
    axes[0, :2] = ray / distance
    axes[1, :2] = -axes[0, 1], axes[0, 0]
    turned = axes @ stated @ axes.T
    along, heading = math.sqrt(turned[0, 0]), math.sqrt(turned[2, 2])
    believed = min(along, MOST_RANGE_SHARE * distance)
    new = np.sqrt([(1 - SAME_RANGE) * (believed / along) ** 2, ACROSS_REPEATS, 1 - SAME_HEADING])
    covariance = turned * np.outer(new, new)
    covariance[1, [0, 2]] = covariance[[0, 2], 1] = 0.0  # else they would be as if they repeated, too
    tilt = (TILT_RAD * height_m) ** 2
    covariance[np.diag_indices(3)] += tilt, tilt, LEAST_HEADING_RAD**2
    share = math.hypot(SIZE_SHARE, math.sqrt(SAME_RANGE) * believed / distance)
    return Measured(value, axes.T @ covariance @ axes), share, math.sqrt(SAME_HEADING) * heading


def wrapped(angle: float) -> float:
    """Returns it within -π to π."""
    return math.remainder(angle, math.tau)


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
    if two.restarted or two.t_ns - one.t_ns > SILENT_NS:
        return False
    for a, b, fastest in zip(one.totals, two.totals, (FASTEST_M_S, FASTEST_M_S, FASTEST_RAD_S), strict=True):
        if a is not None and b is not None and abs(b - a) > fastest * dt_s:
            return False
    return True


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
    pose = P[:POSE]
    pose += slopes @ P[YAW:OWN]
    P[POSE:, :POSE] = pose[:, POSE:].T
    corner = pose[:, :POSE] + pose[:, YAW:OWN] @ slopes.T
    along, across, yaw_variance = step.way_variance, SIDEWAYS**2 * step.way_variance, step.yaw_variance
    if step.way_m is None:
        along += _walk(P, SPEED, dt, (c, s, 0.0))
    if step.turn_rad is None:
        yaw_variance += _walk(P, TURN, dt, (0.0, 0.0, 1.0))
    xx, xy, yy = along * c * c + across * s * s, (along - across) * c * s, along * s * s + across * c * c
    noise = np.array([[xx, xy, 0], [xy, yy, 0], [0, 0, yaw_variance]])
    pose[:, :POSE] = (corner + corner.T) / 2 + noise
    P[DRIFT, DRIFT] += DRIFT_WALK**2 * dt
    if step.way_m is not None:
        _measure(x, P, SPEED, way / dt, MEASURED_SPEED)
    if step.turn_rad is not None:
        _measure(x, P, TURN, turn / dt, MEASURED_TURN)


def _walk(P: Floats, at: int, dt: float, along: tuple[float, float, float]) -> float:
    """Lets a velocity walk. Returns what that adds to the variance of the way along.

    A walk of density q adds q·dt to the velocity's variance, q·dt³/3 to the way's and q·dt²/2 between both.
    """
    q = ACCELERATIONS[at - SPEED] ** 2 * dt
    P[at, at] += q
    P[at, :POSE] += np.multiply(along, q * dt / 2)
    P[:POSE, at] = P[at, :POSE]
    return q * dt**2 / 3


def _measure(x: Floats, P: Floats, at: int, value: float, sigma: float) -> None:
    """Takes a velocity from what was measured."""
    x[at] = value
    if P[at, at] != sigma**2:  # else nothing has been correlated with it since it was measured
        P[at], P[:, at] = 0.0, 0.0
        P[at, at] = sigma**2
