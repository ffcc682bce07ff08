"""A first look at a panel's samples, all of its steps in one call (first_look.c)."""

from __future__ import annotations

import ctypes
from typing import NamedTuple

import numpy as np

from ledpi.kernels.library import DOUBLE, INTEGER, POINTER, address, function
from ledpi.kernels.words import Fit, numbers_of
from ledpi.records import Floats, Integers, Singles

LOOKED, NOT_PLAIN, UNFIT, NO_MEMORY = range(4)  # as in first_look.c
OF_FIT = 4  # numbers of the fit, beside score and information

_look = function(
    "ledpi_look", *(POINTER,) * 3, DOUBLE, INTEGER, *(DOUBLE,) * 2, *(POINTER,) * 2, *(INTEGER,) * 2, ctypes.c_bool,
    DOUBLE, *(INTEGER,) * 3, *(DOUBLE,) * 6, *(POINTER,) * 3, result=ctypes.c_int,
)  # fmt: skip


class _Grid(ctypes.Structure):
    """`Grid` of first_look.c."""

    _fields_ = [
        *((name, ctypes.c_ssize_t) for name in ("side", "k", "source_count")),
        *((name, ctypes.c_void_p) for name in ("along", "column", "first", "met", "least")),
    ]


class Grid:
    """What all panels of so many cells, with so many points in each, have in common."""

    def __init__(
        self, side: int, k: int, along: Singles, column: Integers, first: Integers, met: Integers, least: Singles
    ) -> None:
        """`along` is the lattice's; `column`, `first` and `met` say what lights up each point.

        `least` (cells, points): the share of what others show that a sample has where nothing covers it.
        """
        self._kept = [np.ascontiguousarray(array) for array in (along, column, first, met, least)]
        self._structure = _Grid(side, k, len(column), *(address(array) for array in self._kept))
        self.side, self.at = side, ctypes.addressof(self._structure)


class Look(NamedTuple):
    """What came of it: evidence, with noise as alike as it is counted once; and words."""

    score: Floats  # (cells, P)
    information: Floats  # (cells, P, cells, P)
    free: float  # samples, less what is fitted
    volume: float  # by which the evidence was divided
    fit: Fit


def look(
    grid: Grid,
    *,
    light: Singles,
    rows: Singles,
    independence: float,
    cycles_a_row: tuple[float, ...],
    prior: Floats,
    words: Singles,
    most: int,
    may_be_covered: bool,
    unlit: float,
    lags: tuple[int, int, int],
    noise: tuple[float, float, float, float, float, float],
) -> Look | int:
    """What the samples say, and the `most` likeliest `words`; or NOT_PLAIN or UNFIT.

    `light`, `rows` (cells, points), of each wave its `cycles_a_row`, `prior` (P,), `words` (W, cells). It is not
    plain where a sample is covered, if it `may_be_covered`, or where a cell's light is less than the share `unlit` of
    their mean; 0 where that is not asked. `lags` as of `evidence.single_evidence`, `noise` is what
    is `Expected` by decode/evidence/noise.py. Raises MemoryError.
    """
    cells, parameters = grid.side**2, len(prior)
    assert parameters in (2, 4)
    size, most = cells * parameters, min(most, len(words))
    chosen, silent = np.empty(most, np.int64), np.empty(cells, np.bool_)
    numbers = np.empty(size * (size + 1) + OF_FIT + numbers_of(cells, parameters, most))
    outcome: int = _look(
        *(grid.at, address(light), address(rows), independence, len(cycles_a_row)),
        *(cycles_a_row[0], cycles_a_row[-1], address(prior), address(words), len(words), most, may_be_covered, unlit),
        *(*lags, *noise, address(chosen), address(silent), address(numbers)),
    )
    if outcome == NO_MEMORY:
        raise MemoryError
    if outcome != LOOKED:
        return outcome
    of_fit = size * (size + 1)
    free, _, _, volume = numbers[of_fit : of_fit + OF_FIT].tolist()
    return Look(
        score=numbers[:size].reshape(cells, parameters),
        information=numbers[size:of_fit].reshape(cells, parameters, cells, parameters),
        free=free,
        volume=volume,
        fit=Fit.of(chosen, silent, numbers[of_fit + OF_FIT :], parameters),
    )
