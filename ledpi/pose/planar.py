"""The two poses that a square's four corners allow, each as good as the corners, with its deviations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ledpi.core.geometry import rotation_angle_deg
from ledpi.core.records import Floats, Intrinsics, PlanarSolution, Pose, Rejected, read_only
from ledpi.kernels import pose as kernel
from ledpi.pose.corners import whiteners
from ledpi.pose.refine import STOP

UNSOLVED = Rejected(stage="pose", reason="unsolved")
NOT_SQUARE = Rejected(stage="pose", reason="not_square")

# No square looks like four corners that its best pose misses by more: a share of the side, as at short exposure the
# rim's dark bands hide where it is, or a pixel.
MAX_REPROJECTION, MAX_REPROJECTION_PX = 0.04, 1.0
# Where the refinement led both to one pose (a panel seen square on has but one): closer than this.
SAME_DEG = 0.1
# Eight coordinates less the six numbers of a pose; and the χ² that these exceed by chance once in a hundred times.
FREEDOM, SURPRISING = 2, 9.2

Solutions = tuple[PlanarSolution, ...]  # one or two, the better first


def square_corners(side_m: float) -> Floats:
    """(4, 3) top left, top right, bottom right, bottom left of a panel in `marker`: x right, y up, z out of it."""
    half = side_m / 2
    return np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0.0]])


def solve_squares(
    corners_px: Floats, covariances_px2: Floats, sides_m: Sequence[float], intrinsics: Intrinsics
) -> list[Solutions | Rejected]:
    """camera_from_marker of each of N squares: one or two solutions, the better first, or why there is none.

    `corners_px` (N, 4, 2) in the marker's order, `covariances_px2` (N, 8, 8) of their coordinates. Infinitesimal
    plane-based pose estimation (Collins & Bartoli, IJCV 2014) gives both solutions of a square: the homography's value
    and slope at its centre give the pose but for a sign. Least squares, weighted as the corners' errors hang together,
    makes the best of each, and the covariance is (JᵀWJ)⁻¹ there; larger where corners that no pose explains show that
    they err by more than they say.
    """
    found, solved = kernel.solve_squares(corners_px, whiteners(covariances_px2), np.array(sides_m), intrinsics, STOP)
    both = [
        (_solution(one), _solution(other)) if there else None
        for (one, other), there in zip(found, solved.tolist(), strict=True)
    ]
    return [
        UNSOLVED if solutions is None else _checked(*solutions, corners, side_m, intrinsics)
        for solutions, corners, side_m in zip(both, corners_px, sides_m, strict=True)
    ]


def _solution(numbers: Floats) -> PlanarSolution:
    """From what C has found."""
    return PlanarSolution(
        camera_from_marker=Pose(
            position_m=numbers[kernel.POSITION],
            quaternion_wxyz=numbers[kernel.QUATERNION],
            covariance=numbers[kernel.COVARIANCE].reshape(6, 6),
        ),
        reprojection_px=float(numbers[kernel.REPROJECTION]),
        chi2=float(numbers[kernel.CHI2]),
    )


def solve_square(
    corners_px: Floats, covariance_px2: Floats, side_m: float, intrinsics: Intrinsics
) -> Solutions | Rejected:
    """`solve_squares` of one, `corners_px` (4, 2)."""
    return solve_squares(corners_px[None], covariance_px2[None], [side_m], intrinsics)[0]


def _least_reprojection_px(corners_px: Floats, side_m: float, lens: Intrinsics) -> float:
    """Of the pose that is nearest in pixels. The weighted one may be far off corners of which little is known."""
    found, _ = kernel.solve_squares(corners_px[None], whiteners(np.zeros((1, 8, 8))), np.array([side_m]), lens, STOP)
    return float(found[0, :, kernel.REPROJECTION].min())


def _checked(
    one: PlanarSolution, other: PlanarSolution, corners_px: Floats, side_m: float, lens: Intrinsics
) -> Solutions | Rejected:
    best, second = (one, other) if one.chi2 <= other.chi2 else (other, one)
    if not best.camera_from_marker.position_m[2] > 0:
        return UNSOLVED
    if best.reprojection_px > MAX_REPROJECTION_PX:
        corners = corners_px.tolist()
        side_px = math.fsum(math.dist(a, b) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)) / 4
        most_px = MAX_REPROJECTION * side_px
        if best.reprojection_px > most_px and _least_reprojection_px(corners_px, side_m, lens) > most_px:
            return NOT_SQUARE
    if best.chi2 > SURPRISING:
        ratio = 1.0 + (best.chi2 - SURPRISING) / FREEDOM
        best, second = _inflate_covariance(best, ratio), _inflate_covariance(second, ratio)
    poses = best.camera_from_marker, second.camera_from_marker
    apart = rotation_angle_deg(poses[0].quaternion_wxyz, poses[1].quaternion_wxyz)
    ahead = poses[1].position_m[2] > 0
    return (best, second) if ahead and apart > SAME_DEG else (best,)


def _inflate_covariance(solution: PlanarSolution, ratio: float) -> PlanarSolution:
    """Its variances so many times as large: as corners err that no pose explains.

    The camera moves, of which a single frame knows nothing, or something hides one of them.
    """
    pose = solution.camera_from_marker
    assert pose.covariance is not None
    return replace(solution, camera_from_marker=replace(pose, covariance=read_only(ratio * pose.covariance)))
