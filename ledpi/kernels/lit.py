"""What is lit in a picture (lit.c)."""

from __future__ import annotations

import ctypes

import numpy as np

from ledpi.kernels.library import INTEGER, POINTER, address, function
from ledpi.records import Pixels

REACH, STRIP = 6, 44  # as in lit.c: of the window to either side, and rows that are looked at together

_contrast = function("ledpi_contrast", POINTER, INTEGER, INTEGER, *(POINTER,) * 3)
_lit = function(
    "ledpi_lit", POINTER, POINTER, INTEGER, INTEGER, ctypes.c_int, ctypes.c_int, ctypes.c_bool, POINTER, POINTER
)


class Lighter:
    """Fills `above`, `contrast` and `lit` (height, width) of `Lit`, in room that it keeps."""

    def __init__(self, above: Pixels, contrast: Pixels, lit: Pixels) -> None:
        height, width = lit.shape
        self._kept = above, contrast, lit, np.empty(max(3 * STRIP, height + 1) * (width + 2 * REACH), np.uint8)
        self._at = [address(array) for array in self._kept]
        self._size = height, width

    def look(self, picture: Pixels) -> None:
        assert picture.shape == self._size
        above, contrast, _, room = self._at
        _contrast(address(picture), *self._size, room, above, contrast)

    def by(self, share: int, least: int, opened: bool) -> None:
        above, contrast, lit, room = self._at
        _lit(above, contrast, *self._size, share, least, opened, room, lit)
