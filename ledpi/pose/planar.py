"""The two poses that a square's four corners allow, each as good as the corners, with its deviations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ledpi.core.geometry import (
    matrix_from_quaternion,
    quad_side,
    quaternion_from_matrix,
    rotation_angle_deg,
    rotation_vector,
)
from ledpi.core.lens import projected
from ledpi.core.records import Floats, Intrinsics, PlanarSolution, Pose, Rejected, read_only
from ledpi.pose import refine
from ledpi.pose.corners import whiteners

UNSOLVED = Rejected(stage="pose", reason="unsolved")
NOT_SQUARE = Rejected(stage="pose", reason="not_square")

# No square looks like four corners that its nearest pose misses by more, as a share of the side.
MAX_REPROJECTION = 0.04
# Where the refinement led both to one pose (a panel seen square on has but one): closer than this.
SAME_DEG = 0.1
# Eight coordinates less the six numbers of a pose; and the χ² that these exceed by chance once in a hundred times.
FREEDOM, SURPRISING = 2, 9.2
Z = 3.1  # deviations: noise goes further to one side once in a thousand times

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
    they err by more than they say. A minimum that is alone has its mirror image beside it.
    """
    found, solved = refine.fit_squares(corners_px, whiteners(covariances_px2), np.array(sides_m), intrinsics)
    both = [
        (_solution(one), _solution(other)) if there else None
        for (one, other), there in zip(found, solved.tolist(), strict=True)
    ]
    squares = [_Square(*seen, intrinsics) for seen in zip(corners_px, covariances_px2, sides_m, strict=True)]
    return [
        UNSOLVED if solutions is None else _checked(*solutions, square)
        for solutions, square in zip(both, squares, strict=True)
    ]


def _solution(numbers: Floats) -> PlanarSolution:
    """From what C has found."""
    return PlanarSolution(
        camera_from_marker=Pose(
            position_m=numbers[refine.POSITION],
            quaternion_wxyz=numbers[refine.QUATERNION],
            covariance=numbers[refine.COVARIANCE].reshape(6, 6),
        ),
        reprojection_px=float(numbers[refine.REPROJECTION]),
        chi2=float(numbers[refine.CHI2]),
    )


def solve_square(
    corners_px: Floats, covariance_px2: Floats, side_m: float, intrinsics: Intrinsics
) -> Solutions | Rejected:
    """`solve_squares` of one, `corners_px` (4, 2)."""
    return solve_squares(corners_px[None], covariance_px2[None], [side_m], intrinsics)[0]


class _Square(NamedTuple):
    """A square as it is seen."""

    corners_px: Floats  # (4, 2)
    covariance_px2: Floats  # (8, 8)
    side_m: float
    lens: Intrinsics


def _checked(one: PlanarSolution, other: PlanarSolution, square: _Square) -> Solutions | Rejected:
    best, second = (one, other) if one.chi2 <= other.chi2 else (other, one)
    if not best.camera_from_marker.position_m[2] > 0:
        return UNSOLVED
    least_deg = SAME_DEG
    if not (_apart_deg(best, second) > SAME_DEG and second.camera_from_marker.position_m[2] > 0):
        second = _mirrored(best, square)  # which the deviations include where it is within them
        least_deg = max(SAME_DEG, math.degrees(math.sqrt(np.trace(_covariance(best)[3:, 3:]))))
    if best.chi2 > SURPRISING:
        ratio = 1.0 + (best.chi2 - SURPRISING) / FREEDOM
        if _least_reprojection_px(square) > MAX_REPROJECTION * quad_side(square.corners_px.tolist()):
            return NOT_SQUARE
        best, second = _scaled(best, ratio), _scaled(second, ratio)
    way, are_apart = _way(best, second), _apart_deg(best, second) > least_deg
    return (_widened(best, way), _widened(second, way)) if are_apart else (_widened(best, way),)


def _least_reprojection_px(square: _Square) -> float:
    """Returns that of the pose nearest in pixels. The weighted one may be far off corners of which little is known."""
    whiten, side_m = whiteners(np.zeros((1, 8, 8))), np.array([square.side_m])
    found, _ = refine.fit_squares(square.corners_px[None], whiten, side_m, square.lens)
    return float(found[0, :, refine.REPROJECTION].min())


def _apart_deg(one: PlanarSolution, other: PlanarSolution) -> float:
    return rotation_angle_deg(one.camera_from_marker.quaternion_wxyz, other.camera_from_marker.quaternion_wxyz)


def _covariance(solution: PlanarSolution) -> Floats:
    covariance = solution.camera_from_marker.covariance
    assert covariance is not None
    return covariance


def _mirrored(solution: PlanarSolution, square: _Square) -> PlanarSolution:
    """The pose in which a square far away looks the same: half a turn about the line of sight, and about its own z."""
    pose = solution.camera_from_marker
    sight = pose.position_m / np.linalg.norm(pose.position_m)
    turned = (2.0 * np.outer(sight, sight) - np.eye(3)) @ matrix_from_quaternion(pose.quaternion_wxyz)
    rotation = turned * (-1.0, -1.0, 1.0)
    mirror = replace(pose, quaternion_wxyz=read_only(quaternion_from_matrix(rotation)))
    seen_px, _ = projected(square_corners(square.side_m) @ rotation.T + pose.position_m, square.lens)
    off_px = (square.corners_px - seen_px).ravel()
    left = whiteners(square.covariance_px2[None])[0] @ off_px
    return PlanarSolution(
        camera_from_marker=mirror, reprojection_px=float(np.linalg.norm(off_px)) / 2.0, chi2=float(left @ left)
    )


def _way(one: PlanarSolution, other: PlanarSolution) -> Floats:
    """(6,) from one pose to another: metres, and radians about the camera's axes."""
    a, b = one.camera_from_marker, other.camera_from_marker
    turn = matrix_from_quaternion(b.quaternion_wxyz) @ matrix_from_quaternion(a.quaternion_wxyz).T
    return np.concatenate([b.position_m - a.position_m, rotation_vector(turn)])


def _widened(solution: PlanarSolution, way: Floats) -> PlanarSolution:
    """The solution, its deviation towards the other one, along the way (6,) to it, as wide as χ² is there.

    A square's shape tells how far it is turned from the line of sight by the square of that: of two poses that are d
    apart χ² at x from the first is (x/s)²·(1 − x/d)², which the slopes there take for (x/s)². At Z deviations, but no
    further than half way, where the other one begins, both are made the same.
    """
    covariance = _covariance(solution)
    chi2 = float(way @ np.linalg.solve(covariance, way))
    if not chi2 > 0.0:
        return solution
    wider = (1.0 - min(Z / math.sqrt(chi2), 0.5)) ** -2 - 1.0
    covariance = read_only(covariance + wider / chi2 * np.outer(way, way))
    return replace(solution, camera_from_marker=replace(solution.camera_from_marker, covariance=covariance))


def _scaled(solution: PlanarSolution, ratio: float) -> PlanarSolution:
    """A solution by corners whose variances are so many times as large: they err as no pose explains.

    Something moved them that is in no covariance: what hides a side, the lens, a camera that shakes.
    """
    covariance = read_only(ratio * _covariance(solution))
    pose = replace(solution.camera_from_marker, covariance=covariance)
    return replace(solution, camera_from_marker=pose, chi2=solution.chi2 / ratio)
