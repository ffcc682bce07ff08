"""The looks of a four-sided thing: how bright, full, square; and which other frequencies it may blink at. Pure.

The evidence of one wave does not hang on which other wave is looked for beside it. So each frequency is weighed once,
and the codeword and the two frequencies that together explain most are proposed. It is a guess: whoever takes it up
reads the frame at these frequencies, with all that a reading asks for.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import cv2
import numpy as np

from ledpi.core.codewords import Dictionary
from ledpi.core.geometry import quad_side
from ledpi.core.records import Floats, Frame, Intrinsics, Mask, PanelSpec, Pixels, Rejected
from ledpi.core.shutter import contrast, linear_light
from ledpi.decode.evidence.cells import Observation
from ledpi.decode.evidence.light import LightWeigher
from ledpi.decode.locate import Locator

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


# Below, bands are higher than most panels; above, next to nothing is left of them at most exposures. A step is 1.6 %,
# 47 Hz at 3 kHz: 10 ms leave no bands at each whole hundred hertz, so depth tells how far from one a panel is.
LOWEST_HZ, HIGHEST_HZ, STEPS = 300.0, 6000.0, 192
APART = 1.2  # that a panel's two frequencies are: nearer ones cannot be told apart in one frame


class Waves(NamedTuple):
    """The shares that each of the frequencies F explains."""

    hz: Floats  # (F,)
    score: Floats  # (F, cells, 2)
    information: Floats  # (F, cells, 2, cells, 2)
    prior: Floats  # (F,)


def propose(
    frame: Frame, corners_px: Floats, dictionary: Dictionary, lens: Intrinsics | None
) -> tuple[float, float] | None:
    """Black's and white's likeliest frequency, of the cells within corners (4, 2); None where cells cannot be had."""
    seen = _fitted(frame, corners_px, dictionary.cells_per_side, lens)
    waves = None if isinstance(seen, Rejected) else _weighed(seen, LightWeigher(dictionary.cells_per_side, lens))
    if waves is None:
        return None
    white = dictionary.rotated_codewords().reshape(4 * len(dictionary.codewords), -1).astype(np.float64)
    of_black, of_white = _likelihood(1.0 - white, waves), _likelihood(white, waves)
    apart = np.abs(np.log(waves.hz[:, None] / waves.hz)) > np.log(APART)
    together = np.where(apart, of_black[:, :, None] + of_white[:, None, :], -np.inf)
    _, black, other = np.unravel_index(int(together.argmax()), together.shape)
    return float(waves.hz[black]), float(waves.hz[other])


def _fitted(frame: Frame, corners_px: Floats, cells: int, lens: Intrinsics | None) -> Observation | Rejected:
    """The panel there, fitted without its bands' frequencies being known."""
    locator = Locator(cells, (_spec(LOWEST_HZ, HIGHEST_HZ),), lens, must_blink=False)
    quad = locator.localise(frame, corners_px)
    return quad if isinstance(quad, Rejected) else locator.observe(frame, quad)


def _spec(black_hz: float, white_hz: float) -> PanelSpec:
    return PanelSpec(side_m=1.0, black_hz=black_hz, white_hz=white_hz)


def _weighed(seen: Observation, weigher: LightWeigher) -> Waves | None:
    hz = np.geomspace(LOWEST_HZ, HIGHEST_HZ, STEPS)
    cells, half = weigher.cells**2, STEPS // 2
    score, information = np.empty((STEPS, cells, 2)), np.empty((STEPS, cells, 2, cells, 2))
    prior = np.empty(STEPS)
    for one in range(half):  # two at a time
        evidence = weigher.alone(seen, _spec(float(hz[one]), float(hz[one + half])))
        if evidence is None:
            return None
        for at, two in ((one, slice(0, 2)), (one + half, slice(2, 4))):
            score[at], prior[at] = evidence.score[:, two], evidence.prior[two][0]
            information[at] = evidence.information[:, two, :, two]
    return Waves(hz=hz, score=score, information=information, prior=prior)


def _likelihood(shows: Floats, waves: Waves) -> Floats:
    """(W, F) log-likelihood ratio to no bands of each wave in those cells of (W, cells) that show it."""
    flat = waves.information.transpose(0, 1, 3, 2, 4).reshape(len(waves.hz), -1, 4)
    both = np.einsum("wc,wd->wcd", shows, shows).reshape(len(shows), -1)
    of_class = np.einsum("wp,fpq->wfq", both, flat, optimize=True).reshape(len(shows), len(waves.hz), 2, 2)
    score = np.einsum("wc,fci->wfi", shows, waves.score)
    prior = np.maximum(waves.prior, 1e-12)[None, :, None, None]
    fitted = np.linalg.solve(of_class + np.eye(2) / prior, score[..., None])[..., 0]
    spread = np.linalg.slogdet(np.eye(2) + prior * of_class)[1]
    return np.asarray(0.5 * ((score * fitted).sum(axis=-1) - spread))
