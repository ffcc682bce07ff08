"""The poses of squares, and what lenses do to their sides (planar.c, refine.c, lens.c)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ledpi.kernels.library import INTEGER, POINTER, address, doubles, function
from ledpi.records import Floats, Intrinsics, Mask

_bends = function("ledpi_bends", POINTER, INTEGER, POINTER, POINTER)
_fit_body = function(
    "ledpi_fit_body", POINTER, INTEGER, *(POINTER,) * 3, INTEGER, *(POINTER,) * 2, INTEGER, *(POINTER,) * 4,
    result=INTEGER,
)  # fmt: skip
_solve_squares = function("ledpi_solve_squares", *(POINTER,) * 3, INTEGER, *(POINTER,) * 7)

FIT = 49  # numbers: rotation, position, chi2, covariance
# Where a solution's numbers are: its position, quaternion, reprojection_px, chi2, covariance.
POSITION, QUATERNION, REPROJECTION, CHI2, COVARIANCE = slice(0, 3), slice(3, 7), 7, 8, slice(9, 45)


@lru_cache(maxsize=16)
def lens_of(intrinsics: Intrinsics) -> Floats:
    """`Lens` of pose.h."""
    return np.array([intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy, *intrinsics.distortion])


def bends(corners: NDArray[np.complex128], lens: Intrinsics) -> NDArray[np.complex128]:
    """(quads, 4, 2) what the lens does to the sides of quads (quads, 4), in complex numbers: `ledpi_bends`."""
    corners, bent = np.ascontiguousarray(corners), np.empty((*corners.shape, 2), np.complex128)
    _bends(address(lens_of(lens)), len(corners), address(corners), address(bent))
    return bent


def solve_squares(
    corners_px: Floats,
    sigma_px: Floats,
    size_sigma_px: Floats,
    sides_m: Floats,
    intrinsics: Intrinsics,
    motions_px: Floats,
    stop: Floats,
    errors: Floats,
) -> tuple[Floats, Mask]:
    """(N, 2, 45) read-only: both solutions of each square, and (N,) whether there are any.

    `stop`: rounds, CONVERGED and BEATEN_BY of pose/refine.py; `errors`: FLOOR_PX, KNOWN_BLUR_PX and BLUR_ERROR of
    pose/corners.py.
    """
    count = len(corners_px)
    squares_of = corners_px, sigma_px, size_sigma_px, sides_m, motions_px
    given = [lens_of(intrinsics), *(doubles(array) for array in squares_of)]
    solutions, solved = np.empty((count, 2, COVARIANCE.stop)), np.empty(count, np.bool_)
    lens, *squares = (address(array) for array in given)
    _solve_squares(lens, address(stop), address(errors), count, *squares, address(solutions), address(solved))
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
    given = [doubles(array) for array in (points, seen_px, whiteners, rotations, positions)]
    place, seen, whiten, turns, shifts = (address(array) for array in given)
    followed = _fit_body(
        *(address(lens_of(intrinsics)), count, place, seen, whiten, len(rotations), turns, shifts, at_most),
        *(address(stop), address(fits), address(off_px), address(room)),
    )
    fits = fits[:followed]
    turned, shifted, chi2, covariances = fits[:, :9], fits[:, 9:12], fits[:, 12], fits[:, 13:]
    return turned.reshape(-1, 3, 3), shifted, chi2, off_px[:followed], covariances.reshape(-1, 6, 6)
