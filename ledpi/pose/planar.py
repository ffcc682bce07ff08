"""The pose of one panel from its four corners."""

from __future__ import annotations

import cv2
import numpy as np

from ledpi.geometry import matrix_from_rotation_vector, quaternion_from_matrix, rotation_angle_deg
from ledpi.records import Floats, Intrinsics, PlanarSolution, Pose, Rejected, read_only

BEHIND = Rejected(stage="pose", reason="behind_camera")
UNSOLVED = Rejected(stage="pose", reason="unsolved")
NOT_SQUARE = Rejected(stage="pose", reason="not_square")

# What the edge fits do not show of a corner's error: the lens model, the panel's own build.
CORNER_FLOOR_PX = 0.1
# No square looks like four corners that its best pose misses by more: a share of the side, as at short exposure the
# rim's dark bands hide where it is, or a pixel.
MAX_REPROJECTION, MAX_REPROJECTION_PX = 0.04, 1.0
# The other solution is excluded where its squared residuals say that it is a thousand times less likely: 2·ln 1000.
EXCLUDED_BY = 13.8

# OpenCV hands rotations over as vectors, and its IPPE loses those of half a turn: just what an upright panel has that
# faces the camera. So the square is solved in a frame of its own, `seen`, whose x and y point right and down in the
# picture as nearly as quarter turns of the marker allow, z away from the camera: never near half a turn.
_QUARTER_TURN = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
_SEEN_FROM_MARKER = tuple(np.linalg.matrix_power(_QUARTER_TURN, k) @ np.diag([1.0, -1, -1]) for k in range(4))


def square_corners(side_m: float) -> Floats:
    """(4, 3) top left, top right, bottom right, bottom left of a panel in `marker`: x right, y up, z out of it."""
    half = side_m / 2
    return np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0.0]])


def solve_square(
    corners_px: Floats, corner_sigma_px: float, side_m: float, intrinsics: Intrinsics
) -> tuple[PlanarSolution, PlanarSolution | None] | Rejected:
    """camera_from_marker of a square, and the other planar solution where the corners do not exclude it.

    `corners_px` (4, 2) in the marker's order. Infinitesimal plane-based pose estimation (Collins & Bartoli, IJCV
    2014, as in OpenCV) gives both solutions.
    """
    square = square_corners(side_m)
    matrix, distortion = intrinsics.matrix(), np.array(intrinsics.distortion)
    first = int(np.argmin(corners_px.sum(axis=1)))  # nearest the picture's top left
    as_seen = np.roll(corners_px, -first, axis=0)[::-1]  # IPPE's order, in `seen`: bottom left first, anticlockwise
    count, turns, shifts, _ = cv2.solvePnPGeneric(square, as_seen, matrix, distortion, flags=cv2.SOLVEPNP_IPPE_SQUARE)
    finite = [(turns[i], shifts[i]) for i in range(count) if np.isfinite(turns[i]).all()]
    solutions: list[PlanarSolution] = []
    for turn, shift in finite:
        if float(shift[2, 0]) > 0:
            again = cv2.projectPoints(square, turn, shift, matrix, distortion)[0].reshape(4, 2)
            off_px = float(np.sqrt(np.square(again - as_seen).sum(axis=1).mean()))
            camera_from_marker = matrix_from_rotation_vector(turn.reshape(3)) @ _SEEN_FROM_MARKER[first]
            solutions.append(_solution(camera_from_marker, shift.reshape(3), off_px))
    if not solutions:
        return BEHIND if finite else UNSOLVED
    solutions.sort(key=lambda s: s.reprojection_px)
    best = solutions[0]
    side_px = float(np.hypot(*(np.roll(corners_px, -1, axis=0) - corners_px).T).mean())
    if best.reprojection_px > max(MAX_REPROJECTION_PX, MAX_REPROJECTION * side_px):
        return NOT_SQUARE
    if len(solutions) == 1:
        return best, None
    variance = corner_sigma_px**2 + CORNER_FLOOR_PX**2
    # Four corners: the sum of squared residuals is four times their mean square.
    apart = 4 * (solutions[1].reprojection_px ** 2 - best.reprojection_px**2) / variance
    return best, (solutions[1] if apart < EXCLUDED_BY and not _same(best, solutions[1]) else None)


def _same(a: PlanarSolution, b: PlanarSolution) -> bool:
    """Whether the refinement led both to one pose (a panel seen square on has but one): closer than 0.1°."""
    return rotation_angle_deg(a.camera_from_marker.quaternion_wxyz, b.camera_from_marker.quaternion_wxyz) < 0.1


def _solution(rotation: Floats, position_m: Floats, reprojection_px: float) -> PlanarSolution:
    pose = Pose(
        position_m=read_only(position_m), quaternion_wxyz=read_only(quaternion_from_matrix(rotation))
    )
    return PlanarSolution(camera_from_marker=pose, reprojection_px=reprojection_px)
