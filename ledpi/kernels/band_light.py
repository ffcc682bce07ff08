"""How much lattices of blinking cells explain (band_light.c)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ledpi.kernels.library import DOUBLE, INTEGER, POINTER, address, function
from ledpi.records import Floats

Singles = NDArray[np.float32]

_explain = function(
    "ledpi_lattices_explain", *(POINTER,) * 2, *(INTEGER,) * 4, *(POINTER,) * 4, DOUBLE, INTEGER, *(POINTER,) * 2
)


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
