"""Poses of bodies by least squares (refine.c), and what their derivatives need elsewhere."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ledpi.core.records import Floats, Intrinsics
from ledpi.pose import solver

# Most end after three or four steps; where corners' errors hang together, as by an unknown motion, it may be twenty.
ROUNDS = 30
CONVERGED = 1e-3  # of χ² that a step would still gain, in a good fit: nothing that could be measured
BEATEN_BY = 60.0  # of χ²: e³⁰ times less likely than another start, and so never chosen, wherever it would end
STOP = np.array([ROUNDS, CONVERGED, BEATEN_BY])  # as C takes them

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
    starts, most = (rotations, positions), min(at_most, len(rotations))
    return Fits(*solver.fit_body(*starts, points, seen_px, whiteners, intrinsics, most, STOP))
