"""How well words, and other patterns, explain the evidence of a panel's cells (words.c, neighbours.c, climb.c)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ledpi.kernels.library import DOUBLE, INTEGER, POINTER, address, function

Singles = NDArray[np.float32]
Doubles = NDArray[np.float64]
Integers = NDArray[np.int64]
Mask = NDArray[np.bool_]

MOST_CELLS = 64  # as in patterns.h

_likeliest = function(
    "ledpi_likeliest", INTEGER, INTEGER, *(POINTER,) * 4, INTEGER, INTEGER, *(POINTER,) * 3, result=INTEGER
)
_of_neighbours = function(
    "ledpi_of_neighbours", INTEGER, INTEGER, *(POINTER,) * 4, INTEGER, INTEGER, result=DOUBLE
)
_likeliest_beyond = function("ledpi_likeliest_beyond", INTEGER, INTEGER, *(POINTER,) * 4, INTEGER, result=DOUBLE)


class Likeliest(NamedTuple):
    """As `Fit` of decode/identify/words.py has them."""

    words: list[int]
    likelihood: list[float]
    bands: Doubles
    deviation: list[float]
    shown: Doubles
    gain: list[float]
    weakest_row: float
    negative: float
    of_cells: float
    one_class: float
    beyond: list[float]
    silent: Mask | None

    @classmethod
    def of(cls, chosen: Integers, silent: Mask, numbers: Doubles, parameters: int) -> Likeliest:
        """From what the C function has put into `chosen`, `silent` (cells,) and `numbers` (`numbers_of`)."""
        most, size = len(chosen), len(silent) * parameters
        bands, shown = most, most + 2 * parameters
        gain = shown + size
        after = gain + len(silent)
        as_list = numbers.tolist()
        return cls(
            words=chosen.tolist(),
            likelihood=as_list[:most],
            bands=numbers[bands : bands + parameters],
            deviation=as_list[bands + parameters : shown],
            shown=numbers[shown:gain].reshape(-1, parameters),
            gain=as_list[gain:after],
            weakest_row=as_list[after],
            negative=as_list[after + 1],
            of_cells=as_list[after + 2],
            one_class=as_list[after + 3],
            beyond=as_list[after + 4 : after + 6],
            silent=silent if as_list[after + 6] else None,
        )


def numbers_of(cells: int, parameters: int, most: int) -> int:
    """How many `ledpi_likeliest` puts beside the words."""
    return most + 2 * parameters + cells * parameters + cells + 7


def likeliest(score: Doubles, information: Doubles, prior: Doubles, words: Singles, most: int) -> Likeliest:
    """The `most` likeliest of `words` (W, cells) under the evidence, and what speaks against the best.

    `score` (cells, P), `information` (cells, P, cells, P), `prior` (P,). Raises MemoryError.
    """
    cells, parameters = score.shape
    assert parameters in (2, 4)
    most = min(most, len(words))
    chosen, silent = np.empty(most, np.int64), np.empty(cells, np.bool_)
    numbers = np.empty(numbers_of(cells, parameters, most))
    if not _likeliest(
        *(cells, parameters, address(score), address(information), address(prior), address(words), len(words), most),
        *(address(chosen), address(silent), address(numbers)),
    ):
        raise MemoryError
    return Likeliest.of(chosen, silent, numbers, parameters)


def of_neighbours(
    score: Doubles, information: Doubles, prior: Doubles, word: Singles, nearest: int, furthest: int
) -> float:
    """`of_neighbours` of decode/identify/patterns.py; `word` (cells,)."""
    cells, parameters = score.shape
    assert parameters in (2, 4)
    assert cells <= MOST_CELLS
    word = np.ascontiguousarray(word)
    at = address(score), address(information), address(prior), address(word)
    log_sum: float = _of_neighbours(cells, parameters, *at, nearest, furthest)
    return log_sum


def likeliest_beyond(score: Doubles, information: Doubles, prior: Doubles, word: Singles, correctable: int) -> float:
    """`likeliest_beyond` of decode/identify/patterns.py; `word` (cells,)."""
    cells, parameters = score.shape
    assert parameters in (2, 4)
    assert cells <= MOST_CELLS
    word = np.ascontiguousarray(word)
    at = address(score), address(information), address(prior), address(word)
    likelihood: float = _likeliest_beyond(cells, parameters, *at, correctable)
    return likelihood
