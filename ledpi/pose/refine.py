"""Poses of squares and of bodies by least squares (planar.c, refine.c), and what their derivatives need elsewhere."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ledpi.core.lens import lens_of
from ledpi.core.library import doubles, lib, pointer
from ledpi.core.records import Floats, Intrinsics, Mask

# Most end after three or four steps; where corners' errors hang together, as by an unknown motion, it may be twenty.
ROUNDS = 30
CONVERGED = 1e-3  # of χ² that a step would still gain, in a good fit: nothing that could be measured
BEATEN_BY = 60.0  # of χ²: e³⁰ times less likely than another start, and so never chosen, wherever it would end
_STOP = np.array([ROUNDS, CONVERGED, BEATEN_BY])  # as C takes them
_FIT = 49  # numbers: rotation, position, chi2, covariance
# Where a square's solution has its position, quaternion, reprojection_px, chi2, covariance.
POSITION, QUATERNION, REPROJECTION, CHI2, COVARIANCE = slice(0, 3), slice(3, 7), 7, 8, slice(9, 45)

# skew(v) = v @ _SKEW: the matrix of the cross product v × …
_SKEW = np.zeros((3, 9))
_SKEW[0, [5, 7]], _SKEW[1, [2, 6]], _SKEW[2, [1, 3]] = (-1, 1), (1, -1), (-1, 1)


@dataclass(frozen=True, slots=True)
class Fits:
    """K poses a_from_b, each of its own measurements."""

    rotations: Floats  # (K, 3, 3)
    positions: Floats  # (K, 3)
    chi2: Floats  # (K,) squared residuals over their variances
    residuals_px: Floats  # (K, P, 2)
    covariances: Floats  # (K, 6, 6): position, rotation about the fixed axes of a


def skew(vectors: Floats) -> Floats:
    """(…, 3, 3): skew(v) @ u = v × u."""
    matrices: Floats = (vectors @ _SKEW).reshape(*vectors.shape, 3)
    return matrices


def turned(rotations: Floats, turns: Floats) -> Floats:
    """`rotations` (K, 3, 3) turned further by small `turns` (K, 3) rad about fixed axes.

    Cayley's map: a rotation whatever the vector, and that by the vector to second order.
    """
    half = skew(0.5 * turns)
    scale = 2.0 / (1.0 + 0.25 * (turns * turns).sum(axis=1))
    result: Floats = rotations + scale[:, None, None] * ((half + half @ half) @ rotations)
    return result


def fit_body(
    rotations: Floats,
    positions: Floats,
    points: Floats,
    seen_px: Floats,
    whiteners: Floats,
    intrinsics: Intrinsics,
    at_most: int,
) -> Fits:
    """The nearest best poses of a body from K starts: `points` (P, 3) in it, `seen_px` (P, 2), `whiteners` (P/4, 8, 8).

    Levenberg and Marquardt's method on the residuals that the whiteners make independent, four points at a time: with r
    these and J their slopes by position and turn, steps (JᵀJ + λ·diag JᵀJ)⁻¹Jᵀr, and the covariance (JᵀJ)⁻¹. A turn
    that is known to no better than a radian is not known: to JᵀJ that is added, or a distant square seen face on would
    have steps and deviations without bounds. `at_most`: of more starts only the likeliest are followed. Every pose
    returned is at least as good as the one that it began with.
    """
    count, most = len(points), min(at_most, len(rotations))
    fits, off_px, room = np.empty((most, _FIT)), np.empty((most, count, 2)), np.empty((2, count, 2))
    body = (pointer(doubles(array)) for array in (points, seen_px, whiteners))
    starts = (pointer(doubles(array)) for array in (rotations, positions))
    followed = lib.ledpi_fit_body(
        *(pointer(lens_of(intrinsics)), count, *body, len(rotations), *starts, most),
        *(pointer(_STOP), pointer(fits), pointer(off_px), pointer(room)),
    )
    fits = fits[:followed]
    turns, covariances = fits[:, :9].reshape(-1, 3, 3), fits[:, 13:].reshape(-1, 6, 6)
    return Fits(turns, fits[:, 9:12], fits[:, 12], off_px[:followed], covariances)


def fit_squares(corners_px: Floats, whiteners: Floats, sides_m: Floats, intrinsics: Intrinsics) -> tuple[Floats, Mask]:
    """(N, 2, 45) read-only: both solutions of each square, and (N,) whether there are any."""
    count, squares = len(corners_px), (corners_px, whiteners, sides_m)
    solutions, solved = np.empty((count, 2, COVARIANCE.stop)), np.empty(count, np.bool_)
    lib.ledpi_solve_squares(
        *(pointer(lens_of(intrinsics)), pointer(_STOP), count, *(pointer(doubles(array)) for array in squares)),
        *(pointer(solutions), pointer(solved)),
    )
    solutions.flags.writeable = False
    return solutions, solved
