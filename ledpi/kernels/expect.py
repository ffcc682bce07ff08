"""Whether a frame shows what is expected of it (expect.c)."""

from __future__ import annotations

import math

import numpy as np

from ledpi.kernels.library import at, doubles, lib
from ledpi.records import Floats, Mask, Singles

WAYS: int = lib.LEDPI_WAYS  # in which gain and corners may be wrong


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
    lib.ledpi_expectation(
        *(math.isqrt(cells), math.isqrt(points), parameters, *(at(array) for array in given), at(bands)),
        *(at(root), at(basis), at(left_bands), at(room)),
    )
    return root, basis, left_bands


def ways(picture: Singles, along: Singles) -> Floats:
    """(WAYS, cells·points) orthonormal: what a wrong gain and wrong corners add, weighted by the root of the light.

    To a `picture` (cells, points) above 0.
    """
    of_waves, bands = np.empty((0, *picture.shape), np.float32), np.empty((len(picture), 0))
    given = {"picture": picture, "count": np.ones_like(picture), "mean_waves": of_waves, "along": along}
    return doubles(expectation(**given, bands=bands)[1])


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
    lib.ledpi_expected(
        *(cells, points, ways, at(picture), at(root), at(basis), at(left_bands)),
        *(at(depth), at(hz), at(phase), since_s, row_time_s),
        *(at(light), at(valid), at(rows), independence, ridge),
        *(at(room), at(of)),
    )
    of_all, of_those_against = of.tolist()
    return of_all, of_those_against
