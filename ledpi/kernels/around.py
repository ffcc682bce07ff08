"""The smallest quadrilateral around an outline (around.c)."""

from __future__ import annotations

import ctypes

import numpy as np
from numpy.typing import NDArray

from ledpi.kernels.library import INTEGER, POINTER, address, function

_smallest_square = function("ledpi_smallest_square", POINTER, INTEGER, POINTER, result=ctypes.c_int)


def smallest_square(outline: NDArray[np.complex128]) -> NDArray[np.complex128] | None:
    """(4,) on four sides of a convex outline (K,), at most 16, clockwise in the picture; None where there is none."""
    outline, square = np.ascontiguousarray(outline), np.empty(4, np.complex128)
    return square if _smallest_square(address(outline), len(outline), address(square)) else None
