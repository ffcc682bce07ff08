"""The first pass over a panel's samples, all of its steps in one call (first_pass.c)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ledpi.core.records import Floats, Integers, Singles
from ledpi.kernels.codewords import Fit, output_size
from ledpi.kernels.library import ffi, lib, pointer

NEEDS_STEPS: int = lib.LEDPI_PASS_NEEDS_STEPS
UNFIT: int = lib.LEDPI_UNFIT
OF_FIT = 4  # numbers of the fit, beside score and information


class Grid:
    """What all panels of so many cells, with so many points in each, have in common."""

    def __init__(
        self,
        side: int,
        k: int,
        along: Singles,
        column: Integers,
        first: Integers,
        contributors: Integers,
        least: Singles,
    ) -> None:
        """`along` is the lattice's; `column`, `first` and `contributors` say what lights up each point.

        `least` (cells, points): the share of what others show that a sample has where nothing covers it.
        """
        self._kept = [pointer(np.ascontiguousarray(array)) for array in (along, column, first, contributors, least)]
        self.side, self.structure = side, ffi.new("Grid *", [side, k, len(column), *self._kept])


class FirstPass(NamedTuple):
    """What came of it: evidence, with noise as alike as it is counted once; and codewords."""

    score: Floats  # (cells, P)
    information: Floats  # (cells, P, cells, P)
    free: float  # samples, less what is fitted
    inflation: float  # by which the evidence was divided
    fit: Fit


def first_pass(
    grid: Grid,
    *,
    light: Singles,
    rows: Singles,
    independence: float,
    cycles_a_row: tuple[float, ...],
    prior: Floats,
    codewords: Singles,
    most: int,
    may_be_occluded: bool,
    unlit: float,
    lags: tuple[int, int, int],
    noise: tuple[float, float, float, float, float, float],
) -> FirstPass | int:
    """What the samples say, and the `most` likeliest `codewords`; or NEEDS_STEPS or UNFIT.

    `light`, `rows` (cells, points), of each wave its `cycles_a_row`, `prior` (P,), `codewords` (W, cells). It is not
    plain where a sample is covered, if it `may_be_occluded`, or where a cell's light is less than the share `unlit` of
    their mean; 0 where that is not asked. `lags` as of `evidence.single_evidence`, `noise` is what
    is `WhiteNoise` by decode/evidence/noise.py. Raises MemoryError.
    """
    cells, parameters = grid.side**2, len(prior)
    assert parameters in (2, 4)
    size, most = cells * parameters, min(most, len(codewords))
    chosen, erased = np.empty(most, np.int64), np.empty(cells, np.bool_)
    numbers = np.empty(size * (size + 1) + OF_FIT + output_size(cells, parameters, most))
    outcome: int = lib.ledpi_first_pass(
        *(grid.structure, pointer(light), pointer(rows), independence, len(cycles_a_row)),
        *(
            cycles_a_row[0],
            cycles_a_row[-1],
            pointer(prior),
            pointer(codewords),
            len(codewords),
            most,
            may_be_occluded,
            unlit,
        ),
        *(*lags, ffi.new("WhiteNoise *", noise), pointer(chosen), pointer(erased), pointer(numbers)),
    )
    if outcome == lib.LEDPI_PASS_NO_MEMORY:
        raise MemoryError
    if outcome != lib.LEDPI_PASS_DONE:
        return outcome
    of_fit = size * (size + 1)
    free, _, _, inflation = numbers[of_fit : of_fit + OF_FIT].tolist()
    return FirstPass(
        score=numbers[:size].reshape(cells, parameters),
        information=numbers[size:of_fit].reshape(cells, parameters, cells, parameters),
        free=free,
        inflation=inflation,
        fit=Fit.from_output(chosen, erased, numbers[of_fit + OF_FIT :], parameters),
    )
