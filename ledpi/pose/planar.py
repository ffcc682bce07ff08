"""The two poses that a square's four corners allow, each as good as the corners, with its deviations."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from ledpi.geometry import quaternion_from_matrix, rotation_angle_deg
from ledpi.kernels import pose as kernel
from ledpi.kernels.library import compiled
from ledpi.pose.corners import ERRORS, whiteners
from ledpi.pose.refine import STOP, Fits, refine
from ledpi.records import Floats, Intrinsics, PlanarSolution, Pose, Rejected, read_only

UNSOLVED = Rejected(stage="pose", reason="unsolved")
NOT_SQUARE = Rejected(stage="pose", reason="not_square")

# No square looks like four corners that its best pose misses by more: a share of the side, as at short exposure the
# rim's dark bands hide where it is, or a pixel.
MAX_REPROJECTION, MAX_REPROJECTION_PX = 0.04, 1.0
# Where the refinement led both to one pose (a panel seen square on has but one): closer than this.
SAME_DEG = 0.1
# Eight coordinates less the six numbers of a pose; and the χ² that these exceed by chance once in a hundred times.
FREEDOM, SURPRISING = 2, 9.2

Vector = tuple[float, float, float]
Rows = tuple[Vector, Vector, Vector]
Solutions = tuple[PlanarSolution, ...]  # one or two, the better first


def square_corners(side_m: float) -> Floats:
    """(4, 3) top left, top right, bottom right, bottom left of a panel in `marker`: x right, y up, z out of it."""
    half = side_m / 2
    return np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0.0]])


def solve_squares(
    corners_px: Floats,
    sigma_px: Floats,
    size_sigma_px: Floats,
    sides_m: Sequence[float],
    intrinsics: Intrinsics,
    motions_px: Floats | None = None,
) -> list[Solutions | Rejected]:
    """camera_from_marker of each of N squares: one or two solutions, the better first, or why there is none.

    `corners_px` (N, 4, 2) in the marker's order, `sigma_px` (N,) the deviation of their coordinates, of which all sides
    share `size_sigma_px` (N,), `motions_px` (N, 4, 2) how far they move during the exposure. `ippe` gives both
    solutions of a square; least squares, weighted as the corners' errors hang together, makes the best of each, and the
    covariance is (JᵀWJ)⁻¹ there; larger where corners that no pose explains show that they err by more than they say.
    """
    if not compiled():
        both = _solved(corners_px, sigma_px, size_sigma_px, sides_m, intrinsics, motions_px)
    else:
        motions_px = np.zeros_like(corners_px) if motions_px is None else motions_px
        squares = corners_px, sigma_px, size_sigma_px, np.array(sides_m)
        found, solved = kernel.solve_squares(*squares, intrinsics, motions_px, STOP, ERRORS)
        both = [
            (_solution(one), _solution(other)) if there else None
            for (one, other), there in zip(found, solved.tolist(), strict=True)
        ]
    return [
        UNSOLVED if solutions is None else _checked(*solutions, corners)
        for solutions, corners in zip(both, corners_px, strict=True)
    ]


def _solution(numbers: Floats) -> PlanarSolution:
    """From what the compiled loops have found."""
    return PlanarSolution(
        camera_from_marker=Pose(
            position_m=numbers[kernel.POSITION],
            quaternion_wxyz=numbers[kernel.QUATERNION],
            covariance=numbers[kernel.COVARIANCE].reshape(6, 6),
        ),
        reprojection_px=float(numbers[kernel.REPROJECTION]),
        chi2=float(numbers[kernel.CHI2]),
    )


def _solved(
    corners_px: Floats,
    sigma_px: Floats,
    size_sigma_px: Floats,
    sides_m: Sequence[float],
    intrinsics: Intrinsics,
    motions_px: Floats | None,
) -> list[tuple[PlanarSolution, PlanarSolution] | None]:
    """Both solutions of each square, or None."""
    rays = cv2.undistortPoints(corners_px.reshape(-1, 1, 2), intrinsics.matrix(), np.array(intrinsics.distortion))
    starts = [ippe(xy, side_m) for xy, side_m in zip(rays.reshape(-1, 4, 2).tolist(), sides_m, strict=True)]
    solved = [i for i, start in enumerate(starts) if start is not None]
    results: list[tuple[PlanarSolution, PlanarSolution] | None] = [None] * len(starts)
    if not solved:
        return results
    of = np.repeat(solved, 2)
    found = [start for start in starts if start is not None]
    fits = refine(
        np.array([turn for first, second, _ in found for turn in (first, second)]),
        np.array([position for *_, position in found for _ in range(2)]),
        square_corners(1.0) * np.array(sides_m)[of][:, None, None],
        corners_px[of],
        whiteners(corners_px, sigma_px, size_sigma_px, motions_px)[of, None],
        intrinsics,
        rivals=2,
    )
    both = _solutions(fits)
    for k, i in enumerate(solved):
        results[i] = both[2 * k], both[2 * k + 1]
    return results


def solve_square(
    corners_px: Floats, corner_sigma_px: float, side_m: float, intrinsics: Intrinsics
) -> Solutions | Rejected:
    """`solve_squares` of one, `corners_px` (4, 2), whose sides err independently."""
    return solve_squares(corners_px[None], np.array([corner_sigma_px]), np.zeros(1), [side_m], intrinsics)[0]


def ippe(corners_xy: Sequence[Sequence[float]], side_m: float) -> tuple[Rows, Rows, Vector] | None:
    """Both rotations (rows of a matrix) and the position that a square's corners leave open; None where it has no area.

    `corners_xy`: four (x/z, y/z) in the marker's order. Infinitesimal plane-based pose estimation (Collins & Bartoli,
    IJCV 2014): the homography's value and slope at the square's centre give the pose but for a sign. In scalars, as no
    array is worth its overhead here; OpenCV's own hands rotations over as vectors and loses those of half a turn, which
    is just what an upright panel has that faces the camera.
    """
    seen = _centre_and_slope(corners_xy, side_m)
    if seen is None:
        return None
    (qx, qy), (j00, j10, j01, j11) = seen
    # Turn the view until the centre is straight ahead: V takes z there, and the slope becomes A = R₂₂/depth.
    n = math.sqrt(1.0 + qx * qx + qy * qy)
    a, b, c = qx / n, qy / n, 1.0 / n
    k = 1.0 / (1.0 + c)
    v00, v01, v11 = 1.0 - a * a * k, -a * b * k, 1.0 - b * b * k
    b00, b01, b10, b11 = v00 + qx * a, v01 + qx * b, v01 + qy * a, v11 + qy * b
    det = b00 * b11 - b01 * b10
    a00, a01 = (b11 * j00 - b01 * j10) / det, (b11 * j01 - b01 * j11) / det
    a10, a11 = (b00 * j10 - b10 * j00) / det, (b00 * j11 - b10 * j01) / det
    # The larger singular value of A is 1/depth, as that of R₂₂ is 1.
    square_sum, product = a00 * a00 + a01 * a01 + a10 * a10 + a11 * a11, a00 * a11 - a01 * a10
    depth = 1.0 / math.sqrt(0.5 * (square_sum + math.sqrt(max(0.0, square_sum * square_sum - 4.0 * product * product))))
    r00, r01, r10, r11 = a00 * depth, a01 * depth, a10 * depth, a11 * depth
    # R's columns have length 1 and are square to each other: that leaves the third row's sign.
    r20 = math.sqrt(max(0.0, 1.0 - r00 * r00 - r10 * r10))
    r21 = math.copysign(math.sqrt(max(0.0, 1.0 - r01 * r01 - r11 * r11)), -(r00 * r01 + r10 * r11))
    turns = []
    for e, f in ((r20, r21), (-r20, -r21)):
        x, y, z = r10 * f - e * r11, e * r01 - r00 * f, r00 * r11 - r10 * r01
        turns.append(
            (
                (v00 * r00 + v01 * r10 + a * e, v00 * r01 + v01 * r11 + a * f, v00 * x + v01 * y + a * z),
                (v01 * r00 + v11 * r10 + b * e, v01 * r01 + v11 * r11 + b * f, v01 * x + v11 * y + b * z),
                (c * e - a * r00 - b * r10, c * f - a * r01 - b * r11, c * z - a * x - b * y),
            )
        )
    return turns[0], turns[1], (qx * depth, qy * depth, depth)


def _centre_and_slope(
    corners_xy: Sequence[Sequence[float]], side_m: float
) -> tuple[tuple[float, float], tuple[float, float, float, float]] | None:
    """Where (x/z, y/z) a square's centre is seen, and how both change with x there, and with y, in metres.

    By the homography of the unit square, u from the top left to the top right, v to the bottom left (Heckbert 1989).
    """
    (x0, y0), (x1, y1), (x2, y2), (x3, y3) = corners_xy
    d1x, d1y, d2x, d2y = x1 - x2, y1 - y2, x3 - x2, y3 - y2
    sx, sy = x0 - x1 + x2 - x3, y0 - y1 + y2 - y3
    area = d1x * d2y - d1y * d2x
    if abs(area) < 1e-12:
        return None
    g, h = (sx * d2y - sy * d2x) / area, (d1x * sy - d1y * sx) / area
    ax, ay, bx, by = x1 - x0 + g * x1, y1 - y0 + g * y1, x3 - x0 + h * x3, y3 - y0 + h * y3
    w = 1.0 + 0.5 * (g + h)
    if not w > 0:
        return None
    qx, qy = (0.5 * (ax + bx) + x0) / w, (0.5 * (ay + by) + y0) / w
    per_m = 1.0 / (w * side_m)
    slope = ((ax - g * qx) * per_m, (ay - g * qy) * per_m, (h * qx - bx) * per_m, (h * qy - by) * per_m)
    return (qx, qy), slope


def _solutions(fits: Fits) -> list[PlanarSolution]:
    off_px = np.sqrt((fits.residuals_px * fits.residuals_px).sum(axis=(1, 2)) / 4)
    numbers = zip(fits.rotations, fits.positions, fits.covariances, off_px.tolist(), fits.chi2.tolist(), strict=True)
    return [
        PlanarSolution(
            camera_from_marker=Pose(
                position_m=read_only(position),
                quaternion_wxyz=read_only(quaternion_from_matrix(rotation)),
                covariance=read_only(covariance),
            ),
            reprojection_px=off,
            chi2=chi2,
        )
        for rotation, position, covariance, off, chi2 in numbers
    ]


def _checked(one: PlanarSolution, other: PlanarSolution, corners_px: Floats) -> Solutions | Rejected:
    best, second = (one, other) if one.chi2 <= other.chi2 else (other, one)
    if not best.camera_from_marker.position_m[2] > 0:
        return UNSOLVED
    if best.reprojection_px > MAX_REPROJECTION_PX:
        corners = corners_px.tolist()
        side_px = math.fsum(math.dist(a, b) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)) / 4
        if best.reprojection_px > MAX_REPROJECTION * side_px:
            return NOT_SQUARE
    if best.chi2 > SURPRISING:
        ratio = 1.0 + (best.chi2 - SURPRISING) / FREEDOM
        best, second = _less_sure(best, ratio), _less_sure(second, ratio)
    poses = best.camera_from_marker, second.camera_from_marker
    apart = rotation_angle_deg(poses[0].quaternion_wxyz, poses[1].quaternion_wxyz)
    ahead = poses[1].position_m[2] > 0
    return (best, second) if ahead and apart > SAME_DEG else (best,)


def _less_sure(solution: PlanarSolution, ratio: float) -> PlanarSolution:
    """Its variances so many times as large: as corners err that no pose explains.

    The camera moves, of which a single frame knows nothing, or something hides one of them.
    """
    pose = solution.camera_from_marker
    assert pose.covariance is not None
    return replace(solution, camera_from_marker=replace(pose, covariance=read_only(ratio * pose.covariance)))
