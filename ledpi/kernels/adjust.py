"""Corners by all the lines of a lattice (adjust.c, inner_lines.c)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ledpi.kernels.edges import filter_table
from ledpi.kernels.library import INTEGER, POINTER, address, function
from ledpi.kernels.light import PICTURE, picture
from ledpi.kernels.pose import lens_of
from ledpi.records import Floats, Frame, Intrinsics

MOST_CELLS = 8  # a side, as in lattice.h

_adjust = function("ledpi_adjust", *PICTURE, POINTER, *(INTEGER,) * 2, *(POINTER,) * 5, result=INTEGER)


def adjusted(
    frame: Frame,
    corners: NDArray[np.complex128],
    bends: NDArray[np.complex128],
    cells: int,
    intrinsics: Intrinsics | None,
) -> tuple[NDArray[np.complex128], Floats]:
    """As `_adjusted` of decode/adjust.py, in the frame's own pixels."""
    assert 2 < cells <= MOST_CELLS
    table, better, sigma_px = filter_table(), np.empty_like(corners), np.empty(len(corners))
    corners, bends = np.ascontiguousarray(corners), np.ascontiguousarray(bends)
    lens = lens_of(intrinsics) if intrinsics is not None and any(intrinsics.distortion) else None
    arguments = (
        *picture(frame), table.at, cells, len(corners), address(corners), address(bends),
        None if lens is None else address(lens), address(better), address(sigma_px),
    )  # fmt: skip
    while missing := _adjust(*arguments):
        table.make(missing - 1)
    return better, sigma_px
