"""Whether a frame shows what is expected of it (expect.c)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ledpi.kernels.library import DOUBLE, INTEGER, POINTER, address, function

Singles = NDArray[np.float32]
Doubles = NDArray[np.float64]
Mask = NDArray[np.bool_]

MOST_WAYS = 16  # as in expect.c

_expected = function(
    "ledpi_expected", *(INTEGER,) * 3, *(POINTER,) * 7, *(DOUBLE,) * 2, *(POINTER,) * 3, *(DOUBLE,) * 2, *(POINTER,) * 2
)


def weigh(
    *,
    picture: Singles,
    root: Singles,
    basis: Singles,
    left_bands: Singles,
    depth: Singles,
    hz: Doubles,
    phase: Doubles,
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
    (ways, cells·points), `depth` (cells, 1), `hz` and `phase` (cells,), as `Expectation` of decode/expect.py has them.
    """
    (cells, points), ways = picture.shape, len(basis)
    assert ways <= MOST_WAYS
    room, of = np.empty(3 * picture.size, np.float32), np.empty(2)
    _expected(
        *(cells, points, ways, address(picture), address(root), address(basis), address(left_bands)),
        *(address(depth), address(hz), address(phase), since_s, row_time_s),
        *(address(light), None if valid is None else address(valid), address(rows), independence, ridge),
        *(address(room), address(of)),
    )
    of_all, of_those_against = of.tolist()
    return of_all, of_those_against
