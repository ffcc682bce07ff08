"""The middles of light around places in a frame (spot_centres.c)."""

from __future__ import annotations

import numpy as np

from ledpi.kernels.library import DOUBLE, INTEGER, POINTER, address, doubles, function
from ledpi.kernels.light import PICTURE, picture
from ledpi.records import Floats, Frame

_centres = function("ledpi_centres", *PICTURE, POINTER, INTEGER, DOUBLE, POINTER)


def centres(frame: Frame, at: Floats, reach_px: float) -> Floats:
    """As `_centres` of decode/corners/spot_centres.py."""
    at, found = doubles(at), np.empty((len(at), 3))
    _centres(*picture(frame), address(at), len(at), reach_px, address(found))
    return found
