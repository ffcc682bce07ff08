"""Whether something stands before a panel's cells (uncovered.c)."""

from __future__ import annotations

import ctypes

import numpy as np

from ledpi.kernels.library import INTEGER, POINTER, address, function
from ledpi.records import Mask, Singles

_all_uncovered = function("ledpi_all_uncovered", INTEGER, INTEGER, *(POINTER,) * 4, result=ctypes.c_bool)


def all_uncovered(light: Singles, valid: Mask | None, least: Singles) -> bool:
    """As `_all_uncovered` of decode/evidence/uncovered.py: `light`, `valid` and `least` (cells, points)."""
    room = np.empty(sum(light.shape), np.float32)
    mask = None if valid is None else address(valid)
    found: bool = _all_uncovered(*light.shape, address(light), mask, address(least), address(room))
    return found
