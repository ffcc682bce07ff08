"""A grey picture as browsers and people want it: JPEG, bands amplified, histogram, focus. Pure."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from ledpi.core.records import Floats, Mask, Pixels

WIDEST = 1280  # pixels that are sent across; a wider picture is made smaller
QUALITY = 80  # of JPEG, per cent
BINS = 64
LEAST_LIGHT = 12.0  # of 255: what is darker shows no bands
AVERAGED = 5  # neighbouring pixels of a row, which has one exposure
LEAST_SHARE = 0.01  # of the light: fainter bands are not amplified to full scale, or noise would be
CLIPPED_PERCENT = 5.0
INNER = 0.6  # of a panel's size, that the depth of its bands is judged by
AROUND = 0.15  # of a panel's size, that its focus is judged with


def as_jpeg(pixels: Pixels) -> bytes:
    """(H, W) uint8 → JPEG, at most WIDEST across."""
    height, width = pixels.shape
    if width > WIDEST:
        size = (WIDEST, max(1, round(height * WIDEST / width)))
        pixels = np.asarray(cv2.resize(pixels, size, interpolation=cv2.INTER_AREA), np.uint8)
    return _encoded(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])


def as_png(pixels: Pixels) -> bytes:
    """(H, W) uint8 → grey PNG, which `ledpi decode` reads."""
    return _encoded(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, 1])


def _encoded(kind: str, pixels: Pixels, options: list[int]) -> bytes:
    done, data = cv2.imencode(kind, pixels, options)
    assert done, f"OpenCV cannot write {kind}"
    return bytes(data)


def amplified(pixels: Pixels, period_rows: float, quads_px: Sequence[Floats] = ()) -> Pixels:
    """(H, W) uint8: how much brighter or darker each pixel is than the mean of the period around it.

    Middle grey is as bright as the mean. Full scale is what a twentieth of the pixels within the quads (4, 2) exceed;
    without quads, of all that are lit. `period_rows`: of the slowest wave.
    """
    light = pixels.astype(np.float32)
    rows = max(3, round(period_rows))
    mean = cv2.blur(light, (AVERAGED, rows))
    bands = cv2.blur(light, (AVERAGED, 1)) / np.maximum(mean, 1.0) - 1.0
    lit = mean >= LEAST_LIGHT
    judged = lit & _inside(pixels, quads_px) if quads_px else lit
    share = float(np.percentile(np.abs(bands[judged]), 100 - CLIPPED_PERCENT)) if judged.any() else 0.0
    bands[~lit] = 0.0
    grey: Pixels = np.clip(127.5 * (1 + bands / max(share, LEAST_SHARE)), 0, 255).astype(np.uint8)
    return grey


def _inside(pixels: Pixels, quads: Sequence[Floats]) -> Mask:
    """(H, W) which pixels lie well within a quad: at its rim, its end is brighter than any band."""
    marked = np.zeros(pixels.shape, np.uint8)
    for quad in quads:
        centre = quad.mean(axis=0)
        cv2.fillConvexPoly(marked, np.round(centre + INNER * (quad - centre)).astype(np.int32), 1)
    return np.asarray(marked > 0)


def histogram(pixels: Pixels) -> list[int]:
    """Counts the pixels of each of BINS ranges of brightness."""
    counts = np.bincount(pixels.ravel(), minlength=256)
    binned: list[int] = counts.reshape(BINS, -1).sum(axis=1).tolist()
    return binned


def focus(pixels: Pixels, quads_px: Sequence[Floats]) -> float:
    """Measures how sharp it is: the Laplacian's variance over the mean's square, × 10,000. 0 where all is dark.

    Judged at the largest of the quads (4, 2), or over the whole picture without one. Smoothed before: noise has edges
    everywhere. Grows as the lens gets sharper; compare values of one place only.
    """
    part = pixels if not quads_px else _around(pixels, max(quads_px, key=_extent))
    mean = float(part.mean()) if part.size else 0.0
    if mean < 1.0:
        return 0.0
    smooth = cv2.GaussianBlur(part, (3, 3), 0)
    return float(1e4 * cv2.Laplacian(smooth, cv2.CV_32F).var() / mean**2)


def _extent(quad: Floats) -> float:
    return float(np.ptp(quad, axis=0).prod())


def _around(pixels: Pixels, quad: Floats) -> Pixels:
    height, width = pixels.shape
    low, high = quad.min(axis=0), quad.max(axis=0)
    more = AROUND * (high - low)
    left, top = np.clip(np.floor(low - more), 0, (width - 1, height - 1)).astype(int)
    right, bottom = np.clip(np.ceil(high + more) + 1, (left + 1, top + 1), (width, height)).astype(int)
    return pixels[top:bottom, left:right]
