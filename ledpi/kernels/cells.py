"""The light of a panel's cells (cells.c)."""

from __future__ import annotations

from functools import cache

import numpy as np

from ledpi.core.records import Floats, Frame, Intrinsics, Singles
from ledpi.core.tone import linear_light
from ledpi.kernels.lens import bending_lens_of
from ledpi.kernels.library import NONE, doubles, ffi, lib, pointer

STEPS = 512  # between two pixels, for which there are weights


@cache
def _lanczos() -> Singles:
    """(STEPS + 1, 8) weights of the pixels −3 … 4 for every share of the way from pixel 0 to 1, their sum 1."""
    away = np.arange(-3, 5) - np.arange(STEPS + 1)[:, None] / STEPS
    weights = np.sinc(away) * np.sinc(away / 4)
    return np.ascontiguousarray(weights / weights.sum(axis=1, keepdims=True), np.float32)


def sample_cells(
    frame: Frame,
    corners_px: Floats,
    lens: Intrinsics | None,
    cells: int,
    k: int,
    along: Singles,
) -> tuple[Singles, Singles, bool, float] | None:
    """Light and picture rows (cells², k²) on a lattice inside `corners_px` (4, 2), bent as the `lens` does.

    And whether a pixel of those that this takes in is saturated, and the least sum of light over a cell, not a number
    where that spoils a sample. None where corners or points leave the picture. Raises MemoryError.
    """
    light, rows = np.empty((cells * cells, k * k), np.float32), np.empty((cells * cells, k * k), np.float32)
    least, corners = np.empty(1), doubles(corners_px)
    pixels = frame.pixels if frame.pixels.strides[1] == 1 else np.ascontiguousarray(frame.pixels)
    first = ffi.cast("uint8_t *", pixels.__array_interface__["data"][0])  # rows may be apart
    bending = bending_lens_of(lens)
    outcome = lib.ledpi_sample_cells(
        *(first, *pixels.shape, pixels.strides[0], pointer(linear_light(frame.transfer, mark_saturated=True))),
        *(pointer(corners), NONE if bending is None else pointer(bending), cells, k, pointer(along)),
        *(pointer(_lanczos()), STEPS, pointer(light), pointer(rows), pointer(least)),
    )
    if outcome == lib.LEDPI_NOT_SAMPLED:
        raise MemoryError
    if outcome == lib.LEDPI_OUTSIDE:
        return None
    return light, rows, outcome == lib.LEDPI_SOME_SATURATED, float(least[0])
