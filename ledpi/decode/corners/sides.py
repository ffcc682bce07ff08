"""The four sides of quads in the picture: light across them, straight lines through what was found there, corners.

Points are complex numbers, x + iy: a side is the difference of two, and i times its direction is the normal into the
square, as corners run clockwise in the picture, where y points down.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ledpi.geometry import distort
from ledpi.kernels import light as kernel
from ledpi.kernels import pose as lens
from ledpi.kernels.library import compiled
from ledpi.records import Floats, Frame, Intrinsics, Mask, Pixels, Singles
from ledpi.tone import linear_light

Points = NDArray[np.complex128]
Coordinates = NDArray[np.complex64]

NEXT = np.array([1, 2, 3, 0])
BEFORE = np.array([3, 0, 1, 2])
OPPOSITE = np.array([2, 3, 0, 1])
REACH_PX = 8.0  # around corners: as far as any profile across the sides may reach
BIWEIGHT = 4.7  # Tukey's, in standard deviations: what lies further off a line does not count
LEAST_SPREAD_PX = 0.03  # profiles that agree better than their noise lets them must not throw out the others


def as_points(corners: Floats) -> Points:
    """(…, 2) as complex numbers (…)."""
    return np.ascontiguousarray(corners, np.float64).view(np.complex128)[..., 0]


def as_corners(points: Points) -> Floats:
    """Complex numbers (…) as (…, 2)."""
    corners: Floats = np.ascontiguousarray(points)[..., None].view(np.float64)
    return corners


@dataclass(frozen=True, slots=True)
class Sides:
    """The sides of N quads; side k runs from corner k to the next."""

    start: Points  # (N, 4)
    along: Points  # (N, 4) to the next corner
    length: Floats  # (N, 4)
    inward: Points  # (N, 4) unit normals

    @classmethod
    def of(cls, corners: Points) -> Sides:
        """Corners (N, 4), clockwise in the picture. Where two coincide, the normal is zero."""
        along = corners[:, NEXT] - corners
        length = np.abs(along)
        return cls(corners, along, length, 1j * along / np.maximum(length, 1e-9))

    def moved(self, middle: Floats, slope: Floats) -> Points:
        """Corners (N, 4) after each side has moved inward by middle + slope·(share of the way along it − ½)."""
        start = self.start + self.inward * (middle - 0.5 * slope)
        along = self.along + self.inward * slope
        before, before_along = start[:, BEFORE], along[:, BEFORE]
        share = cross(start - before, along) / cross(before_along, along)
        corners: Points = before + before_along * share
        return corners


def cross(a: Points, b: Points) -> Floats:
    """x_a·y_b − y_a·x_b: positive where b turns clockwise from a, in the picture."""
    product: Floats = (a.conj() * b).imag
    return product


def areas(corners: Points) -> Floats:
    """Signed area of quads (…, 4), positive where they run clockwise in the picture."""
    return 0.5 * cross(corners[..., 2] - corners[..., 0], corners[..., 3] - corners[..., 1])


def bends(corners: Points, intrinsics: Intrinsics | None) -> Points:
    """(N, 4, 2) where the lens moves the points at a third and two thirds of each side, off the line between its ends.

    In pixels: along the side, and inward as the imaginary part. That changes so slowly over the picture that it is
    taken where the lens would put these corners, instead of undistorting them first.
    """
    if intrinsics is None or not any(intrinsics.distortion):
        return np.zeros((*corners.shape, 2), np.complex128)
    if compiled():
        return lens.bends(corners, intrinsics)
    rays = as_points((as_corners(corners) - (intrinsics.cx, intrinsics.cy)) / (intrinsics.fx, intrinsics.fy))
    points = rays[..., None] + (rays[:, NEXT] - rays)[..., None] * (0, 1 / 3, 2 / 3)
    bent = as_points(distort(as_corners(points), intrinsics))
    start = bent[..., :1]
    along = start[:, NEXT] - start
    away = bent[..., 1:] - start - along * (1 / 3, 2 / 3)
    moved: Points = away * along.conj() / np.maximum(np.abs(along), 1e-9)
    return moved


def points_across(sides: Sides, share: Floats, across: Floats, bend: Floats | float = 0.0) -> Coordinates:
    """(N, 4, P, T) points of P profiles, at the places `across` (N or 1, T), in pixels inward from each side.

    `bend` (N, 4, P) is added to these.
    """
    start = sides.start[..., None] + sides.along[..., None] * share + sides.inward[..., None] * bend
    inward = sides.inward[..., None] * across[:, None]
    points: Coordinates = start.astype(np.complex64)[..., None] + inward.astype(np.complex64)[:, :, None]
    return points


class Patches:
    """The linear light around each of N quads. Points within are counted from its own first pixel."""

    def __init__(self, frame: Frame, corners: Points, reach_px: float) -> None:
        """All that is up to `reach_px` around the `corners` (N, 4). The compiled loops read the frame itself."""
        self._frame = frame
        self._compiled = kernel.can_read(frame)
        if self._compiled:
            self.first: Points = np.zeros((len(corners), 1), np.complex128)  # (N, 1) where each begins
            return
        height, width = frame.pixels.shape
        table = linear_light(frame.transfer, mark_saturated=False)
        self._linear: list[Pixels] = []
        first = []
        for xs, ys in zip(corners.real.tolist(), corners.imag.tolist(), strict=True):
            x0, y0 = (min(max(int(min(ends) - reach_px), 0), size - 2) for ends, size in ((xs, width), (ys, height)))
            x1, y1 = (max(int(max(ends) + reach_px) + 2, start + 2) for ends, start in ((xs, x0), (ys, y0)))
            self._linear.append(cv2.LUT(frame.pixels[y0:y1, x0:x1], table))
            first.append(complex(x0, y0))
        self.first = np.array(first)[:, None]

    def light_at(self, points: Coordinates) -> Singles:
        """Bilinear, at (N, …); beyond the picture as at its border."""
        if self._compiled:
            return kernel.light_at(self._frame, points)
        light = np.empty(points.shape, np.float32)
        for linear, at, into in zip(self._linear, points, light, strict=True):
            into[...] = cv2.remap(linear, as_map(at), None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).reshape(
                into.shape
            )
        return light


def roughly_light_at(frame: Frame, points: Coordinates) -> Singles:
    """As `Patches.light_at`; in numpy between the codes of pixels: not exact, and no more is touched than that."""
    if kernel.can_read(frame):
        return kernel.light_at(frame, points)
    codes = cv2.remap(frame.pixels, as_map(points), None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    light: Singles = cv2.LUT(codes, linear_light(frame.transfer, mark_saturated=False)).reshape(points.shape)
    return light


def as_map(points: Coordinates) -> Singles:
    """As OpenCV has them: (rows, columns, 2)."""
    return points.view(np.float32).reshape(-1, points.shape[-1], 2)


@dataclass(frozen=True, slots=True, eq=False)
class Shares:
    """Where sides are looked across: at these shares of the way along each."""

    share: Floats  # (P,)
    powers: Floats  # (P, 3) of share − ½: 1, first, second
    bend: Floats  # (2, P) by what either of `bends` moves each place: cubics that are 0 at the side's ends

    @classmethod
    def at(cls, share: Floats) -> Shares:
        x = share - 0.5
        first, second = share - 1 / 3, share - 2 / 3
        bend = 13.5 * share * (share - 1) * np.array([second, -first])
        return cls(share, np.stack([np.ones_like(x), x, x * x], axis=1), bend)


def fit_lines(shares: Shares, found: Floats, weights: Floats) -> tuple[Floats, Floats]:
    """Lines through `found` (N, 4, P; pixels inward) by weighted least squares: (N, 4) at half of each side, and slope.

    The slope is that over the side's length.
    """
    moments, products = weights @ shares.powers, (weights * found) @ shares.powers[:, :2]
    n, x1, x2, y0, y1 = moments[..., 0], moments[..., 1], moments[..., 2], products[..., 0], products[..., 1]
    slope = (n * y1 - x1 * y0) / np.maximum(n * x2 - x1 * x1, 1e-12)
    return (y0 - slope * x1) / np.maximum(n, 1e-12), slope


def near_median(found: Floats, good: Mask, distance: Floats | float) -> Mask:
    """Which of the `good` of `found` (N, 4, P) are so near their side's median: a first guess that half may spoil."""
    ordered = np.sort(np.where(good, found, np.inf), axis=-1).reshape(-1, good.shape[-1])
    middle = np.maximum(good.sum(axis=-1).reshape(-1) - 1, 0) // 2
    median = ordered[np.arange(len(ordered)), middle].reshape(*good.shape[:-1], 1)
    near: Mask = good & (np.abs(found - np.where(np.isfinite(median), median, 0.0)) < distance)
    return near


def deviations(shares: Shares, found: Floats, good: Mask, middle: Floats, slope: Floats) -> tuple[Floats, Floats]:
    """Standard deviation (N, 4) of the `good` of `found` about lines, and the weights (N, 4, P) that each deserves.

    The deviation is that of the median distance (normal: 1.4826 of it), the weights are Tukey's biweight: what a
    textured wall or a gap between cells has led astray has none.
    """
    away = np.abs(found - middle[..., None] - slope[..., None] * shares.powers[:, 1])
    ordered = np.sort(np.where(good, away, np.inf), axis=-1).reshape(-1, good.shape[-1])
    median = np.maximum(good.sum(axis=-1).reshape(-1) - 1, 0) // 2
    spread = 1.4826 * ordered[np.arange(len(ordered)), median].reshape(middle.shape)
    spread = np.minimum(spread, 1e3)  # none is good
    u = away / (BIWEIGHT * np.maximum(spread, LEAST_SPREAD_PX))[..., None]
    return spread, good * np.square(np.maximum(0.0, 1.0 - u * u))
