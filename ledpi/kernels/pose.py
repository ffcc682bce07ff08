"""The poses of squares, and what lenses do to their sides (squares.c, pose.c, lens.c)."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ledpi.kernels.library import INTEGER, POINTER, address, doubles, function
from ledpi.records import Floats, Intrinsics

_bends = function("ledpi_bends", POINTER, INTEGER, POINTER, POINTER)
_solve_squares = function("ledpi_solve_squares", POINTER, INTEGER, *(POINTER,) * 6)

# Where a solution's numbers are: its position, quaternion, reprojection_px, chi2, covariance.
POSITION, QUATERNION, REPROJECTION, CHI2, COVARIANCE = slice(0, 3), slice(3, 7), 7, 8, slice(9, 45)


@lru_cache(maxsize=16)
def lens_of(intrinsics: Intrinsics) -> Floats:
    """`Lens` of pose.h."""
    return np.array([intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy, *intrinsics.distortion])


def bends(corners: NDArray[np.complex128], lens: Intrinsics) -> NDArray[np.complex128]:
    """As `bends` of decode/sides.py."""
    corners, bent = np.ascontiguousarray(corners), np.empty((*corners.shape, 2), np.complex128)
    _bends(address(lens_of(lens)), len(corners), address(corners), address(bent))
    return bent


def solve_squares(
    corners_px: Floats, sigma_px: Floats, sides_m: Floats, intrinsics: Intrinsics, motions_px: Floats
) -> tuple[Floats, NDArray[np.bool_]]:
    """(N, 2, 45) read-only: both solutions of each square, and (N,) whether there are any."""
    count = len(corners_px)
    given = [lens_of(intrinsics), *(doubles(array) for array in (corners_px, sigma_px, sides_m, motions_px))]
    solutions, solved = np.empty((count, 2, COVARIANCE.stop)), np.empty(count, np.bool_)
    lens, *squares = (address(array) for array in given)
    _solve_squares(lens, count, *squares, address(solutions), address(solved))
    solutions.flags.writeable = False
    return solutions, solved
