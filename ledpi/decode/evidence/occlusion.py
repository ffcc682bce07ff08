"""Masks the samples that something occludes: darkness there is no evidence about the cell.

All cells are built alike, so but for its gain each has the same light at the same place of its own. A cell that is far
darker there than the others is occluded.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import cv2
import numpy as np

from ledpi.core.records import Mask, Pixels, Singles
from ledpi.decode.evidence.cells import BORDER_PX, INSET, MIN_LEFT, CellSamples
from ledpi.decode.evidence.shared_light import border_points

# Of the light that the others show at this place: less is not the cell's own. Diffusers differ by a few percent.
OCCLUDED = 0.75
# Near the panel's rim a sample is darker for being there: beside a side by a half at most, whatever the blur, as it
# lies within; in a corner by two. (Of a corner that is hidden by 4 px of a cell's 26 no other sample is covered.) Of
# cells so small that it is not only the outermost, it is not asked.
OCCLUDED_AT_RIM = 0.5
ALIGHT = 0.2  # of the usual gain: a cell of less is dead, and may look like anything
FULLY_LIT = 0.75  # quantile of a cell's samples that is taken for its gain: half of the cell may be covered


def bands_mimic_occlusion(depth: float) -> bool:
    """Tells whether bands of this depth are as dark, where they are darkest, as an occlusion.

    A cell's gain is then 1 + depth·sin π(FULLY_LIT − ½), a quantile of a sinusoid.
    """
    return 1.0 - depth < OCCLUDED * (1.0 + depth * math.sin(math.pi * (FULLY_LIT - 0.5)))


def mask_occluded(samples: CellSamples, band_light: Singles | None = None) -> CellSamples:
    """The samples, with those that are occluded, or next to it, marked as not valid.

    For bands that are less dark than an occlusion, or that are known: `band_light` (cells, points) is even light under
    them.
    """
    seen = samples.light if band_light is None else samples.light / band_light
    n, k = samples.lattice.cells, samples.lattice.k
    least = min_light_shares(n, k, border_points(samples))
    if is_unoccluded(seen, samples.valid, least):
        return samples
    light = seen / seen.mean(axis=1, keepdims=True)
    usual = _quantile(light, samples.valid, 0.5)
    gain = _quantile((light / np.maximum(usual, 1e-6)).T, None if samples.valid is None else samples.valid.T, FULLY_LIT)
    alight = gain * seen.mean(axis=1) > ALIGHT * np.median(seen.mean(axis=1))
    covered = (light < least * gain[:, None] * usual) & alight[:, None]
    if band_light is not None:  # in a dark band a little less is much of what is left
        covered &= (gain[:, None] * usual - light) * band_light > (1.0 - OCCLUDED) * gain[:, None] * usual
    if samples.valid is not None:
        covered &= samples.valid
    if not covered.any():
        return samples
    whole = covered.reshape(n, n, k, k).transpose(0, 2, 1, 3).reshape(n * k, n * k).astype(np.uint8)
    near = cv2.dilate(whole, _reach(samples)).reshape(n, k, n, k).transpose(0, 2, 1, 3).reshape(n * n, k * k) > 0
    valid = ~near if samples.valid is None else samples.valid & ~near
    if (valid.mean(axis=1) < MIN_LEFT).any():
        return samples
    return replace(samples, valid=valid, light=np.where(valid, samples.light, np.float32(0)))


def is_unoccluded(light: Singles, valid: Mask | None, least: Singles) -> bool:
    """Tells whether samples (cells, points) have the share `least` of the usual light, over the mean of their cell."""
    share = light / light.mean(axis=1, keepdims=True)
    enough = share >= least * share.mean(axis=0)
    return bool(enough.all() if valid is None else enough[valid].all())


def _reach(samples: CellSamples) -> Pixels:
    """The neighbourhood that an edge's blur may reach: as that of a cell."""
    steps = np.array(samples.cell_px) * (1 - 2 * INSET) / samples.lattice.k
    across, down = np.maximum(np.round(BORDER_PX / steps), 1).astype(int).tolist()
    return np.ones((2 * down + 1, 2 * across + 1), np.uint8)


def _quantile(values: Singles, valid: Mask | None, share: float) -> Singles:
    """Returns that of each column's valid values."""
    if valid is None:
        at = int(share * len(values))
        return np.asarray(np.partition(values, at, axis=0)[at])
    ordered = np.sort(np.where(valid, values, np.inf), axis=0)
    at = (share * valid.sum(axis=0)).astype(np.intp)
    chosen = np.take_along_axis(ordered, at[None], axis=0)[0]
    return np.where(np.isfinite(chosen), chosen, np.float32(0))


@cache
def min_light_shares(n: int, k: int, border: tuple[int, int]) -> Singles:
    """(cells, points) the least share of the usual light, at its place, that an unoccluded sample has."""
    along, down = (np.ones(n * k, np.float32) for _ in border)
    for share, width in zip((along, down), border, strict=True):
        share[:width] = share[n * k - width :] = OCCLUDED_AT_RIM if width == 1 else 0.0
    least = np.minimum(np.outer(down, along), np.float32(OCCLUDED))
    return np.ascontiguousarray(least.reshape(n, k, n, k).transpose(0, 2, 1, 3).reshape(n * n, k * k))
