"""How well words explain the evidence of a panel's cells (words.c, neighbours.c)."""

from __future__ import annotations

import ctypes
from itertools import accumulate, pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ledpi.kernels.library import INTEGER, POINTER, address, function

Singles = NDArray[np.float32]
Doubles = NDArray[np.float64]
Mask = NDArray[np.bool_]

_likeliest = function(
    "ledpi_likeliest", INTEGER, INTEGER, *(POINTER,) * 4, INTEGER, INTEGER, *(POINTER,) * 8, result=INTEGER
)
_of_neighbours = function(
    "ledpi_of_neighbours", INTEGER, INTEGER, *(POINTER,) * 5, INTEGER, INTEGER, POINTER, result=ctypes.c_bool
)


class Likeliest(NamedTuple):
    """As `Fit` of decode/words.py has them."""

    words: list[int]
    likelihood: list[float]
    bands: Doubles
    deviation: Doubles
    shown: Doubles
    gain: Doubles
    negative: float
    of_cells: float


def likeliest(score: Doubles, information: Doubles, prior: Doubles, words: Singles, most: int) -> Likeliest:
    """The `most` likeliest of `words` (W, cells) under the evidence, and what speaks against the best.

    `score` (cells, P), `information` (cells, P, cells, P), `prior` (P,). Raises MemoryError.
    """
    cells, parameters = score.shape
    assert parameters in (2, 4)
    chosen, numbers = np.empty(most, np.int64), np.empty(most + 2 * parameters + score.size + cells + 2)
    ends = list(accumulate((0, most, parameters, parameters, score.size, cells, 1)))
    at = address(numbers)
    count = _likeliest(
        *(cells, parameters, address(score), address(information), address(prior), address(words), len(words), most),
        *(address(chosen), *(at + numbers.itemsize * end for end in ends)),
    )
    if not count:
        raise MemoryError
    likelihood, bands, deviation, shown, gain = (numbers[a:b] for a, b in pairwise(ends[:6]))
    negative, of_cells = numbers[ends[5] :].tolist()
    return Likeliest(
        words=chosen[:count].tolist(),
        likelihood=likelihood[:count].tolist(),
        bands=bands,
        deviation=deviation,
        shown=shown.reshape(cells, parameters),
        gain=gain,
        negative=negative,
        of_cells=of_cells,
    )


def of_neighbours(
    score: Doubles, information: Doubles, prior: Doubles, word: Singles, silent: Mask, nearest: int, furthest: int
) -> float:
    """`of_neighbours` of decode/words.py; `word` and `silent` (cells,). Raises MemoryError."""
    cells, parameters = score.shape
    assert parameters in (2, 4)
    assert cells <= 64
    word, silent, log_sum = np.ascontiguousarray(word), np.ascontiguousarray(silent), np.empty(1)
    if not _of_neighbours(
        *(cells, parameters, address(score), address(information), address(prior)),
        *(address(word), address(silent), nearest, furthest, address(log_sum)),
    ):
        raise MemoryError
    return float(log_sum[0])
