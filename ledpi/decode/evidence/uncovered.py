"""Leaves out the samples of cells that something stands before: what is dark there says nothing of the cell.

All cells are built alike, so but for its gain each shows the same at the same place of its own. Where one is far darker
there than the others are, it is covered.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import cv2
import numpy as np

from ledpi.decode.cells import INSET, CellSamples
from ledpi.decode.evidence.shared_light import BORDER_PX, border_points
from ledpi.kernels import uncovered as kernel
from ledpi.kernels.library import compiled
from ledpi.records import Mask, Pixels, Singles

# Of the light that the others show at this place: less is not the cell's own. Diffusers differ by a few percent.
COVERED = 0.75
ALIGHT = 0.2  # of the usual gain: a cell of less is dead, and may look like anything
FULLY_LIT = 0.75  # quantile of a cell's samples that is taken for its gain: half of the cell may be covered
MIN_LEFT = 0.25  # of a cell's samples: with less of one its gain is not known, and all is left as it is


def darkens(depth: float) -> bool:
    """Whether bands of this depth are as dark, where they are darkest, as what is covered.

    A cell's gain is then 1 + depth·sin π(FULLY_LIT − ½), a quantile of a sinusoid.
    """
    return 1.0 - depth < COVERED * (1.0 + depth * math.sin(math.pi * (FULLY_LIT - 0.5)))


def without_covered(samples: CellSamples) -> CellSamples:
    """The samples, those that are covered or next to it marked as not valid. For bands that do not darken as much."""
    n, k = samples.lattice.cells, samples.lattice.k
    tested = inner_points(n, k, border_points(samples))
    none_covered = kernel.all_uncovered if compiled() else _all_uncovered
    if none_covered(samples.light, samples.valid, tested, COVERED):
        return samples
    if samples.valid is not None:
        tested = tested & samples.valid
    light = samples.light / samples.light.mean(axis=1, keepdims=True)
    usual = _quantile(light, samples.valid, 0.5)
    gain = _quantile((light / np.maximum(usual, 1e-6)).T, None if samples.valid is None else samples.valid.T, FULLY_LIT)
    alight = gain * samples.light.mean(axis=1) > ALIGHT * np.median(samples.light.mean(axis=1))
    covered = (light < COVERED * gain[:, None] * usual) & tested & alight[:, None]
    if not covered.any():
        return samples
    whole = covered.reshape(n, n, k, k).transpose(0, 2, 1, 3).reshape(n * k, n * k).astype(np.uint8)
    near = cv2.dilate(whole, _reach(samples)).reshape(n, k, n, k).transpose(0, 2, 1, 3).reshape(n * n, k * k) > 0
    valid = ~near if samples.valid is None else samples.valid & ~near
    if (valid.mean(axis=1) < MIN_LEFT).any():
        return samples
    return replace(samples, valid=valid, light=np.where(valid, samples.light, np.float32(0)))


def _all_uncovered(light: Singles, valid: Mask | None, tested: Mask, share: float) -> bool:
    """Whether all `tested` samples (cells, points) show so much of what cells show there on average."""
    light = light / light.mean(axis=1, keepdims=True)
    return bool((light >= share * light.mean(axis=0))[tested if valid is None else tested & valid].all())


def _reach(samples: CellSamples) -> Pixels:
    """What may be near an edge: as blurred as that of a cell."""
    steps = np.array(samples.cell_px) * (1 - 2 * INSET) / samples.lattice.k
    across, down = np.maximum(np.round(BORDER_PX / steps), 1).astype(int).tolist()
    return np.ones((2 * down + 1, 2 * across + 1), np.uint8)


def _quantile(values: Singles, valid: Mask | None, share: float) -> Singles:
    """Of each column's valid values."""
    if valid is None:
        at = int(share * len(values))
        return np.asarray(np.partition(values, at, axis=0)[at])
    ordered = np.sort(np.where(valid, values, np.inf), axis=0)
    at = (share * valid.sum(axis=0)).astype(np.intp)
    chosen = np.take_along_axis(ordered, at[None], axis=0)[0]
    return np.where(np.isfinite(chosen), chosen, np.float32(0))


@cache
def inner_points(n: int, k: int, border: tuple[int, int]) -> Mask:
    """(cells, points) but for those near the panel's rim, which are darker for being there."""
    inner = np.zeros((n * k, n * k), bool)
    across, down = border
    inner[down : n * k - down, across : n * k - across] = True
    return inner.reshape(n, k, n, k).transpose(0, 2, 1, 3).reshape(n * n, k * k)
