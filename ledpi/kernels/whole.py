"""Light along quads, and what cells leave unexplained of it (whole.c)."""

from __future__ import annotations

import ctypes

import numpy as np
from numpy.typing import NDArray

from ledpi.kernels.library import DOUBLE, INTEGER, POINTER, address, function
from ledpi.kernels.light import PICTURE, picture
from ledpi.records import Floats, Frame

_light_along = function("ledpi_light_along", *PICTURE, *(INTEGER,) * 2, *(POINTER,) * 5)
_unexplained = function(
    "ledpi_unexplained", *(POINTER,) * 3, INTEGER, POINTER, INTEGER, DOUBLE, POINTER, result=ctypes.c_int
)


def light_along(
    frame: Frame, corners: NDArray[np.complex128], bends: NDArray[np.complex128], cubics: Floats, cells: int
) -> tuple[Floats, Floats]:
    """(N, 2, places) light along quads (N, 4), its mean 1; and (N, 2) their sides, and how far the lens bends these.

    `cubics` (2, places): how `bends` move each place.
    """
    light, sizes_px = np.empty((len(corners), *cubics.shape)), np.empty((len(corners), 2))
    _light_along(
        *(*picture(frame), cells, len(corners), address(corners), address(bends), address(cubics)),
        *(address(light), address(sizes_px)),
    )
    return light, sizes_px


def unexplained(
    light: Floats, bases: Floats, first: NDArray[np.intp], counted: Floats, whole: int, little: float
) -> tuple[int, Floats]:
    """What explanations leave (2, E) of light (2, places), and a bit for each axis of which that was worth finding out.

    That is where the explanation `whole` leaves more than `little`. `bases` (columns, places), orthonormal: those of
    explanation e from first[e] to first[e + 1] (E + 1,).
    """
    left = np.empty((2, len(first) - 1))
    axes: int = _unexplained(
        address(light), address(bases), address(first), len(first) - 1, address(counted), whole, little, address(left)
    )
    return axes, left
