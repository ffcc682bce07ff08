"""The outlines of what is lit in a picture (outlines.c)."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ledpi.kernels.library import DOUBLE, INTEGER, POINTER, address, function

_OUTLINE = np.dtype(
    [(name, np.int32) for name in ("first", "length", "left", "top", "right", "bottom", "longest_hole")]
    + [("area", np.float64)],
    align=True,
)
_outlines = function(
    "ledpi_outlines",
    *(POINTER, INTEGER, INTEGER, ctypes.c_int32, ctypes.c_int32, DOUBLE, DOUBLE, ctypes.c_int32, ctypes.c_int32),
    *(POINTER, POINTER, INTEGER, POINTER, INTEGER, POINTER, POINTER, POINTER),
    result=INTEGER,
)
_through_sides = function("ledpi_through_sides", POINTER, INTEGER, POINTER, result=ctypes.c_bool)


def through_sides(corners: list[list[float]], points: NDArray[np.int32]) -> list[list[float]]:
    """Where straight lines through each side's part of an outline (N, 1, 2) cross; `corners` where they do not."""
    points, found = np.ascontiguousarray(points, np.int32), np.array(corners, np.float64)
    _through_sides(address(points), len(points), address(found))  # else they stay as they are
    crossings: list[list[float]] = found.tolist()
    return crossings


class Outliner:
    """Follows outlines in pictures of one size, in room that it keeps."""

    def __init__(self, height: int, width: int) -> None:
        self._mark = np.empty((height + 2, width + 2), np.int32)
        self._points = np.empty((height * width, 2), np.int32)
        self._found = np.empty((height + 1) * (width + 1) // 4 + 1, _OUTLINE)  # as many pixels as can stand apart
        self._at_border, self._spot_count = np.empty(1, np.intp), np.empty(1, np.intp)
        self._spots = np.empty((len(self._found), 3))
        self._room = (
            *(address(self._mark), address(self._points), len(self._points), address(self._found), len(self._found)),
            *(address(self._at_border), address(self._spots), address(self._spot_count)),
        )

    def outlines(
        self,
        lit: NDArray[np.uint8],
        *,
        shortest: int,
        narrowest: int,
        longest_hole: float,
        least_area: float,
        spot_lengths: tuple[int, int],
    ) -> tuple[list[tuple[NDArray[Any], float]], int, NDArray[np.float64]]:
        """Points (N, 1, 2) and area of each that is wanted; and how many are but for touching the picture's border.

        Third, the middles and lengths (M, 3) of all whose length is within `spot_lengths`, the end excluded.

        `lit` is 0 or 255. `shortest` in points; `narrowest` in pixels, across or down; `longest_hole` over the length;
        `least_area` over that of the box around. What is returned lasts until the next call.
        """
        height, width = lit.shape
        count = _outlines(
            *(address(lit), height, width, shortest, narrowest, longest_hole, least_area, *spot_lengths),
            *self._room,
        )
        found = self._found[:count].tolist()
        outlines = [(self._points[own[0] : own[0] + own[1], None], own[7]) for own in found]
        return outlines, int(self._at_border[0]), self._spots[: self._spot_count[0]]
