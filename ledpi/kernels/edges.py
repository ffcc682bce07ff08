"""Sides of lit squares, and how they are approached (edges.c, approach.c)."""

from __future__ import annotations

import ctypes
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ledpi.decode.rim import (
    BLUR_STEP,
    MAX_BLUR_PX,
    MAX_PITCH_PX,
    MIN_BLUR_PX,
    MIN_PITCH_PX,
    PITCH_STEP,
    USUAL_BLUR_PX,
    RimFilter,
    filter_key,
    rim_filter,
)
from ledpi.kernels.library import INTEGER, POINTER, address, function
from ledpi.kernels.light import PICTURE, picture
from ledpi.records import Floats, Frame

MOST_PROFILES = 64  # as in kernels.h
NUMBERS = 7  # of a quad, as in edges.c

_find_sides = function(
    "ledpi_find_sides", *PICTURE, *(POINTER,) * 3, INTEGER, POINTER, INTEGER, POINTER, *(INTEGER,) * 2, *(POINTER,) * 4,
    result=INTEGER,
)  # fmt: skip
_nearest_sides = function("ledpi_nearest_sides", *PICTURE, POINTER, INTEGER, POINTER, INTEGER, *(POINTER,) * 5)


class _Filters(ctypes.Structure):
    """`Filters` of rim.h."""

    _fields_ = [
        ("filters", ctypes.c_void_p),
        *((name, ctypes.c_ssize_t) for name in ("pitches", "blurs", "first_pitch", "first_blur")),
        *((name, ctypes.c_double) for name in ("pitch_step", "blur_step", "least_pitch_px", "most_pitch_px")),
        *((name, ctypes.c_double) for name in ("least_blur_px", "most_blur_px", "usual_blur_px")),
    ]


def _packed(made: RimFilter) -> Floats:
    """`Filter` of rim.h."""
    single, both = (made.single.ravel(), [made.single_offset]), (made.both.ravel(), made.both_offset)
    return np.concatenate([[1.0], *single, *both, made.apart, [made.both_variance, made.apart_variance]])


class FilterTable:
    """Every filter there may be, by pitch and blur; made when it is asked for, and kept for good."""

    def __init__(self) -> None:
        first, last = filter_key(MIN_PITCH_PX, MIN_BLUR_PX), filter_key(MAX_PITCH_PX, MAX_BLUR_PX)
        self._first, self._blurs = first, last[1] - first[1] + 1
        self._rows = np.zeros(((last[0] - first[0] + 1) * self._blurs, len(_packed(rim_filter(*first)))))
        self.structure = _Filters(
            address(self._rows), last[0] - first[0] + 1, self._blurs, *first, PITCH_STEP, BLUR_STEP,
            MIN_PITCH_PX, MAX_PITCH_PX, MIN_BLUR_PX, MAX_BLUR_PX, USUAL_BLUR_PX,
        )  # fmt: skip
        self.at = ctypes.addressof(self.structure)

    def make(self, number: int) -> None:
        pitch, blur = divmod(number, self._blurs)
        packed = _packed(rim_filter(self._first[0] + pitch, self._first[1] + blur))
        self._rows[number, 1:] = packed[1:]
        self._rows[number, 0] = 1.0  # last, as another thread may look


@cache
def filter_table() -> FilterTable:
    return FilterTable()


def find_sides(
    frame: Frame,
    near: NDArray[np.complex128],
    bends: NDArray[np.complex128],
    cells: int,
    shares: tuple[Floats, Floats],
    coarse: tuple[Floats, NDArray[np.float32]],
) -> tuple[NDArray[np.complex128], Floats]:
    """Corners (N, 4) of the lit squares near `near` (N, 4), and seven numbers of each (N, 7).

    1 where all its sides show edges, else 0; the share of its profiles that are used; in pixels the root mean square of
    the edges about the sides, the corners' deviation, how far they were moved, the side where it was sought, and how
    far the lens bends that. `shares` (P,) and their bends (2, P): where the sides are looked across; `coarse`: the same
    where they are sought from further off, and templates of the step there.
    """
    assert len(shares[0]) <= MOST_PROFILES
    table, corners, numbers = filter_table(), np.empty_like(near), np.empty((len(near), NUMBERS))
    arguments = (
        *picture(frame), table.at, address(shares[0]), address(shares[1]), len(shares[0]), address(coarse[0]),
        len(coarse[0]), address(coarse[1]), cells, len(near), address(near), address(bends), address(corners),
        address(numbers),
    )  # fmt: skip
    while missing := _find_sides(*arguments):
        table.make(missing - 1)
    return corners, numbers


def nearest_sides(
    frame: Frame, corners: NDArray[np.complex128], step_px: Floats, share: Floats, templates: NDArray[np.float32]
) -> tuple[NDArray[np.complex128], Floats, NDArray[np.bool_]]:
    """As `nearest_sides` of decode/approach.py, with light that is interpolated as light."""
    count = len(corners)
    found, spread, seen = np.empty_like(corners), np.empty(count), np.empty(count, np.bool_)
    _nearest_sides(
        *picture(frame), address(share), len(share), address(templates), count, address(corners), address(step_px),
        address(found), address(spread), address(seen),
    )  # fmt: skip
    return found, spread, seen
