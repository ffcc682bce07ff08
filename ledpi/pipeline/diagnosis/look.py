"""The looks of a four-sided thing in the picture: how bright, how full, how sharp, how square. Pure."""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np

from ledpi.core.geometry import quad_side
from ledpi.core.records import Floats, Frame, Mask, PanelSpec, Pixels
from ledpi.core.shutter import contrast
from ledpi.core.tone import linear_light

FULL = 255
# The ring around a thing that it is compared with: beyond a panel's dark bezel, a sixth of a cell to a third.
RING = (1.3, 1.7)  # times the thing's size
# Two looks at each edge, blurred by so much more: a step that is blurred by σ has a slope of 1/√(σ² + s²).
FINE_PX, COARSE_PX = 1.0, 2.0
EDGE_SHARE = 0.4  # of the steepest slope: what is less steep is no edge of the thing
MOST_BLUR_PX = 8.0  # what is blurred more is blurred by this


class Look(NamedTuple):
    """The look of one thing."""

    level: float  # median of its pixels, 0 to 255
    brighter: float  # its linear light over that of the ring around it, of their medians
    full_share: float  # of its pixels that are full
    blur_px: float  # standard deviation by which its edges are blurred; a focused lens leaves 0.8 to 1.1
    narrow: float  # its shorter pair of sides over the longer one


def look_at(frame: Frame, corners_px: Floats) -> Look:
    """At the thing with these corners (4, 2)."""
    part, corners = _around(frame.pixels, corners_px)
    inside, ring = _filled(part, corners, 1.0), _filled(part, corners, RING[1]) & ~_filled(part, corners, RING[0])
    within, beside = part[inside], part[ring]
    level = float(np.median(within)) if within.size else 0.0
    light = linear_light(frame.transfer, mark_saturated=False)
    dark = float(light[int(np.median(beside))]) if beside.size else 0.0
    return Look(
        level=level,
        brighter=float(light[int(level)]) / max(dark, float(light[1])),
        full_share=float(np.mean(within == FULL)) if within.size else 0.0,
        blur_px=blur_of(part, _filled(part, corners, RING[0])),
        narrow=_narrow(corners_px),
    )


def blur_of(pixels: Pixels, where: Mask | None = None) -> float:
    """Standard deviation (px) by which the sharpest edges of a picture (H, W) are blurred, of those `where` (H, W).

    From how much less steep they get when they are blurred a little more. MOST_BLUR_PX where there is no edge.
    """
    fine, coarse = (_slope(pixels, sigma) for sigma in (FINE_PX, COARSE_PX))
    inner = np.ones(pixels.shape, bool) if where is None else where
    if not inner.any():
        return MOST_BLUR_PX
    edges = inner & (coarse >= EDGE_SHARE * max(float(coarse[inner].max()), 1.0))
    if not edges.any():
        return MOST_BLUR_PX
    ratio2 = float(np.percentile(fine[edges] / np.maximum(coarse[edges], 1e-6), 75)) ** 2
    if ratio2 <= 1.0:
        return MOST_BLUR_PX
    variance = (COARSE_PX**2 - ratio2 * FINE_PX**2) / (ratio2 - 1.0)
    return min(MOST_BLUR_PX, math.sqrt(max(0.0, variance)))


def band_step(frame: Frame, spec: PanelSpec, level: float) -> float:
    """By how many grey levels, peak to peak, the fainter of a panel's bands change the picture where it is at `level`.

    As the exposure leaves them, and the tone curve there.
    """
    light = linear_light(frame.transfer, mark_saturated=False).astype(np.float64)
    here = float(np.interp(level, np.arange(256), light))
    depth = min(contrast(hz, frame.exposure_us, spec.duty) for hz in spec.waves_hz)
    low, high = (float(np.interp(here * (1 + sign * depth / 2), light, np.arange(256))) for sign in (-1, 1))
    return high - low


def _slope(pixels: Pixels, sigma: float) -> np.ndarray:
    smooth = cv2.GaussianBlur(pixels.astype(np.float32), (0, 0), sigma)
    across, down = (cv2.Sobel(smooth, cv2.CV_32F, *step, ksize=1) for step in ((1, 0), (0, 1)))
    return np.asarray(np.hypot(across, down))


def _around(pixels: Pixels, corners: Floats) -> tuple[Pixels, Floats]:
    """The part of the picture that holds the thing and its ring, and the corners in it."""
    height, width = pixels.shape
    reach = RING[1] * (corners - corners.mean(axis=0)) + corners.mean(axis=0)
    left, top = np.clip(np.floor(reach.min(axis=0)), 0, (width - 1, height - 1)).astype(int)
    right, bottom = np.clip(np.ceil(reach.max(axis=0)) + 1, (left + 1, top + 1), (width, height)).astype(int)
    return pixels[top:bottom, left:right], corners - (left, top)


def _filled(part: Pixels, corners: Floats, scale: float) -> Mask:
    marked = np.zeros(part.shape, np.uint8)
    middle = corners.mean(axis=0)
    cv2.fillConvexPoly(marked, np.round(middle + scale * (corners - middle)).astype(np.int32), 1)
    return np.asarray(marked > 0)


def _narrow(corners: Floats) -> float:
    sides = np.hypot(*(np.roll(corners, -1, axis=0) - corners).T)
    pairs = sorted((float(sides[0] + sides[2]), float(sides[1] + sides[3])))
    return pairs[0] / max(pairs[1], 1e-9)


def side_px(corners: Floats) -> float:
    """The side of a square as large."""
    return quad_side(corners.tolist())
