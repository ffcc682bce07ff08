"""Where the cells of a panel meet: how far off each line between two of them is from where the corners have it.

Light is the same on both sides of such a line, whatever cells look like: darker at the wall, if there is one, brighter
towards either cell's middle. So the line is where light is most alike on both sides, and nothing that is outside the
panel can move it. With h the usual light at a distance t from a line, and h' its slope, light across a line that is off
by e is to first order

    p(t) = h(t) − e·h'(t) + odd nuisances + noise

h is the even part of what is seen, the mean of all lines that run the same way; e is found in the odd part. The
nuisances are that one cell is brighter than the other, and that bands make light slope. Without walls, where cells are
as bright at their rim as in their middle, or where blur leaves nothing of either, h is flat and says nothing of e; its
variance says that.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np

from ledpi.decode.corners.sides import Coordinates, Patches, Points, as_corners, as_points
from ledpi.geometry import distort, unit_square_to
from ledpi.records import Floats, Intrinsics

# How far light is looked at on either side: a wall and its blur. Bands 12 rows long are straight over 4, nearly; beyond
# the middle of a cell is what its other end looks like.
REACH_PX, REACH_CELLS = 4.0, 0.5
STEPS = 8  # within that
PLACES = np.linspace(0.15, 0.85, 6)  # along each cell, away from where four meet
BLUR_PX = 1.2  # of the step from one cell's light to the other's, as a hyperbolic tangent's
MOST_UNEVEN = 0.4  # half the difference of two cells' light over its mean: more, and one of them is dead or hidden
LEAST_LIGHT = 0.3  # of the median of all lines
LEAST_CONTRAST = 1e-4  # of Σ h'², with h about 1 and t in pixels: less is nothing
NOT_SEEN_PX2 = 1e4  # variance of what is not measured


@dataclass(frozen=True, slots=True, eq=False)
class Homographies:
    """(u, v) of N unit squares → pixels x + iy: (first·u + second·v + start) / (g·u + h·v + 1)."""

    top: Points  # (N, 3): first, second, start
    bottom: Floats  # (N, 2): g, h

    @classmethod
    def of(cls, corners: Points) -> Homographies:
        """Corners (N, 4): of (0, 0), (1, 0), (1, 1), (0, 1)."""
        matrices = np.array([unit_square_to(quad) for quad in as_corners(corners)])
        return cls(matrices[:, 0] + 1j * matrices[:, 1], matrices[:, 2, :2])

    def at(self, u: Floats, v: Floats) -> tuple[Points, Points, Points]:
        """Pixels (N, K) of places (K,), and their derivatives by u and by v."""
        (first, second, start), (g, h) = self.top.T[..., None], self.bottom.T[..., None]
        across = 1.0 / (g * u + h * v + 1.0)
        pixels = (first * u + second * v + start) * across
        return pixels, (first - g * pixels) * across, (second - h * pixels) * across


@cache
def line_places(cells: int) -> tuple[Floats, Floats]:
    """u, v (K,) of the middle of each cell's share of each line: first the lines along v, then those along u."""
    line, middle = np.meshgrid(np.arange(1, cells) / cells, (np.arange(cells) + 0.5) / cells, indexing="ij")
    return np.concatenate([line, middle]).reshape(-1), np.concatenate([middle, line]).reshape(-1)


def lens_moves(corners: Points, cells: int, intrinsics: Intrinsics | None) -> Points:
    """(N, K) pixels by which the lens moves the `line_places` off where corners (N, 4) in the picture have them.

    As with the sides' `bends`, taken where the lens would put these corners: it changes slowly over the picture.
    """
    u, v = line_places(cells)
    if intrinsics is None or not any(intrinsics.distortion):
        return np.zeros((len(corners), len(u)), np.complex128)
    inner = Homographies.of(corners).at(u, v)[0]
    pixels = as_corners(np.concatenate([corners, inner], axis=1))
    seen = as_points(distort((pixels - (intrinsics.cx, intrinsics.cy)) / (intrinsics.fx, intrinsics.fy), intrinsics))
    moved: Points = seen[:, 4:] - Homographies.of(seen[:, :4]).at(u, v)[0]
    return moved


def inner_lines(
    patches: Patches, homographies: Homographies, pitch_px: Floats, moved_px: Points, cells: int
) -> tuple[Floats, Floats]:
    """How far each of the `line_places` is off, (N, K) pixels along u or along v, and its variance.

    `pitch_px` (N, 2) of the cells along u and v, `moved_px` (N, K) what the lens does to them.
    """
    reach = np.minimum(REACH_CELLS, REACH_PX / pitch_px)  # (N, 2), in cells
    light = _light_across(patches, homographies, reach, moved_px.reshape(-1, 2, cells - 1, cells), cells)
    level = light[..., 2:-2].mean(axis=-1)  # (N, 2, lines, cells)
    light = light / np.maximum(level, 1e-6)[..., None]
    before, after = light[..., STEPS + 2 :: -1], light[..., STEPS + 2 :]  # from the line outward
    odd = 0.5 * (after - before)[..., 1:-2]
    usual = LEAST_LIGHT * np.median(level, axis=(2, 3), keepdims=True)
    shown = (level > usual) & (np.abs(odd).mean(axis=-1) < MOST_UNEVEN)
    off, variance = _shifts(0.5 * (after + before), odd, shown, reach * pitch_px / STEPS)
    return off.reshape(len(off), -1), np.where(shown, variance[..., None, None], NOT_SEEN_PX2).reshape(len(off), -1)


def _light_across(
    patches: Patches, homographies: Homographies, reach: Floats, moved_px: Points, cells: int
) -> Floats:
    """(N, 2, lines, cells, T) light, its mean over each cell's length, up to two steps beyond `reach` off each line."""
    steps = np.arange(-STEPS - 2, STEPS + 3) / STEPS
    lines = np.arange(1, cells)[:, None]
    across = ((lines + reach[:, :, None, None] * steps) / cells)[:, :, :, None, None]  # (N, 2, lines, 1, 1, T)
    along = ((np.arange(cells)[:, None] + PLACES) / cells)[..., None]  # (cells, places, 1)
    # Lines along v are crossed by u, the others by v.
    (by_across, by_along), (g, h) = (
        (first[:, :, None, None, None, None], first[:, ::-1, None, None, None, None])
        for first in (homographies.top[:, :2], homographies.bottom)
    )
    start = homographies.top[:, 2, None, None, None, None, None]
    seen = (by_across * across + by_along * along + start) / (g * across + h * along + 1.0)
    points: Coordinates = (seen + moved_px[..., None, None]).astype(np.complex64)
    light = patches.light_at(points.reshape(len(points), -1, len(steps))).reshape(points.shape)
    mean: Floats = light.mean(axis=4, dtype=np.float64)
    return mean


def _shifts(even: Floats, odd: Floats, shown: Floats, step_px: Floats) -> tuple[Floats, Floats]:
    """e (N, 2, lines, cells) in pixels, and its variance (N, 2), from the parts of light across the lines.

    `odd` from the first step to the last, `even` from none to two more.
    """
    # The slope is of what noise is in, too: the product of two halves' slopes has no noise of its own in its mean.
    halves = []
    for some in (slice(0, None, 2), slice(1, None, 2)):
        counted = shown[..., some, None]
        total = (even[..., some, :] * counted).sum(axis=(2, 3))
        halves.append(total / np.maximum(counted.sum(axis=(2, 3)), 1))
    usual = 0.5 * (halves[0] + halves[1])[..., 1:-2]
    slopes = [_slope(half) / step_px[..., None] for half in halves]
    away = step_px[..., None] * np.arange(1, STEPS + 1)
    sloping = _unit(usual * away)
    uneven = _unit(_without(usual * np.tanh(away / BLUR_PX), sloping))
    slopes = [_without(_without(slope, sloping), uneven) for slope in slopes]
    slope = 0.5 * (slopes[0] + slopes[1])
    contrast = (slopes[0] * slopes[1]).sum(axis=-1)
    seen = contrast > LEAST_CONTRAST
    contrast = np.where(seen, contrast, 1.0)
    each = (slice(None), slice(None), None, None)
    odd = _without(_without(odd, sloping[each]), uneven[each])
    off = -(odd * slope[each]).sum(axis=-1) / contrast[each]
    left = np.square(odd + off[..., None] * slope[each]).sum(axis=-1)
    noise = (left * shown).sum(axis=(2, 3)) / ((STEPS - 3) * np.maximum(shown.sum(axis=(2, 3)), 1))
    # Light is taken between pixels: what is less than a pixel apart shares its noise.
    noise = noise * np.maximum(1.0 / step_px, 1.0)
    return off, np.where(seen, noise * np.square(slope).sum(axis=-1) / np.square(contrast), NOT_SEEN_PX2)


def _slope(even: Floats) -> Floats:
    """(…, STEPS) derivative by the step, exact to its fourth power: a wall is not much wider than the steps between."""
    mirrored = np.concatenate([even[..., 1:2], even], axis=-1)  # from the step before none
    near, far = mirrored[..., 3:-1] - mirrored[..., 1:-3], mirrored[..., 4:] - mirrored[..., :-4]
    slope: Floats = (8.0 * near - far) / 12.0
    return slope


def _unit(courses: Floats) -> Floats:
    """(…, T) of length 1."""
    unit: Floats = courses / np.sqrt(np.square(courses).sum(axis=-1, keepdims=True) + 1e-12)
    return unit


def _without(courses: Floats, unit: Floats) -> Floats:
    """(…, T) less what they have of `unit`."""
    rest: Floats = courses - (courses * unit).sum(axis=-1, keepdims=True) * unit
    return rest
