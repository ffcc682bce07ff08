"""Where exactly the sides of a lit square run, in linear light.

Across a side the light is a background, then, from the edge on, the lit cell, whose brightness rises inward: a ramp.
The optics blur that with a width σ. So a profile along the side's inward normal t is

    p(t) = b + L·Φ(t'/σ) + m·(t'·Φ(t'/σ) + σ·φ(t'/σ)),    t' = t − edge

(Φ and φ: the normal distribution and its density). For a given edge and σ this is linear in b, L and m, so the edge
is that of the smallest residual. A half-height crossing would sit too far inside where the light still rises.
"""

from __future__ import annotations

import math
from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray

from ledpi.decode.cells import Singles
from ledpi.geometry import distort, undistort
from ledpi.records import Floats, Frame, Intrinsics, Quad, Rejected
from ledpi.tone import linear_light

LOST = Rejected(stage="edges", reason="no_edge")
NOT_CONVEX = Rejected(stage="edges", reason="not_convex")
AT_BORDER = Rejected(stage="edges", reason="at_picture_border")
TOO_SMALL = Rejected(stage="edges", reason="too_small")

PROFILES = 24  # a side
SAMPLES_OUTSIDE = 6
SAMPLES_INSIDE = (4, 6, 8)
# Blur in samples. Lens and pixel of a focused camera give 0.6 to 1.2 px; the wider ones serve the coarse first pass.
SIGMAS = (1.2, 1.8, 2.6, 4.0)
OFFSETS = np.arange(-4.5, 3.01, 0.5)  # of the edge, in samples, inward positive
MIN_SIDE_PX = 8.0
# At short exposure half of a side and more may be dark; a straight line needs less.
MIN_GOOD_SHARE = 0.2
CONVERGED_PX = 0.3  # a fine pass that moves the corners by more than this is repeated


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
    frame: Frame, rough: Floats, intrinsics: Intrinsics | None = None, *, striped: bool = False
) -> Quad | Rejected:
    """Sub-pixel corners of the lit square near `rough` (4, 2; clockwise in the picture), or why there are none.

    A coarse pass may move a side by a tenth of the square; fine ones of half-pixel samples follow until it stays.
    In a `striped` picture cells may be dark at the very edge, so that their light seems to end further inside: there
    the outermost edges count.
    """
    side = math.sqrt(abs(_area(rough)))
    if side < MIN_SIDE_PX:
        return TOO_SMALL
    corners, sigma = rough, math.inf
    if striped:
        outer = _outermost_light(frame, rough, side)
        if isinstance(outer, Rejected):
            return outer
        corners = outer
    for step in (side * 0.025, 0.5, 0.5, 0.5):
        if step < 0.5 or (striped and step > 0.5):  # a small square: the fine pass reaches as far
            continue
        fitted = _fit_sides(frame, corners, step, side, intrinsics, striped)
        if isinstance(fitted, Rejected):
            return fitted
        moved = float(np.abs(fitted[0] - corners).max())
        corners, sigma = fitted
        if moved > 0.5 * side:
            return LOST
        if step == 0.5 and moved < CONVERGED_PX:
            break
    return _checked(frame, corners, sigma)


def _area(corners: Floats) -> float:
    x, y = corners[:, 0], corners[:, 1]
    return 0.5 * float(x @ np.roll(y, -1) - y @ np.roll(x, -1))


def _fit_sides(
    frame: Frame, corners: Floats, step_px: float, side_px: float, intrinsics: Intrinsics | None, striped: bool
) -> tuple[Floats, float] | Rejected:
    reach = 0.45 * side_px / 4 / step_px  # not beyond the middle of a cell, where its light falls again
    inside = next((n for n in reversed(SAMPLES_INSIDE) if n <= reach), SAMPLES_INSIDE[0])
    points, inward, profiles = _take_profiles(frame, corners, step_px, -SAMPLES_OUTSIDE, inside)
    found, strength = _edge_offsets(profiles, inside)
    good = strength > 0.3 * np.percentile(strength, 90)
    if good.mean(axis=1).min() < MIN_GOOD_SHARE:
        return LOST
    if striped:
        good &= _outermost(found, good)
    edge = points + inward * (found * step_px)[..., None]
    bent = intrinsics is not None and any(intrinsics.distortion)
    if bent and intrinsics is not None:
        focal, centre = np.array([intrinsics.fx, intrinsics.fy]), np.array([intrinsics.cx, intrinsics.cy])
        edge = undistort(edge, intrinsics) * focal + centre
    lines, scatter = _fit_lines(edge, good.astype(float))
    fitted = _intersections(lines)
    if not np.isfinite(fitted).all():
        return NOT_CONVEX
    if bent and intrinsics is not None:
        fitted = distort((fitted - centre) / focal, intrinsics)
    # A corner is where two lines cross: at the end of a line of n points its deviation is 2·scatter/√n.
    return fitted, 2.0 * scatter / math.sqrt(PROFILES * float(good.mean()))


def _take_profiles(
    frame: Frame, corners: Floats, step_px: float, first: int, last: int
) -> tuple[Floats, Floats, Singles]:
    """Points on the sides (4, P, 2), inward normals (4, 1, 2), linear light along them (4, P, S)."""
    along = np.roll(corners, -1, axis=0) - corners
    length = np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-9)[:, None]
    inward = (np.stack([-along[:, 1], along[:, 0]], axis=1) / length)[:, None, :]
    share = np.linspace(0.06, 0.94, PROFILES)[None, :, None]
    points = corners[:, None, :] + along[:, None, :] * share
    t = np.arange(first, last + 1) * step_px
    at = (points[:, :, None, :] + inward[:, :, None, :] * t[None, None, :, None]).astype(np.float32)
    height, width = frame.pixels.shape
    low = np.floor(at.min(axis=(0, 1, 2))).astype(int)
    high = np.ceil(at.max(axis=(0, 1, 2))).astype(int) + 1
    x0, y0 = max(0, int(low[0])), max(0, int(low[1]))
    patch = frame.pixels[y0 : max(y0 + 1, min(height, int(high[1]))), x0 : max(x0 + 1, min(width, int(high[0])))]
    linear = cv2.LUT(patch, linear_light(frame.transfer, mark_saturated=False))
    if step_px >= 1.5:  # coarse samples see all pixels between them
        size = int(step_px) | 1
        linear = cv2.blur(linear, (size, size))
    at -= np.array([x0, y0], np.float32)
    flat = at.reshape(4 * PROFILES, -1, 2)
    light = cv2.remap(linear, flat, None, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
    return points, inward, light.reshape(4, PROFILES, -1)


def _edge_offsets(profiles: Singles, inside: int) -> tuple[Floats, Floats]:
    """Edge (4, P) in samples, inward positive, and the step's height there; σ is one for all profiles."""
    bases, heights = _edge_models(inside)
    flat = profiles.reshape(-1, profiles.shape[-1]).astype(np.float64)
    flat -= flat.mean(axis=1, keepdims=True)
    shape = (len(flat), len(SIGMAS), len(OFFSETS))
    explained = np.square(flat @ bases).reshape(*shape, 3).sum(axis=3)
    # Only a step up, from the dark outside to the lit inside, is an edge of ours.
    height = (flat @ heights).reshape(shape)
    explained[height <= 0] = 0.0
    sigma = int(np.argmax(explained.max(axis=2).sum(axis=0)))
    fit, height = explained[:, sigma], height[:, sigma]
    best = np.clip(np.argmax(fit, axis=1), 1, len(OFFSETS) - 2)
    row = np.arange(len(flat))
    before, here, after = fit[row, best - 1], fit[row, best], fit[row, best + 1]
    bend = 2 * here - before - after
    shift = 0.5 * (after - before) / np.where(bend > 0, bend, np.inf)
    offset = OFFSETS[best] + np.clip(shift, -1, 1) * (OFFSETS[1] - OFFSETS[0])
    strength = np.where(here > 0, height[row, best], 0.0)
    return offset.reshape(4, -1), strength.reshape(4, -1)


def _outermost_light(frame: Frame, corners: Floats, side_px: float) -> Floats | Rejected:
    """Corners of a striped square: lines through where light begins furthest outside, up to a fifth of the side away."""
    reach = 16
    step = max(0.5, 0.2 * side_px / reach)
    points, inward, profiles = _take_profiles(frame, corners, step, -reach, reach)
    background = np.median(profiles[:, :, : reach // 2], axis=2)
    lit = np.percentile(profiles, 90, axis=(1, 2))[:, None]
    above = profiles > (0.5 * (background + lit))[..., None]
    first = above.argmax(axis=2)
    good = (first > reach // 4) & (lit > 2 * background)
    if good.mean(axis=1).min() < MIN_GOOD_SHARE:
        return LOST
    edge = points + inward * ((first - 0.5 - reach) * step)[..., None]
    lines, _ = _fit_lines(edge, (good & _outermost(first.astype(float), good)).astype(float))
    return _intersections(lines)


def _outermost(found: Floats, good: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Of each side's edges (4, P), those of the quarter that lies furthest outside, and what agrees with them."""
    offsets = np.where(good, found, np.inf)
    outer = np.take_along_axis(np.sort(offsets, axis=1), (good.sum(axis=1, keepdims=True) // 4), axis=1)
    agrees: NDArray[np.bool_] = offsets <= outer + 1.5
    return agrees


def _fit_lines(points: Floats, weights: Floats) -> tuple[Floats, float]:
    """Lines n·p = c (4, 3: nx, ny, c) through (4, P, 2), and the scatter of the points about them in pixels.

    Total least squares; three rounds of Tukey's biweight drop what a textured background or a gap has led astray.
    """
    w = weights
    for _ in range(3):
        total = np.maximum(w.sum(axis=1), 1e-9)
        mean = np.einsum("kp,kpd->kd", w, points) / total[:, None]
        d = points - mean[:, None]
        xx, xy, yy = (np.einsum("kp,kp->k", w, d[..., i] * d[..., j]) for i, j in ((0, 0), (0, 1), (1, 1)))
        angle = 0.5 * np.arctan2(2 * xy, xx - yy)  # of the line
        normal = np.stack([-np.sin(angle), np.cos(angle)], axis=1)
        away = np.einsum("kpd,kd->kp", d, normal)
        scatter = _spread(away, w)
        u = away / (4.7 * np.maximum(scatter, 0.02))[:, None]
        w = weights * np.square(np.maximum(0.0, 1.0 - u * u))
    lines = np.concatenate([normal, np.einsum("kd,kd->k", normal, mean)[:, None]], axis=1)
    return lines, float(np.sqrt(np.mean(np.square(scatter))))


def _spread(away: Floats, weights: Floats) -> Floats:
    """Standard deviation (4,) of the points that count, from the median of their distances (normal: 1.4826)."""
    counts = weights > 0
    distance = np.sort(np.where(counts, np.abs(away), np.inf), axis=1)
    middle = (counts.sum(axis=1) - 1) // 2
    spread: Floats = 1.4826 * distance[np.arange(len(distance)), middle]
    return spread


def _intersections(lines: Floats) -> Floats:
    """Corner i (4, 2) is where side i − 1 meets side i."""
    before = np.roll(lines, 1, axis=0)
    det = before[:, 0] * lines[:, 1] - before[:, 1] * lines[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        x = (before[:, 2] * lines[:, 1] - lines[:, 2] * before[:, 1]) / det
        y = (before[:, 0] * lines[:, 2] - lines[:, 0] * before[:, 2]) / det
    return np.stack([x, y], axis=1)


def _checked(frame: Frame, corners: Floats, sigma: float) -> Quad | Rejected:
    sides = np.roll(corners, -1, axis=0) - corners
    turns = sides[:, 0] * np.roll(sides[:, 1], -1) - sides[:, 1] * np.roll(sides[:, 0], -1)
    if not (turns > 0).all():
        return NOT_CONVEX
    if _area(corners) < MIN_SIDE_PX**2:
        return TOO_SMALL
    height, width = frame.pixels.shape
    if not ((corners >= 0).all() and (corners[:, 0] <= width - 1).all() and (corners[:, 1] <= height - 1).all()):
        return AT_BORDER
    return Quad(corners_px=corners, corner_sigma_px=sigma)
