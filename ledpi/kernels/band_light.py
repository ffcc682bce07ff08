"""What the light around a square says of blinking cells there (band_light.c)."""

from __future__ import annotations

import ctypes

import numpy as np
from numpy.typing import NDArray

from ledpi.kernels.library import DOUBLE, INTEGER, POINTER, address, function
from ledpi.records import Floats, Mask, Singles

_explain = function(
    "ledpi_lattices_explain", *(POINTER,) * 2, *(INTEGER,) * 4, *(POINTER,) * 4, DOUBLE, INTEGER, *(POINTER,) * 2
)
_bands_at = function(
    "ledpi_bands_at", POINTER, *(INTEGER,) * 2, *(DOUBLE,) * 3, *(INTEGER,) * 2, *(POINTER,) * 3, INTEGER,
    *(POINTER,) * 8, result=ctypes.c_int,
)  # fmt: skip


def bands_at(
    light: Singles,
    levels: tuple[float, float, float],
    lattice: tuple[Singles, ...],
    tables: Singles,
    cycles: tuple[Floats, Floats],
    antiphase: Mask,
    corners: NDArray[np.complex128],
) -> tuple[Floats, Mask] | None:
    """Dark and bright level, spec, phases (of 32), share explained, brightness of cells over the bright level; and
    (cells,) which are white. None: not bright.

    Of light (rows, columns) in a square with `corners` (4,). `levels`: the dark level is no more than this, is exceeded
    so many times, and what is brighter than so many times the bright level counts no more. `lattice`: places across and
    down, shares of cells, (cells, points) each. `tables` (specs, 2, steps), `cycles` that pass (specs, 2) in a row and
    before the first one.
    """
    cells, points = lattice[0].shape
    found, white, room, corners = np.empty(7), np.empty(cells, np.bool_), np.empty(3 * cells * points), corners.copy()
    bright = _bands_at(
        address(light), *light.shape, *levels, cells, points, *map(address, lattice), len(tables),
        address(tables), *map(address, cycles), address(antiphase), address(corners), address(room), address(found),
        address(white),
    )  # fmt: skip
    return (found, white) if bright else None


def lattices_explain(
    light: Singles, shown: Singles, lattice: tuple[Singles, ...], corners: NDArray[np.complex128], focal_px: float
) -> Floats:
    """(N,) what a lattice in each of corners (N, 4) explains of relative light (rows, columns).

    `shown` (2, rows): what either class shows in each row. `lattice`: places across and down, shares of cells and of
    walls, (cells, points) each.
    """
    corners, worth = np.ascontiguousarray(corners), np.empty(len(corners))
    _explain(
        address(light), address(shown), *light.shape, *lattice[0].shape, *map(address, lattice), focal_px,
        len(corners), address(corners), address(worth),
    )  # fmt: skip
    return worth
