"""Where exactly the sides of a lit square run, in linear light.

Across a side the light is a background, then, from the edge on, the lit cell, whose brightness rises inward: a ramp.
The optics blur that with a width σ. So a profile along the side's inward normal t is

    p(t) = b + L·Φ(t'/σ) + m·(t'·Φ(t'/σ) + σ·φ(t'/σ)),    t' = t − edge

(Φ and φ: the normal distribution and its density). For a given edge and σ this is linear in b, L and m, so the edge
is that of the smallest residual. A half-height crossing would sit too far inside where the light still rises.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from ledpi.decode.cells import Singles
from ledpi.geometry import distort
from ledpi.records import Floats, Frame, Intrinsics, Quad, Rejected
from ledpi.tone import linear_light

LOST = Rejected(stage="edges", reason="no_edge")
NOT_STRAIGHT = Rejected(stage="edges", reason="not_straight")
NOT_CONVEX = Rejected(stage="edges", reason="not_convex")
AT_BORDER = Rejected(stage="edges", reason="at_picture_border")
TOO_SMALL = Rejected(stage="edges", reason="too_small")

PROFILES, PROFILES_AT_FIRST = 24, 12  # a side
SAMPLES_OUTSIDE = 6
SAMPLES_INSIDE = (4, 6, 8)
# Blur in samples. Lens and pixel of a focused camera give 0.6 to 1.2 px; the wider ones serve the coarse first pass.
SIGMAS = (1.3, 2.0, 3.2)
OFFSETS = np.arange(-4.5, 3.01, 0.75)  # of the edge, in samples, inward positive
MIN_SIDE_PX = 7.0
# Share of a side's profiles that must show an edge: a rough quad may miss many at first, and at short exposure half of
# a side and more may be dark.
MIN_EDGE = 0.2
# The edges of a panel lie on a line to a tenth of a pixel, those of most other things do not by far; at first a side
# that is seen from too far off may still lean on something beside it.
MAX_SPREAD_PX, MAX_SPREAD_AT_FIRST_PX, MAX_SPREAD_AT_FIRST_STEPS = 0.5, 0.9, 0.4
FINE_STEP_PX, FINE_PASSES = 0.5, 3
MAX_MOVE = 0.2  # of the side: what moves further when looked at closely was not there
CONVERGED_PX = 1.0  # a fine pass that moves the corners by more than this is repeated
OUTER_REACH = 16  # samples to either side of a striped square's rim
OUTER_PASSES = 3
OUTER_SHARE = 0.2  # of the side: as far beyond the rough corners a striped square may begin

_NEXT = np.array([1, 2, 3, 0])
_BEFORE = np.array([3, 0, 1, 2])
_SHARE = np.linspace(0.06, 0.94, PROFILES)  # of the way along a side
_SHARE_AT_FIRST = np.linspace(0.06, 0.94, PROFILES_AT_FIRST)


@cache
def _edge_models(inside: int) -> tuple[Floats, Floats]:
    """Of each (σ, offset): an orthonormal basis of the profiles it can explain, (S, models·3), and L, (S, models)."""
    t = np.arange(-SAMPLES_OUTSIDE, inside + 1, dtype=float)
    bases, heights = [], []
    for sigma in SIGMAS:
        for offset in OFFSETS:
            z = (t - offset) / sigma
            cdf = np.array([0.5 * (1 + math.erf(v / math.sqrt(2))) for v in z])
            pdf = np.exp(-0.5 * z * z) / math.sqrt(2 * math.pi)
            model = np.stack([np.ones_like(t), cdf, sigma * (z * cdf + pdf)], axis=1)
            bases.append(np.linalg.qr(model)[0])
            heights.append(np.linalg.pinv(model)[1])
    return np.concatenate(bases, axis=1), np.stack(heights, axis=1)


def approach_quads(
    frame: Frame, rough: Floats, tolerance_px: Floats, *, stripe_rows: float = 0.0
) -> list[Floats | Rejected]:
    """Better corners for each of `rough` (N, 4, 2; clockwise in the picture), or why there is no square; all at once.

    The sides are sought up to `tolerance_px` (N,) away, with samples as far apart as that takes. In a striped picture,
    with dark bands of up to `stripe_rows`, cells may be dark at the very edge, so that their light seems to end further
    inside: there the sides are where light begins furthest outside.
    """
    if not len(rough):
        return []
    if stripe_rows:
        corners, spread, seen = _approach_striped(frame, rough, stripe_rows)
        limit = np.full(len(rough), np.inf)
    else:
        step = np.maximum(FINE_STEP_PX, tolerance_px / -OFFSETS[0])
        sides = _look_across(
            frame, rough, step, SAMPLES_OUTSIDE, SAMPLES_INSIDE[0], share=_SHARE_AT_FIRST, exact=False
        )
        corners, spread, seen = _fit_sides(sides, step, SAMPLES_INSIDE[0])
        limit = np.maximum(MAX_SPREAD_AT_FIRST_PX, MAX_SPREAD_AT_FIRST_STEPS * step)
    moved = np.abs(corners - rough).max(axis=(1, 2))
    side = np.sqrt(np.abs(_areas(rough)))
    results: list[Floats | Rejected] = []
    for i in range(len(rough)):
        if not seen[i] or not moved[i] < 0.5 * side[i]:
            results.append(LOST)
        else:
            results.append(corners[i] if spread[i] <= limit[i] else NOT_STRAIGHT)
    return results


def refine_quad(
    frame: Frame, near: Floats, intrinsics: Intrinsics | None = None, *, striped: bool = False
) -> Quad | Rejected:
    """Sub-pixel corners of the lit square whose corners are within 2 px of `near` (4, 2), or why there are none.

    In a `striped` picture the rim may be too dark for that; then `near` is as good as it gets.
    """
    side = math.sqrt(abs(float(_areas(near))))
    if side < MIN_SIDE_PX:
        return TOO_SMALL
    reach = 0.45 * side / 4 / FINE_STEP_PX  # not beyond the middle of a cell, where its light falls again
    inside = next((n for n in reversed(SAMPLES_INSIDE) if n <= reach), SAMPLES_INSIDE[0])
    step = np.array([FINE_STEP_PX])
    bend = _bend(near, intrinsics)
    corners = near[None]
    for number in range(FINE_PASSES):
        sides = _look_across(frame, corners, step, SAMPLES_OUTSIDE, inside, exact=True)
        fitted, spread, seen = _fit_sides(sides, step, inside, bend, striped=striped)
        straight = spread[0] <= (MAX_SPREAD_AT_FIRST_PX if number == 0 else MAX_SPREAD_PX)
        moved = float(np.abs(fitted - corners).max())
        if not (seen[0] and straight and moved < MAX_MOVE * side):
            if striped:
                return _checked(frame, near, MAX_SPREAD_PX, bend)
            return NOT_STRAIGHT if seen[0] and not straight else LOST
        corners = fitted
        if moved < CONVERGED_PX:
            break
    return _checked(frame, corners[0], float(spread[0]), bend)


def _areas(corners: Floats) -> Floats:
    """Signed area of quads (…, 4, 2), positive where they run clockwise in the picture."""
    x, y = corners[..., 0], corners[..., 1]
    area: Floats = 0.5 * ((x[..., 2] - x[..., 0]) * (y[..., 3] - y[..., 1]))
    area -= 0.5 * ((x[..., 3] - x[..., 1]) * (y[..., 2] - y[..., 0]))
    return area


@dataclass(frozen=True, slots=True)
class _Sides:
    """Light across the four sides of N quads."""

    corners: Floats  # (N, 4, 2); side k runs from corner k to the next
    inward: Floats  # (N, 4, 2) unit normals
    share: Floats  # (P,) of the way along a side
    light: Singles  # (N, 4, P, S)


def _along_and_inward(corners: Floats) -> tuple[Floats, Floats]:
    """Each side's way to the next corner (…, 4, 2), and its unit normal into the square (…, 4, 2)."""
    along = corners[..., _NEXT, :] - corners
    length = np.maximum(np.hypot(along[..., 0], along[..., 1]), 1e-9)
    inward = np.empty_like(along)
    inward[..., 0], inward[..., 1] = -along[..., 1] / length, along[..., 0] / length
    return along, inward


def _bend(corners: Floats, intrinsics: Intrinsics | None) -> Floats:
    """(4, P) how far inward the lens moves the points of a side off the straight line between its corners, in pixels.

    The bend changes so slowly over the picture that it is taken where the lens would put these corners, instead of
    undistorting them first.
    """
    if intrinsics is None or not any(intrinsics.distortion):
        return np.zeros((4, PROFILES))
    rays = (corners - (intrinsics.cx, intrinsics.cy)) / (intrinsics.fx, intrinsics.fy)
    share = np.concatenate([[0.0], _SHARE])[:, None]
    bent = distort(rays[:, None, :] + (rays[_NEXT] - rays)[:, None, :] * share, intrinsics)
    ends = bent[:, 0]
    along, inward = _along_and_inward(ends)
    away = bent[:, 1:] - ends[:, None, :] - along[:, None, :] * _SHARE[:, None]
    bend: Floats = (away * inward[:, None, :]).sum(axis=2)
    return bend


def _look_across(
    frame: Frame, corners: Floats, step_px: Floats, outside: int, inside: int, *, exact: bool, share: Floats = _SHARE
) -> _Sides:
    """Linear light on `outside` samples beyond each side, one on it, and `inside` ones within, at P places along it.

    `exact` interpolates linear light, else picture values: rounded, but with no more of the picture touched.
    """
    along, inward = _along_and_inward(corners)
    points = corners[:, :, None, :] + along[:, :, None, :] * share[:, None]
    across = inward * step_px[:, None, None]
    t = np.arange(-outside, inside + 1)
    at = points[:, :, :, None, :] + across[:, :, None, None, :] * t[:, None]
    flat = at.reshape(-1, len(t), 2).astype(np.float32)
    table = linear_light(frame.transfer, mark_saturated=False)
    if exact:
        height, width = frame.pixels.shape
        ends = flat[:, (0, -1)].reshape(-1, 2)
        low, high = ends.min(axis=0), ends.max(axis=0)
        x0, y0 = min(max(0, int(low[0])), width - 1), min(max(0, int(low[1])), height - 1)
        x1, y1 = max(x0 + 1, int(high[0]) + 2), max(y0 + 1, int(high[1]) + 2)
        flat -= np.array([x0, y0], np.float32)
        linear = cv2.LUT(frame.pixels[y0:y1, x0:x1], table)
        light = cv2.remap(linear, flat, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    else:
        seen = cv2.remap(frame.pixels, flat, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        light = cv2.LUT(seen, table)
    return _Sides(
        corners=corners, inward=inward, share=share, light=light.reshape(len(corners), 4, len(share), len(t))
    )


def _fit_sides(
    sides: _Sides, step_px: Floats, inside: int, bend: Floats | float = 0.0, *, striped: bool = False
) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """New corners (N, 4, 2), the edges' spread about the sides in pixels (N,), and whether there are edges (N,)."""
    found, strength = _edge_offsets(sides.light, inside)
    usual = np.sort(strength.reshape(len(strength), -1), axis=1)[:, int(0.9 * 4 * len(sides.share))]
    good = strength > 0.3 * usual[:, None, None]
    seen = good.sum(axis=2).min(axis=1) >= MIN_EDGE * len(sides.share)
    if striped:
        good &= _outermost(found, good)
    corners, spread = _fit_lines(sides, found * step_px[:, None, None] - bend, good)
    return corners, spread, seen


def _edge_offsets(light: Singles, inside: int) -> tuple[Floats, Floats]:
    """Edge (N, 4, P) in samples, inward positive, and the step's height there; σ is one for all profiles of a quad."""
    bases, heights = _edge_models(inside)
    count = len(light)
    flat = light.reshape(-1, light.shape[-1]).astype(np.float64)
    flat -= flat.mean(axis=1, keepdims=True)
    shape = (count, len(flat) // count, len(SIGMAS), len(OFFSETS))
    parts = (flat @ bases).reshape(-1, 3)
    explained = np.einsum("md,md->m", parts, parts).reshape(shape)
    # Only a step up, from the dark outside to the lit inside, is an edge of ours.
    height = (flat @ heights).reshape(shape)
    explained *= height > 0
    sigma = explained.max(axis=3).sum(axis=1).argmax(axis=1)
    quad = np.arange(count)
    fit = explained[quad, :, sigma].reshape(-1, len(OFFSETS))
    heights_there = height[quad, :, sigma].reshape(-1, len(OFFSETS))
    best = np.clip(np.argmax(fit, axis=1), 1, len(OFFSETS) - 2)
    row = np.arange(len(fit))
    before, here, after = fit[row, best - 1], fit[row, best], fit[row, best + 1]
    bend = 2 * here - before - after
    shift = 0.5 * (after - before) / np.where(bend > 0, bend, np.inf)
    offset = OFFSETS[best] + np.clip(shift, -1, 1) * (OFFSETS[1] - OFFSETS[0])
    strength = heights_there[row, best] * (here > 0)
    return offset.reshape(count, 4, -1), strength.reshape(count, 4, -1)


def _fit_lines(sides: _Sides, y: Floats, good: NDArray[np.bool_]) -> tuple[Floats, Floats]:
    """Corners where straight lines through edges `y` (N, 4, P; pixels inward) cross, and the edges' spread (N,).

    Each side is moved inward by a + b·(share of the way along it), by least squares; two rounds, of which the second
    drops by Tukey's biweight what a textured background or a gap between cells has led astray.
    """
    x = sides.share - 0.5
    w = good.astype(float)
    for _ in range(2):
        sw, sx, sy = w.sum(axis=-1), w @ x, (w * y).sum(axis=-1)
        sxx, sxy = w @ (x * x), (w * y) @ x
        det = np.maximum(sw * sxx - sx * sx, 1e-12)
        b = (sw * sxy - sx * sy) / det
        a = (sy - b * sx) / np.maximum(sw, 1e-12)
        away = y - a[..., None] - b[..., None] * x
        spread = _spread(away, good & (w > 0))
        u = away / (4.7 * np.maximum(spread, 0.02))[..., None]
        w = good * np.square(np.maximum(0.0, 1.0 - u * u))
    start = sides.corners + sides.inward * (a - 0.5 * b)[..., None]
    end = sides.corners[:, _NEXT] + sides.inward * (a + 0.5 * b)[..., None]
    return _crossings(start, end - start), np.sqrt(np.square(spread).mean(axis=1))


def _spread(away: Floats, counts: NDArray[np.bool_]) -> Floats:
    """Standard deviation (N, 4) of the points that count, from the median of their distances (normal: 1.4826)."""
    distance = np.sort(np.where(counts, np.abs(away), np.inf), axis=-1)
    middle = np.maximum(counts.sum(axis=-1, keepdims=True) - 1, 0) // 2
    spread: Floats = 1.4826 * np.take_along_axis(distance, middle, axis=-1)[..., 0]
    spread[~np.isfinite(spread)] = 1e3  # none counts
    return spread


def _crossings(start: Floats, direction: Floats) -> Floats:
    """Corner k (N, 4, 2): where side k − 1 meets side k. Not finite where they are parallel."""
    before, before_direction = start[:, _BEFORE], direction[:, _BEFORE]
    det = before_direction[..., 0] * direction[..., 1] - before_direction[..., 1] * direction[..., 0]
    gap = start - before
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (gap[..., 0] * direction[..., 1] - gap[..., 1] * direction[..., 0]) / det
        corners: Floats = before + before_direction * share[..., None]
    return corners


def _approach_striped(frame: Frame, rough: Floats, stripe_rows: float) -> tuple[Floats, Floats, NDArray[np.bool_]]:
    """As `_fit_sides`, for striped squares: lines through where light begins furthest outside.

    Dark bands may have cut so much off the rough square that all of a side's window is still inside: then it moves out
    by a window, and all are looked at again. Something bright nearby may lead it astray, though; so what counts is the
    pass after which most light is inside the sides, and least beyond them.
    """
    count = len(rough)
    reached, corners = rough, rough
    spread, seen, best = np.full(count, np.inf), np.zeros(count, bool), np.full(count, -np.inf)
    for _ in range(OUTER_PASSES):
        reach_px = np.maximum(OUTER_SHARE * np.sqrt(np.abs(_areas(reached))), stripe_rows + 2)
        step = np.maximum(FINE_STEP_PX, reach_px / OUTER_REACH)
        sides = _look_across(frame, reached, step, OUTER_REACH, OUTER_REACH, exact=False)
        above, contrasty = _lit(sides)
        first = above.argmax(axis=-1)
        good = np.asarray(above.any(axis=-1))
        sure = contrasty & (good.sum(axis=2).min(axis=1) >= MIN_EDGE * PROFILES)
        good &= _outermost(first.astype(float), good)
        fitted, apart = _fit_lines(sides, (first - 0.5 - OUTER_REACH) * step[:, None, None], good)
        if not np.isfinite(fitted).all():
            break
        reached = fitted
        above, _ = _lit(_look_across(frame, reached, step, OUTER_REACH, OUTER_REACH, exact=False))
        inside = np.asarray(above[..., OUTER_REACH + 2 :].mean(axis=(1, 2, 3)))
        contrast = inside - above[..., : OUTER_REACH - 1].mean(axis=(1, 2, 3))
        better = np.asarray(sure & (contrast > best))
        best = np.where(better, contrast, best)
        corners = np.where(better[:, None, None], reached, corners)
        spread, seen = np.where(better, apart, spread), seen | better
    return corners, spread, seen


def _lit(sides: _Sides) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """What is lit (N, 4, P, S), by the middle of each quad's dark and bright; and which quads (N,) have a contrast."""
    ordered = np.sort(sides.light.reshape(len(sides.light), -1), axis=1)
    dark, lit = (ordered[:, int(share * ordered.shape[1])] for share in (0.1, 0.9))
    return sides.light > (0.5 * (dark + lit))[:, None, None, None], np.asarray(lit > 2 * dark)


def _outermost(found: Floats, good: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Of each side's edges (N, 4, P), those of the quarter that lies furthest outside, and what agrees with them."""
    offsets = np.where(good, found, np.inf)
    quarter = good.sum(axis=-1, keepdims=True) // 4
    agrees: NDArray[np.bool_] = offsets <= np.take_along_axis(np.sort(offsets, axis=-1), quarter, axis=-1) + 1.5
    return agrees


def _checked(frame: Frame, corners: Floats, spread: float, bend: Floats) -> Quad | Rejected:
    if not np.isfinite(corners).all():
        return NOT_CONVEX
    if spread > MAX_SPREAD_PX:
        return NOT_STRAIGHT
    sides = corners[_NEXT] - corners
    onward = sides[_NEXT]
    if not (sides[:, 0] * onward[:, 1] > sides[:, 1] * onward[:, 0]).all():
        return NOT_CONVEX
    if _areas(corners) < MIN_SIDE_PX**2:
        return TOO_SMALL
    height, width = frame.pixels.shape
    if not ((corners >= 0).all() and (corners[:, 0] <= width - 1).all() and (corners[:, 1] <= height - 1).all()):
        return AT_BORDER
    # A corner is at the end of two lines through n edges each: its deviation is twice their spread over √n.
    sigma = 2.0 * spread / math.sqrt(PROFILES)
    return Quad(corners_px=corners, corner_sigma_px=sigma, bend_px=float(np.abs(bend).max()))
