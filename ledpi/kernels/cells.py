"""The light of a panel's cells (cells.c)."""

from __future__ import annotations

import ctypes
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ledpi.kernels.library import INTEGER, POINTER, address, doubles, function
from ledpi.kernels.light import PICTURE, picture
from ledpi.kernels.pose import lens_of
from ledpi.records import Floats, Frame, Intrinsics

Singles = NDArray[np.float32]

STEPS = 512  # between two pixels, for which there are weights

_sample_cells = function(
    "ledpi_sample_cells", *PICTURE, *(POINTER,) * 2, *(INTEGER,) * 2, POINTER, *(INTEGER,) * 5, POINTER, INTEGER,
    *(POINTER,) * 4, result=ctypes.c_int,
)  # fmt: skip


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
    window: tuple[int, int, int, int],
    shrink: int,
) -> tuple[Singles, Singles, bool, float]:
    """Light and picture rows (cells², k²) on a lattice inside `corners_px` (4, 2), bent by the `lens` if it is given.

    And whether a pixel of the window is saturated, and the least sum of light over a cell, not a number where that
    spoils a sample. `window`: first column and row, columns and rows, each of `shrink` pixels, all within the picture.
    """
    light, rows = np.empty((2, cells * cells, k * k), np.float32)
    room, least, corners = np.empty(window[2] * window[3], np.float32), np.empty(1), doubles(corners_px)
    saturated = _sample_cells(
        *picture(frame, mark_saturated=True), address(corners), None if lens is None else address(lens_of(lens)),
        cells, k, address(along), *window, shrink, address(_lanczos()), STEPS, address(room), address(light),
        address(rows), address(least),
    )  # fmt: skip
    return light, rows, bool(saturated), float(least[0])
