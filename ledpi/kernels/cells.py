"""The light of a panel's cells (cells.c)."""

from __future__ import annotations

import ctypes
from functools import cache

import numpy as np

from ledpi.kernels.library import DOUBLE, INTEGER, POINTER, address, doubles, function
from ledpi.kernels.light import PICTURE, picture
from ledpi.kernels.pose import lens_of
from ledpi.records import Floats, Frame, Intrinsics, Singles

STEPS = 512  # between two pixels, for which there are weights
NONE_SATURATED, SOME_SATURATED, OUTSIDE, NO_MEMORY = range(4)  # as in cells.c

_sample_cells = function(
    "ledpi_sample_cells", *PICTURE, POINTER, DOUBLE, POINTER, *(INTEGER,) * 2, POINTER, POINTER, INTEGER,
    *(POINTER,) * 3, result=ctypes.c_int,
)  # fmt: skip


@cache
def _lanczos() -> Singles:
    """(STEPS + 1, 8) weights of the pixels −3 … 4 for every share of the way from pixel 0 to 1, their sum 1."""
    away = np.arange(-3, 5) - np.arange(STEPS + 1)[:, None] / STEPS
    weights = np.sinc(away) * np.sinc(away / 4)
    return np.ascontiguousarray(weights / weights.sum(axis=1, keepdims=True), np.float32)


@cache
def _lanczos_at() -> int:
    return address(_lanczos())  # which is kept for good


def sample_cells(
    frame: Frame,
    corners_px: Floats,
    bend_px: float,
    lens: Intrinsics | None,
    cells: int,
    k: int,
    along: Singles,
) -> tuple[Singles, Singles, bool, float] | None:
    """Light and picture rows (cells², k²) on a lattice inside `corners_px` (4, 2), bent by the `lens` if it is given.

    And whether a pixel of those that this takes in is saturated, and the least sum of light over a cell, not a number
    where that spoils a sample. None where corners, or sides that are bent by `bend_px`, leave the picture.
    Raises MemoryError.
    """
    light, rows = np.empty((cells * cells, k * k), np.float32), np.empty((cells * cells, k * k), np.float32)
    least, corners = np.empty(1), doubles(corners_px)
    outcome = _sample_cells(
        *picture(frame, mark_saturated=True), address(corners), bend_px,
        None if lens is None else address(lens_of(lens)), cells, k, address(along), _lanczos_at(), STEPS,
        address(light), address(rows), address(least),
    )  # fmt: skip
    if outcome == NO_MEMORY:
        raise MemoryError
    return None if outcome == OUTSIDE else (light, rows, outcome == SOME_SATURATED, float(least[0]))
