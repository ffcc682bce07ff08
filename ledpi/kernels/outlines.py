"""The outlines of what is lit in a picture, and the squares among them (outlines.c, four_sides.c, distinct.c)."""

from __future__ import annotations

import ctypes
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ledpi.kernels.library import DOUBLE, INTEGER, POINTER, address, function
from ledpi.records import Floats

OUTLINE = np.dtype(
    [(name, np.int32) for name in ("first", "length", "left", "top", "right", "bottom")] + [("area", np.float64)],
    align=True,
)  # as in outlines.h
SQUARE = 11  # numbers: four corners' x and y, side_px, misfit, tolerance_px

_outlines = function(
    "ledpi_outlines",
    *(POINTER, INTEGER, INTEGER, ctypes.c_int32, ctypes.c_int32, DOUBLE, DOUBLE, ctypes.c_int32, ctypes.c_int32),
    *(POINTER, POINTER, POINTER, INTEGER, POINTER, INTEGER, POINTER, POINTER),
    result=INTEGER,
)
_four_sides = function(
    "ledpi_four_sides", POINTER, POINTER, INTEGER, DOUBLE, DOUBLE, *(POINTER,) * 4, result=INTEGER
)
_distinct = function("ledpi_distinct", POINTER, INTEGER, POINTER, result=INTEGER)


class Outliner:
    """Follows outlines in pictures of one size, in room that it keeps."""

    def __init__(self, height: int, width: int) -> None:
        self._points = np.empty((height * width, 2), np.int32)
        self._found = np.empty((height + 1) * (width + 1) // 4 + 1, OUTLINE)  # as many pixels as can stand apart
        self._counts = np.empty(2, np.intp)  # at the border, spots
        self._spots = np.empty((len(self._found), 3))
        self._runs, self._things = np.empty((2, width, 3), np.int32), np.empty((len(self._found), 7), np.int32)
        self._room = (
            *(address(self._runs), address(self._things), address(self._points), len(self._points)),
            *(address(self._found), len(self._found), address(self._spots), address(self._counts)),
        )

    def outlines(
        self,
        lit: NDArray[np.uint8],
        *,
        shortest: int,
        narrowest: int,
        least_area: float,
        least_lit: float,
        spot_lengths: tuple[int, int],
    ) -> tuple[NDArray[np.int32], NDArray[Any], int, Floats]:
        """Points (P, 2) and outlines (N,) of OUTLINE that are wanted; how many are but for the picture's border.

        Last, of each spot (M, 3) the middle's x and y, and the outline's length.

        `lit` is 0 or 255. `shortest` is the way around the box, in pixels, as `spot_lengths` are, the end excluded;
        `narrowest` in pixels, across or down; `least_area` over the box's; `least_lit` of what is within the outline.
        What is returned lasts until the next call.
        """
        height, width = lit.shape
        count = _outlines(
            *(address(lit), height, width, shortest, narrowest, least_area, least_lit, *spot_lengths),
            *self._room,
        )
        at_border, spots = self._counts.tolist()
        return self._points, self._found[:count], at_border, self._spots[:spots]


class Squarer:
    """Finds the squares among outlines in pictures so high, in room that it keeps."""

    def __init__(self, height: int) -> None:
        self._ends, self._hull = np.empty((height, 2), np.int32), np.empty((2 * height + 2, 2))
        self._counts = np.empty(2, np.intp)
        self._room = address(self._ends), address(self._hull)

    def squares(
        self, points: NDArray[np.int32], outlines: NDArray[Any], scale: float, smallest_px: float
    ) -> tuple[Floats, int, int]:
        """(K, SQUARE), how many outlines are no squares, and how many squares are too small."""
        found = np.empty((len(outlines), SQUARE))
        count = _four_sides(
            *(address(points), address(outlines), len(outlines), scale, smallest_px, *self._room),
            *(address(found), address(self._counts)),
        )
        not_four_sided, too_small = self._counts.tolist()
        return found[:count], not_four_sided, too_small


def distinct(squares: Floats) -> NDArray[np.intp]:
    """As `distinct` of decode/four_sides.py."""
    kept = np.empty(len(squares), np.intp)
    return kept[: _distinct(address(squares), len(squares), address(kept))]
