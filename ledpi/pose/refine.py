"""Poses of squares by least squares: many at once, because one more in the same call costs next to nothing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ledpi.kernels import pose as kernel
from ledpi.kernels.library import compiled
from ledpi.records import Floats, Intrinsics

ROUNDS = 6
CONVERGED = 1e-3  # of χ² that a step would still gain, in a good fit: nothing that could be measured
BEATEN_BY = 60.0  # of χ²: e³⁰ times less likely than a rival, and so never believed, wherever it would end
STOP = np.array([ROUNDS, CONVERGED, BEATEN_BY])  # for the compiled loops
# A rotation that is known to no better than a radian is not known. Without this, a distant square seen face on,
# whose tilt changes nothing in the picture to first order, would have steps and deviations without bounds.
UNKNOWN_TURN = np.diag([0.0, 0, 0, 1, 1, 1])

# skew(v) = v @ _SKEW: the matrix of the cross product v × …
_SKEW = np.zeros((3, 9))
_SKEW[0, [5, 7]], _SKEW[1, [2, 6]], _SKEW[2, [1, 3]] = (-1, 1), (1, -1), (-1, 1)
_STILL, _DIAGONAL = np.zeros(3), np.eye(6)


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


def projected(points: Floats, intrinsics: Intrinsics) -> tuple[Floats, Floats]:
    """Pixels (…, 2) of points (…, 3) in the camera's frame, and their derivative (…, 2, 3) by the point."""
    shape = points.shape[:-1]
    matrix, distortion = intrinsics.matrix(), np.array(intrinsics.distortion)
    pixels, slopes = cv2.projectPoints(points.reshape(-1, 1, 3), _STILL, _STILL, matrix, distortion)[:2]
    return pixels.reshape(*shape, 2), slopes[:, 3:6].reshape(*shape, 2, 3)


def turned(rotations: Floats, turns: Floats) -> Floats:
    """`rotations` (K, 3, 3) turned further by small `turns` (K, 3) rad about fixed axes.

    Cayley's map: a rotation whatever the vector, and that by the vector to second order.
    """
    half = skew(0.5 * turns)
    scale = 2.0 / (1.0 + 0.25 * (turns * turns).sum(axis=1))
    result: Floats = rotations + scale[:, None, None] * ((half + half @ half) @ rotations)
    return result


def refine(
    rotations: Floats,
    positions: Floats,
    points: Floats,
    seen_px: Floats,
    whiteners: Floats,
    intrinsics: Intrinsics,
    at_most: int | None = None,
    rivals: int = 1,
) -> Fits:
    """The nearest best poses of K bodies of P points each: `points` (K, P, 3) in the body, `seen_px` (K, P, 2).

    Levenberg and Marquardt's method on the residuals that `whiteners` (K, P/4, 8, 8) make independent, four points at a
    time; what is the same for all bodies may have 1 for K. `at_most`: of more starts only the likeliest are followed.
    `rivals`: so many in a row are starts of one body; those that are beaten by far are not followed to their ends.
    Every pose returned is at least as good as the one that it began with.
    """
    damping = np.zeros(len(rotations))  # Marquardt's: 1 halves a step
    best = _Look.at(rotations, positions, points, seen_px, whiteners, intrinsics)
    if at_most is not None and len(rotations) > at_most:
        likeliest = np.argsort(best.chi2)[:at_most]
        best, damping = _Look(*(array[likeliest] for array in best)), damping[:at_most]
    for _ in range(ROUNDS):
        information = best.slopes.transpose(0, 2, 1) @ best.slopes + UNKNOWN_TURN
        pull = best.slopes.transpose(0, 2, 1) @ best.left
        damped = information + damping[:, None, None] * (information * _DIAGONAL)
        step = np.asarray(np.linalg.solve(damped, pull)[..., 0], np.float64)
        if _at_end(best.chi2, (step * pull[..., 0]).sum(axis=1), rivals):
            break
        moved = turned(best.rotations, step[:, 3:]), best.positions + step[:, :3]
        look = _Look.at(*moved, points, seen_px, whiteners, intrinsics)
        better = look.chi2 < best.chi2
        damping = np.where(better, 0.25 * damping, 1.0 + 4.0 * damping)
        best = look if better.all() else look.where(better, best)
    covariances = np.asarray(np.linalg.inv(information), np.float64)
    return Fits(best.rotations, best.positions, best.chi2, best.off_px, covariances)


def fit_body(
    rotations: Floats,
    positions: Floats,
    points: Floats,
    seen_px: Floats,
    whiteners: Floats,
    intrinsics: Intrinsics,
    at_most: int,
) -> Fits:
    """`refine` from K starts of one body: `points` (P, 3), `seen_px` (P, 2), `whiteners` (P/4, 8, 8)."""
    starts, most = (rotations, positions), min(at_most, len(rotations))
    if compiled():
        return Fits(*kernel.fit_body(*starts, points, seen_px, whiteners, intrinsics, most, STOP))
    return refine(*starts, points[None], seen_px[None], whiteners[None], intrinsics, at_most=most)


def _at_end(chi2: Floats, gain: Floats, rivals: int) -> bool:
    """Whether a step that gains so much (K,) would change nothing: too little, or of what is beaten with it too."""
    least = chi2.reshape(-1, rivals).min(axis=1).repeat(rivals)
    return bool(((gain < CONVERGED * (1.0 + chi2)) | (chi2 - gain > least + BEATEN_BY)).all())


class _Look(NamedTuple):
    """What there is to see from K poses."""

    rotations: Floats
    positions: Floats
    chi2: Floats
    off_px: Floats
    slopes: Floats  # (K, 2P, 6) of what is left, whitened, by position and turn, with the other sign
    left: Floats  # (K, 2P, 1) of the residuals, whitened

    @classmethod
    def at(
        cls, rotations: Floats, positions: Floats, points: Floats, seen_px: Floats, whiteners: Floats, lens: Intrinsics
    ) -> _Look:
        count = len(rotations)
        arms = points @ rotations.transpose(0, 2, 1)
        pixels, by_point = projected(arms + positions[:, None], lens)
        off_px = seen_px - pixels
        slopes = np.concatenate([by_point, -by_point @ skew(arms)], axis=-1)
        left = (whiteners @ off_px.reshape(count, -1, 8, 1)).reshape(count, -1, 1)
        slopes = (whiteners @ slopes.reshape(count, -1, 8, 6)).reshape(count, -1, 6)
        return cls(rotations, positions, (left * left).sum(axis=(1, 2)), off_px, slopes, left)

    def where(self, chosen: NDArray[np.bool_], other: _Look) -> _Look:
        pairs = zip(self, other, strict=True)
        return _Look(*(np.where(chosen.reshape(-1, *[1] * (a.ndim - 1)), a, b) for a, b in pairs))
