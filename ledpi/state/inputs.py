"""Inputs of the state: odometry, and panels in the plane that the robot drives in; height, roll and pitch are free."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ledpi.core.geometry import matrix_from_quaternion
from ledpi.core.records import Floats, MarkerPose, Pose, Rejected
from ledpi.pose.panel_map import MapPanel

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


def look_of(marker: MarkerPose, panel: MapPanel, base_from_camera: Floats) -> Look | Rejected:
    """Returns a panel's look; `base_from_camera` (4, 4) is the camera's seat."""
    poses = [each.camera_from_marker for each in (marker.solution, marker.alternate) if each is not None]
    if not poses or not all(_is_whole(pose) for pose in poses):
        return NO_POSE
    (pose, share, heading), *other = (_measured(each, panel, base_from_camera) for each in poses)
    mirror = other[0][0] if other else None
    return Look(marker.mid_exposure_ns, marker.detection.id, pose, mirror, share, heading)


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
