"""A panel's corners by its inner lines alone (inner_square.c)."""

from __future__ import annotations

import ctypes

import numpy as np

from ledpi.kernels.library import INTEGER, POINTER, address, function
from ledpi.kernels.light import PICTURE, picture
from ledpi.kernels.pose import lens_of
from ledpi.records import Floats, Frame, Intrinsics

_inner_square = function("ledpi_inner_square", *PICTURE, POINTER, INTEGER, POINTER, result=ctypes.c_double)


def told(frame: Frame, near: Floats, cells: int, intrinsics: Intrinsics | None) -> tuple[Floats, float]:
    """As `_told` of decode/corners/inner_square.py."""
    corners = np.array(near, np.float64)
    lens = lens_of(intrinsics) if intrinsics is not None and any(intrinsics.distortion) else None
    sigma_px: float = _inner_square(*picture(frame), None if lens is None else address(lens), cells, address(corners))
    return corners, sigma_px
