"""The poses of squares (planar.c, refine.c)."""

from __future__ import annotations

import numpy as np

from ledpi.core.lens import lens_of
from ledpi.core.library import doubles, lib, pointer
from ledpi.core.records import Floats, Intrinsics, Mask

FIT = 49  # numbers: rotation, position, chi2, covariance
# Where a solution's numbers are: its position, quaternion, reprojection_px, chi2, covariance.
POSITION, QUATERNION, REPROJECTION, CHI2, COVARIANCE = slice(0, 3), slice(3, 7), 7, 8, slice(9, 45)


def solve_squares(
    corners_px: Floats, whiteners: Floats, sides_m: Floats, intrinsics: Intrinsics, stop: Floats
) -> tuple[Floats, Mask]:
    """(N, 2, 45) read-only: both solutions of each square, and (N,) whether there are any.

    `stop`: rounds, CONVERGED and BEATEN_BY of pose/refine.py.
    """
    count, squares = len(corners_px), (corners_px, whiteners, sides_m)
    solutions, solved = np.empty((count, 2, COVARIANCE.stop)), np.empty(count, np.bool_)
    lib.ledpi_solve_squares(
        *(pointer(lens_of(intrinsics)), pointer(stop), count, *(pointer(doubles(array)) for array in squares)),
        *(pointer(solutions), pointer(solved)),
    )
    solutions.flags.writeable = False
    return solutions, solved


def fit_body(
    rotations: Floats,
    positions: Floats,
    points: Floats,
    seen_px: Floats,
    whiteners: Floats,
    intrinsics: Intrinsics,
    at_most: int,
    stop: Floats,
) -> tuple[Floats, Floats, Floats, Floats, Floats]:
    """As `fit_body` of pose/refine.py: rotations, positions, chi2, residuals and covariances of the `at_most` best."""
    count = len(points)
    fits, off_px, room = np.empty((at_most, FIT)), np.empty((at_most, count, 2)), np.empty((2, count, 2))
    body = (pointer(doubles(array)) for array in (points, seen_px, whiteners))
    starts = (pointer(doubles(array)) for array in (rotations, positions))
    followed = lib.ledpi_fit_body(
        *(pointer(lens_of(intrinsics)), count, *body, len(rotations), *starts, at_most),
        *(pointer(stop), pointer(fits), pointer(off_px), pointer(room)),
    )
    fits = fits[:followed]
    turned, shifted, chi2, covariances = fits[:, :9], fits[:, 9:12], fits[:, 12], fits[:, 13:]
    return turned.reshape(-1, 3, 3), shifted, chi2, off_px[:followed], covariances.reshape(-1, 6, 6)
