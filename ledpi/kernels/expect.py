"""Whether a frame shows what is expected of it (expect.c)."""

from __future__ import annotations

import math

import numpy as np

from ledpi.kernels.library import DOUBLE, INTEGER, POINTER, address, doubles, function
from ledpi.records import Floats, Mask, Singles

WAYS = 9  # in which gain and corners may be wrong

_expected = function(
    "ledpi_expected", *(INTEGER,) * 3, *(POINTER,) * 7, *(DOUBLE,) * 2, *(POINTER,) * 3, *(DOUBLE,) * 2, *(POINTER,) * 2
)
_expectation = function("ledpi_expectation", *(INTEGER,) * 3, *(POINTER,) * 9)


def expectation(
    *, picture: Singles, count: Singles, mean_waves: Singles, along: Singles, bands: Floats
) -> tuple[Singles, Singles, Singles]:
    """`root` (cells, points), `basis` (WAYS, cells·points) and `left_bands` (cells, points) of an `Expectation`.

    `picture`, `count` (cells, points), `mean_waves` (P, cells, points) as a `Mean` has them, `bands` (cells, P).
    """
    (cells, points), parameters = picture.shape, len(mean_waves)
    given = [np.ascontiguousarray(array) for array in (picture, count, mean_waves, along)]
    bands = doubles(bands)
    root, left_bands = np.empty(picture.shape, np.float32), np.empty(picture.shape, np.float32)
    basis, room = np.empty((WAYS, picture.size), np.float32), np.empty(3 * picture.size + 3 * along.size, np.float32)
    _expectation(
        *(math.isqrt(cells), math.isqrt(points), parameters, *(address(array) for array in given), address(bands)),
        *(address(root), address(basis), address(left_bands), address(room)),
    )
    return root, basis, left_bands


def weigh(
    *,
    picture: Singles,
    root: Singles,
    basis: Singles,
    left_bands: Singles,
    depth: Singles,
    hz: Floats,
    phase: Floats,
    since_s: float,
    row_time_s: float,
    light: Singles,
    valid: Mask | None,
    rows: Singles,
    independence: float,
    ridge: float,
) -> tuple[float, float]:
    """Log-likelihood ratio of a frame with the expected bands to one without: of all cells, and of those against them.

    The latter with the other sign. `picture`, `root`, `left_bands`, `light`, `valid`, `rows` (cells, points), `basis`
    (ways, cells·points), `depth` (cells, 1), `hz` and `phase` (cells,), as `Expectation` of decode/evidence/expect.py
    has them.
    """
    (cells, points), ways = picture.shape, len(basis)
    assert ways <= WAYS
    room, of = np.empty(4 * picture.size, np.float32), np.empty(2)
    _expected(
        *(cells, points, ways, address(picture), address(root), address(basis), address(left_bands)),
        *(address(depth), address(hz), address(phase), since_s, row_time_s),
        *(address(light), None if valid is None else address(valid), address(rows), independence, ridge),
        *(address(room), address(of)),
    )
    of_all, of_those_against = of.tolist()
    return of_all, of_those_against
