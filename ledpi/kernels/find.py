"""Squares in the pictures of a pyramid (find.c and what it calls)."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ledpi.kernels.library import INTEGER, POINTER, address, function
from ledpi.records import Floats, Pixels

# As in find.h, where they are sizes: pixels to either side of a window, rows taken together.
REACH, STRIP = 6, 44
LIMITS = 19  # numbers in `Limits` of find.h
SQUARE = 11  # numbers: four corners' x and y, side_px, misfit, tolerance_px
MOST_LEVELS, MOST_SHARES = 10, 2  # of a picture
MOST_SQUARES = 4096  # in a frame: more is texture, and would take a second to look at
_OUTLINE_BYTES, _THING_NUMBERS = 32, 7

_find = function("ledpi_find", POINTER, INTEGER, POINTER, POINTER, POINTER)

# Of each picture: grey levels that what is lit is brighter than, and shares of the contrast by which it is, in 256ths.
Thresholds: TypeAlias = tuple[tuple[tuple[int, ...], tuple[int, ...]], ...]


class _Level(ctypes.Structure):
    """`Level` of find.c."""

    _fields_ = [
        ("picture", ctypes.c_void_p),
        *((name, ctypes.c_ssize_t) for name in ("height", "width", "scale", "levels", "shares")),
        ("brighter_than", ctypes.c_int32 * MOST_LEVELS),
        ("lit_by", ctypes.c_int32 * MOST_SHARES),
        ("shortest", ctypes.c_int32),
    ]


class _Wanted(ctypes.Structure):
    """`Wanted` of find.c."""

    _fields_ = [
        ("smallest_px", ctypes.c_double),
        ("cells", ctypes.c_ssize_t),
        ("limits", ctypes.c_double * LIMITS),
    ]


class _Room(ctypes.Structure):
    """`Room` of find.c."""

    _fields_ = [
        *((name, ctypes.c_void_p) for name in ("window", "above", "contrast", "melt", "lit")),
        *((name, ctypes.c_void_p) for name in ("runs", "things", "outlines")),
        ("most", ctypes.c_ssize_t),
        ("points", ctypes.c_void_p),
        ("points_room", ctypes.c_ssize_t),
        *((name, ctypes.c_void_p) for name in ("ends", "hull")),
    ]


class _Found(ctypes.Structure):
    """`Found` of find.c."""

    _fields_ = [
        *((name, ctypes.c_void_p) for name in ("squares", "distinct")),
        *((name, ctypes.c_ssize_t) for name in ("most_squares", "square_count", "distinct_count")),
        *((name, ctypes.c_ssize_t) for name in ("at_border", "not_four_sided", "too_small")),
    ]


class Searcher:
    """Searches the same pictures again and again, in room that it keeps."""

    def __init__(
        self,
        pictures: Sequence[Pixels],
        shortest: Sequence[int],
        smallest_px: float,
        cells: int,
        limits: Sequence[float],
    ) -> None:
        """`pictures`, read anew each time, the largest first, and the `shortest` way around things in each.

        `limits`: as `Limits` of find.h has them.
        """
        height, width = pictures[0].shape
        self._pictures, self._shortest = tuple(pictures), tuple(shortest)
        most = (height + 1) * (width + 1) // 4 + 1  # as many pixels as can stand apart
        self._room, self._arrays = _room(height, width, most)
        self._squares = np.empty((MOST_SQUARES, SQUARE))
        self._distinct = np.empty(MOST_SQUARES, np.intp)
        self._found = _Found(address(self._squares), address(self._distinct), MOST_SQUARES)
        self._levels: dict[Thresholds, Any] = {}
        self._wanted = _Wanted(smallest_px, cells, (ctypes.c_double * LIMITS)(*limits))
        self._arguments = [ctypes.addressof(made) for made in (self._wanted, self._room, self._found)]

    def search(self, thresholds: Thresholds) -> tuple[Floats, tuple[int, int, int]]:
        """Distinct squares (K, SQUARE), the best first; and how many outlines touch the picture's border, show no
        square, or show one that is too small.
        """
        levels = self._levels.get(thresholds)
        if levels is None:
            levels = self._levels[thresholds] = self._levels_for(thresholds)
        _find(ctypes.addressof(levels), len(levels), *self._arguments)
        found = self._found
        squares = self._squares[self._distinct[: found.distinct_count]]
        return squares, (found.at_border, found.not_four_sided, found.too_small)

    def _levels_for(self, thresholds: Thresholds) -> Any:
        levels = (_Level * len(self._pictures))()
        for number, (picture, shortest, (brighter_than, lit_by)) in enumerate(
            zip(self._pictures, self._shortest, thresholds, strict=True)
        ):
            levels[number] = _Level(
                *(address(picture), *picture.shape, 2 << number, len(brighter_than), len(lit_by)),
                *(_padded(brighter_than, MOST_LEVELS), _padded(lit_by, MOST_SHARES), shortest),
            )
        return levels


def _padded(numbers: tuple[int, ...], count: int) -> Any:
    return (ctypes.c_int32 * count)(*numbers)


def _room(height: int, width: int, most: int) -> tuple[_Room, list[NDArray[np.generic]]]:
    """For pictures of this size, and the arrays that it consists of."""
    pixels = [np.empty((height, width), np.uint8) for _ in range(3)]
    arrays: list[NDArray[np.generic]] = [
        np.empty(3 * STRIP * (width + 2 * REACH), np.uint8),
        *pixels[:2],
        np.empty((height + 1) * (width + 2), np.uint8),
        pixels[2],
        np.empty((2, width, 3), np.int32),
        np.empty((most, _THING_NUMBERS), np.int32),
        np.empty((most, _OUTLINE_BYTES), np.uint8),
        np.empty((height * width, 2), np.int32),
        np.empty((height, 2), np.int32),
        np.empty((2 * height + 2, 2)),
    ]
    at = [address(array) for array in arrays]
    return _Room(*at[:8], most, at[8], height * width, *at[9:]), arrays
