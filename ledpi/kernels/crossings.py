"""Places that are darker than what is around them, and those with others in a square around (crossings.c); and the
grids whose cells may meet there (grids.c).
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ledpi.kernels.library import INTEGER, POINTER, address, function
from ledpi.records import Floats, Pixels

MOST_PLACES = 800  # as in crossings.c
MOST_SIDE, MOST_GRIDS = 8, 24  # cells along a side, and grids in a picture, as in grids.c

_crosses = function("ledpi_crosses", POINTER, INTEGER, INTEGER, *(POINTER,) * 6, result=INTEGER)
_grids = function("ledpi_grids", POINTER, INTEGER, POINTER, POINTER, INTEGER, INTEGER, POINTER, result=INTEGER)


def crosses(picture: Pixels) -> tuple[Floats, NDArray[np.intp], Floats]:
    """As `crosses_in` of decode/finding/crossings.py."""
    picture = np.ascontiguousarray(picture)
    height, width = picture.shape
    sums, row = np.empty(picture.size, np.uint16), np.empty(width, np.uint8)
    places, count = np.empty((MOST_PLACES, 3)), np.zeros(1, np.intp)
    middles, steps = np.empty(MOST_PLACES, np.intp), np.empty((MOST_PLACES, 2, 2))
    found = _crosses(
        *(address(picture), height, width, address(sums), address(row), address(places), address(count)),
        *(address(middles), address(steps)),
    )
    return np.ascontiguousarray(places[: int(count[0]), :2]), middles[:found], steps[:found]


def grids(points: Floats, middles: NDArray[np.intp], steps: Floats, cells: int) -> Floats:
    """(K, 4, 2) as `lattice_grids` of decode/finding/crossings.py, of at most MOST_SIDE cells a side."""
    corners = np.empty((MOST_GRIDS, 4, 2))
    found = _grids(
        *(address(points), len(points), address(middles), address(steps), len(middles)), cells, address(corners)
    )
    return corners[:found]
