"""The sides of a square that dark bands stripe: where its light begins furthest outside."""

from __future__ import annotations

import numpy as np

from ledpi.decode.sides import (
    Mask,
    Points,
    Shares,
    Sides,
    Singles,
    areas,
    deviations,
    fit_lines,
    points_across,
    roughly_light_at,
)
from ledpi.records import Floats, Frame

SHARES = Shares.at(np.linspace(0.06, 0.94, 24))
REACH = 16  # samples to either side of the rim
PASSES = 3
OUTER_SHARE = 0.2  # of the side: as far beyond the rough corners it may begin
FINEST_STEP_PX = 0.5
MIN_EDGE = 0.2  # share of a side's profiles that must be lit
AGREE = 1.5  # samples: as far apart the outermost edges of a side may lie

_ACROSS = np.arange(-REACH, REACH + 1.0)


def outermost_sides(frame: Frame, rough: Points, stripe_rows: float) -> tuple[Points, Floats, Mask]:
    """Corners (N, 4), the spread of their edges in pixels (N,), and which quads have edges (N,).

    Dark bands may have cut so much off the rough square that all of a side's window is still inside: then it moves out
    by a window, and all are looked at again. Something bright nearby may lead it astray, though; so what counts is the
    pass after which most light is inside the sides, and least beyond them.
    """
    count = len(rough)
    reached, corners = rough, rough
    spread, seen, best = np.full(count, np.inf), np.zeros(count, bool), np.full(count, -np.inf)
    for _ in range(PASSES):
        reach_px = np.maximum(OUTER_SHARE * np.sqrt(np.abs(areas(reached))), stripe_rows + 2)
        step_px = np.maximum(FINEST_STEP_PX, reach_px / REACH)
        across = step_px[:, None] * _ACROSS
        sides = Sides.of(reached)
        above, contrasty = _lit(roughly_light_at(frame, points_across(sides, SHARES.share, across)))
        first = above.argmax(axis=-1)
        good = np.asarray(above.any(axis=-1))
        sure = contrasty & (good.sum(axis=2).min(axis=1) >= MIN_EDGE * len(SHARES.share))
        good &= outermost_of(first.astype(float), good)
        found = (first - 0.5 - REACH) * step_px[:, None, None]
        apart, weights = deviations(SHARES, found, good, *fit_lines(SHARES, found, good.astype(np.float64)))
        fitted = sides.moved(*fit_lines(SHARES, found, weights))
        if not np.isfinite(fitted).all():
            break
        reached = fitted
        above, _ = _lit(roughly_light_at(frame, points_across(Sides.of(reached), SHARES.share, across)))
        inside = np.asarray(above[..., REACH + 2 :].mean(axis=(1, 2, 3)))
        contrast = inside - above[..., : REACH - 1].mean(axis=(1, 2, 3))
        better = np.asarray(sure & (contrast > best))
        best = np.where(better, contrast, best)
        corners = np.where(better[:, None], reached, corners)
        spread = np.where(better, np.sqrt(np.square(apart).mean(axis=1)), spread)
        seen = seen | better
    return corners, spread, seen


def _lit(light: Singles) -> tuple[Mask, Mask]:
    """What is lit (N, 4, P, S), by the middle of each quad's dark and bright; and which quads (N,) have a contrast."""
    ordered = np.sort(light.reshape(len(light), -1), axis=1)
    dark, lit = (ordered[:, int(share * ordered.shape[1])] for share in (0.1, 0.9))
    return light > (0.5 * (dark + lit))[:, None, None, None], np.asarray(lit > 2 * dark)


def outermost_of(found: Floats, good: Mask) -> Mask:
    """Of each side's edges (N, 4, P), those of the quarter that lies furthest outside, and what agrees with them."""
    offsets = np.where(good, found, np.inf)
    quarter = good.sum(axis=-1, keepdims=True) // 4
    agrees: Mask = offsets <= np.take_along_axis(np.sort(offsets, axis=-1), quarter, axis=-1) + AGREE
    return agrees
