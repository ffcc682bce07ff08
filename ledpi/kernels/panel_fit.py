"""The picture of a panel fitted to light (panel_fit.c)."""

from __future__ import annotations

import ctypes

import numpy as np
from numpy.typing import NDArray

from ledpi.kernels.library import DOUBLE, INTEGER, POINTER, address, function
from ledpi.kernels.pose import lens_of
from ledpi.records import Floats, Intrinsics, Mask, Singles

MOST_CELLS, MOST_ALONG = 8, 160  # along a side; places along the grid

_fit = function(
    "ledpi_fit_panel", POINTER, *(INTEGER,) * 2, *(DOUBLE,) * 4, POINTER, INTEGER, *(POINTER,) * 2, INTEGER, POINTER,
    *(DOUBLE,) * 2, INTEGER, *(POINTER,) * 2, INTEGER, *(POINTER,) * 4, result=ctypes.c_int,
)  # fmt: skip


def fit_panel(
    light: Singles,
    first: complex,
    shrink: int,
    lens: Intrinsics | None,
    cells: int,
    white: Mask,
    waves: Singles,
    cycles_a_row: Floats,
    levels: tuple[float, float, float],
    along: Floats,
    pitch_px: Floats,
    rounds: int,
    prior: Floats,
    corners: NDArray[np.complex128],
    unknown: Floats,
) -> tuple[float, float, float] | None:
    """Changes `corners` (4,) and `unknown` (U,) to what fits best. The share explained, and `_deviations`.

    Arguments as in decode/striped/panel_fit.py; `levels`: dark, bright and saturated. None where it comes to nothing.
    """
    dark, bright, saturated = levels
    result = np.empty(5)
    fits = _fit(
        address(light), *light.shape, first.real, first.imag, shrink, saturated,
        None if lens is None else address(lens_of(lens)), cells, address(white), address(waves), waves.ndim == 3,
        address(cycles_a_row), dark, 1 / (bright - dark), len(along), address(along), address(pitch_px), rounds,
        address(prior), address(corners), address(unknown), address(result),
    )  # fmt: skip
    return (float(result[0]), float(result[3]), float(result[4])) if fits else None
