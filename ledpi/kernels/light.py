"""Linear light between the pixels of a frame (light.c)."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ledpi.kernels.library import INTEGER, POINTER, address, compiled, function
from ledpi.records import Frame, Singles, Transfer
from ledpi.tone import linear_light

PICTURE = (POINTER, INTEGER, INTEGER, INTEGER, POINTER)
_light_at = function("ledpi_light_at", *PICTURE, POINTER, POINTER, INTEGER, POINTER)


@cache
def _table_at(transfer: Transfer, mark_saturated: bool) -> int:
    return address(linear_light(transfer, mark_saturated=mark_saturated))  # which is kept for good


def can_read(frame: Frame) -> bool:
    """Whether the compiled loops are there, and can read this frame: pixels side by side, 2 × 2 at least."""
    return compiled() and frame.pixels.strides[1] == 1 and min(frame.pixels.shape) >= 2


def picture(frame: Frame, *, mark_saturated: bool = False) -> tuple[int, int, int, int, int]:
    """A frame's arguments to a function that takes a PICTURE."""
    pixels = frame.pixels
    height, width = pixels.shape
    at = pixels.__array_interface__["data"][0]
    return at, height, width, pixels.strides[0], _table_at(frame.transfer, mark_saturated)


def light_at(frame: Frame, points: NDArray[np.complex64]) -> Singles:
    """Bilinear, at points (…) x + iy; beyond the picture as at its border. Saturated light is 1."""
    x, y = (np.ascontiguousarray(of, np.float32) for of in (points.real, points.imag))
    light: NDArray[Any] = np.empty(points.shape, np.float32)
    _light_at(*picture(frame), address(x), address(y), points.size, address(light))
    return light
