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

PROFILES = 24  # a side
SAMPLES_OUTSIDE = 6
SAMPLES_INSIDE = (4, 6, 8)
# Blur in samples. Lens and pixel of a focused camera give 0.6 to 1.2 px; the wider ones serve the coarse first pass.
SIGMAS = (1.3, 2.0, 3.2)
OFFSETS = np.arange(-4.5, 3.01, 0.75)  # of the edge, in samples, inward positive
MIN_SIDE_PX = 8.0
# Share of a side's profiles that must show an edge: a rough quad may miss many at first, and at short exposure half of a
# side and more may be dark.
MIN_EDGE = 0.2
# The edges of a panel lie on a line to a tenth of a pixel, those of most other things do not by far; at first a side
# that is seen from too far off may still lean on something beside it.
MAX_SPREAD_PX, MAX_SPREAD_AT_FIRST_PX = 0.5, 1.2
FINE_PASSES = 3
CONVERGED_PX = 1.0  # a fine pass that moves the corners by more than this is repeated
OUTER_REACH = 16  # samples to either side of a striped square's rim

_NEXT = np.array([1, 2, 3, 0])
_BEFORE = np.array([3, 0, 1, 2])
_SHARE = np.linspace(0.06, 0.94, PROFILES)  # of the way along a side


@cache
def _edge_models(inside: int) -> tuple[Floats, Floats]:
    """Per (σ, offset) an orthonormal basis of the profiles it can explain, (S, models·3), and L from a profile, (S, models)."""
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


def refine_quad(
    frame: Frame, rough: Floats, tolerance_px: float, intrinsics: Intrinsics | None = None, *, striped: bool = False
) -> Quad | Rejected:
    """Sub-pixel corners of the lit square near `rough` (4, 2; clockwise in the picture), or why there are none.

    A coarse pass finds sides that are up to `tolerance_px` away; fine ones of half-pixel samples follow until they stay.
    In a `striped` picture cells may be dark at the very edge, so that their light seems to end further inside: there
    the outermost edges count.
    """
    side = math.sqrt(abs(_area(rough)))
    if side < MIN_SIDE_PX:
        return TOO_SMALL
    corners, spread = rough, math.inf
    bend = _bend(rough, intrinsics)
    if striped:
        outer = _outermost_light(frame, rough, side, bend)
        if isinstance(outer, Rejected):
            return outer
        corners = outer
    coarse = tolerance_px / -OFFSETS[0]
    steps = [0.5] * FINE_PASSES if striped or coarse < 1.0 else [coarse] + [0.5] * FINE_PASSES
    for step in steps:
        fitted = _fit_sides(frame, corners, step, side, bend, striped=striped)
        if isinstance(fitted, Rejected):
            return fitted
        moved = float(np.abs(fitted[0] - corners).max())
        corners, spread = fitted
        if not moved < 0.5 * side:
            return LOST
        if step == 0.5 and moved < CONVERGED_PX:
            break
    return _checked(frame, corners, spread, bend)


def _area(corners: Floats) -> float:
    (x0, y0), (x1, y1), (x2, y2), (x3, y3) = corners.tolist()
    return 0.5 * float((x2 - x0) * (y3 - y1) - (x3 - x1) * (y2 - y0))


@dataclass(frozen=True, slots=True)
class _Sides:
    """Light across the four sides of a quad."""

    corners: Floats  # (4, 2); side k runs from corner k to the next
    along: Floats  # (4, 2)
    inward: Floats  # (4, 2) unit normals
    light: Singles  # (4, P, S)


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


def _along_and_inward(corners: Floats) -> tuple[Floats, Floats]:
    """Each side's way to the next corner (4, 2), and its unit normal into the square (4, 2)."""
    along = corners[_NEXT] - corners
    length = np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-9)
    return along, np.stack([-along[:, 1], along[:, 0]], axis=1) / length[:, None]


def _fit_sides(
    frame: Frame, corners: Floats, step_px: float, side_px: float, bend: Floats, *, striped: bool
) -> tuple[Floats, float] | Rejected:
    """New corners, and how far single edges lie from the sides fitted to them (standard deviation, pixels)."""
    reach = 0.45 * side_px / 4 / step_px  # not beyond the middle of a cell, where its light falls again
    inside = next((n for n in reversed(SAMPLES_INSIDE) if n <= reach), SAMPLES_INSIDE[0])
    sides = _look_across(frame, corners, step_px, SAMPLES_OUTSIDE, inside)
    found, strength = _edge_offsets(sides.light, inside)
    usual = np.sort(strength, axis=None)[int(0.9 * strength.size)]
    good = strength > 0.3 * usual
    if good.sum(axis=1).min() < MIN_EDGE * PROFILES:
        return LOST
    if striped:
        good &= _outermost(found, good)
    fitted, spread = _fit_lines(sides, found * step_px - bend, good)
    return (fitted, spread) if spread <= max(MAX_SPREAD_AT_FIRST_PX, 0.3 * step_px) else NOT_STRAIGHT


def _look_across(frame: Frame, corners: Floats, step_px: float, outside: int, inside: int) -> _Sides:
    """Linear light on `outside` samples beyond each side, one on it, and `inside` ones within, at P places along it."""
    along, inward = _along_and_inward(corners)
    points = corners[:, None, :] + along[:, None, :] * _SHARE[:, None]
    t = np.arange(-outside, inside + 1) * step_px
    at = (points[:, :, None, :] + inward[:, None, None, :] * t[:, None]).astype(np.float32).reshape(4 * PROFILES, -1, 2)
    height, width = frame.pixels.shape
    ends = at[:, (0, -1)].reshape(-1, 2)
    low, high = ends.min(axis=0), ends.max(axis=0)
    x0, y0 = max(0, int(low[0])), max(0, int(low[1]))
    x1, y1 = min(width, int(high[0]) + 2), min(height, int(high[1]) + 2)
    linear = cv2.LUT(frame.pixels[y0 : max(y1, y0 + 1), x0 : max(x1, x0 + 1)], linear_light(frame.transfer, mark_saturated=False))
    if step_px >= 1.5:  # coarse samples see all pixels between them
        size = int(step_px) | 1
        linear = cv2.blur(linear, (size, size))
    at -= np.array([x0, y0], np.float32)
    light = cv2.remap(linear, at, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return _Sides(corners=corners, along=along, inward=inward, light=light.reshape(4, PROFILES, -1))


def _edge_offsets(light: Singles, inside: int) -> tuple[Floats, Floats]:
    """Edge (4, P) in samples, inward positive, and the step's height there; σ is one for all profiles."""
    bases, heights = _edge_models(inside)
    flat = light.reshape(4 * PROFILES, -1).astype(np.float64)
    flat -= flat.mean(axis=1, keepdims=True)
    shape = (len(flat), len(SIGMAS), len(OFFSETS))
    parts = (flat @ bases).reshape(-1, 3)
    explained = np.einsum("md,md->m", parts, parts).reshape(shape)
    # Only a step up, from the dark outside to the lit inside, is an edge of ours.
    height = (flat @ heights).reshape(shape)
    explained *= height > 0
    sigma = int(np.argmax(explained.max(axis=2).sum(axis=0)))
    fit, height = explained[:, sigma], height[:, sigma]
    best = np.clip(np.argmax(fit, axis=1), 1, len(OFFSETS) - 2)
    row = np.arange(len(flat))
    before, here, after = fit[row, best - 1], fit[row, best], fit[row, best + 1]
    bend = 2 * here - before - after
    shift = 0.5 * (after - before) / np.where(bend > 0, bend, np.inf)
    offset = OFFSETS[best] + np.clip(shift, -1, 1) * (OFFSETS[1] - OFFSETS[0])
    strength = height[row, best] * (here > 0)
    return offset.reshape(4, -1), strength.reshape(4, -1)


def _fit_lines(sides: _Sides, y: Floats, good: NDArray[np.bool_]) -> tuple[Floats, float]:
    """Corners where straight lines through edges `y` (4, P; pixels inward) cross, and the edges' spread about them.

    Each side is moved inward by a + b·(share of the way along it), by least squares; two rounds of Tukey's biweight
    drop what a textured background or a gap between cells has led astray.
    """
    x = _SHARE - 0.5
    w = good.astype(float)
    for _ in range(3):
        sw, sx, sy = w.sum(axis=1), w @ x, (w * y).sum(axis=1)
        sxx, sxy = w @ (x * x), (w * y) @ x
        det = np.maximum(sw * sxx - sx * sx, 1e-12)
        b = (sw * sxy - sx * sy) / det
        a = (sy - b * sx) / np.maximum(sw, 1e-12)
        away = y - a[:, None] - b[:, None] * x
        spread = _spread(away, good & (w > 0))
        u = away / (4.7 * np.maximum(spread, 0.02))[:, None]
        w = good * np.square(np.maximum(0.0, 1.0 - u * u))
    start = sides.corners + sides.inward * (a - 0.5 * b)[:, None]
    end = sides.corners[_NEXT] + sides.inward * (a + 0.5 * b)[:, None]
    return _crossings(start, end - start), math.sqrt(float(np.mean(spread * spread)))


def _spread(away: Floats, counts: NDArray[np.bool_]) -> Floats:
    """Standard deviation (4,) of the points that count, from the median of their distances (normal: 1.4826)."""
    distance = np.sort(np.where(counts, np.abs(away), np.inf), axis=1)
    middle = np.maximum(counts.sum(axis=1) - 1, 0) // 2
    spread: Floats = 1.4826 * distance[np.arange(len(distance)), middle]
    return np.where(np.isfinite(spread), spread, 1e3)


def _crossings(start: Floats, direction: Floats) -> Floats:
    """Corner k (4, 2): where side k − 1 meets side k. Not finite where they are parallel."""
    before, before_direction = start[_BEFORE], direction[_BEFORE]
    det = before_direction[:, 0] * direction[:, 1] - before_direction[:, 1] * direction[:, 0]
    gap = start - before
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (gap[:, 0] * direction[:, 1] - gap[:, 1] * direction[:, 0]) / det
    return before + before_direction * share[:, None]


def _outermost_light(frame: Frame, corners: Floats, side_px: float, bend: Floats) -> Floats | Rejected:
    """Corners of a striped square: lines through where light begins furthest outside, up to a fifth of the side away."""
    step = max(0.5, 0.2 * side_px / OUTER_REACH)
    sides = _look_across(frame, corners, step, OUTER_REACH, OUTER_REACH)
    background = np.median(sides.light[:, :, : OUTER_REACH // 2], axis=2)
    lit = np.percentile(sides.light, 90, axis=(1, 2))[:, None]
    above = sides.light > (0.5 * (background + lit))[..., None]
    first = above.argmax(axis=2)
    good = (first > OUTER_REACH // 4) & (lit > 2 * background)
    if good.sum(axis=1).min() < MIN_EDGE * PROFILES:
        return LOST
    good &= _outermost(first.astype(float), good)
    return _fit_lines(sides, (first - 0.5 - OUTER_REACH) * step - bend, good)[0]


def _outermost(found: Floats, good: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Of each side's edges (4, P), those of the quarter that lies furthest outside, and what agrees with them."""
    offsets = np.where(good, found, np.inf)
    outer = np.take_along_axis(np.sort(offsets, axis=1), (good.sum(axis=1, keepdims=True) // 4), axis=1)
    agrees: NDArray[np.bool_] = offsets <= outer + 1.5
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
    if _area(corners) < MIN_SIDE_PX**2:
        return TOO_SMALL
    height, width = frame.pixels.shape
    if not ((corners >= 0).all() and (corners[:, 0] <= width - 1).all() and (corners[:, 1] <= height - 1).all()):
        return AT_BORDER
    # A corner is at the end of two lines through n edges each: its deviation is twice their spread over √n.
    sigma = 2.0 * spread / math.sqrt(PROFILES)
    return Quad(corners_px=corners, corner_sigma_px=sigma, bend_px=float(np.abs(bend).max()))
