"""How well words explain the evidence of a panel's cells (words.c)."""

from __future__ import annotations

import ctypes

import numpy as np
from numpy.typing import NDArray

from ledpi.kernels.library import INTEGER, POINTER, address, function

Singles = NDArray[np.float32]
Doubles = NDArray[np.float64]

_EVIDENCE = (INTEGER, INTEGER, POINTER, POINTER, POINTER)
_likeliest = function("ledpi_likeliest", *_EVIDENCE, POINTER, INTEGER, INTEGER, *(POINTER,) * 4, result=INTEGER)
_against = function("ledpi_against", *_EVIDENCE, *(POINTER,) * 5, result=ctypes.c_bool)


def likeliest(
    score: Doubles, information: Doubles, prior: Doubles, words: Singles, most: int
) -> tuple[NDArray[np.int64], Doubles, Doubles, Doubles]:
    """The `most` likeliest of `words` (W, cells), best first, and how likely; the best one's bands, their deviations.

    Raises MemoryError.
    """
    parameters = len(prior)
    chosen, likelihood = np.empty(most, np.int64), np.empty(most)
    bands, deviation = np.empty(parameters), np.empty(parameters)
    count = _likeliest(
        *_evidence(score, information, prior),
        *(address(words), len(words), most, address(chosen), address(likelihood), address(bands), address(deviation)),
    )
    if not count:
        raise MemoryError
    return chosen[:count], likelihood[:count], bands, deviation


def against(
    score: Doubles, information: Doubles, prior: Doubles, white: Singles, bands: Doubles
) -> tuple[Doubles, float, float]:
    """What speaks against a word: each cell's gain by the other class, its negative, what no word has to explain.

    `white` (cells,), `bands` (P,). Raises MemoryError.
    """
    gain, numbers = np.empty(len(score)), np.empty(2)
    at = address(numbers)
    arguments = address(white), address(bands), address(gain), at, at + numbers.itemsize
    if not _against(*_evidence(score, information, prior), *arguments):
        raise MemoryError
    return gain, float(numbers[0]), float(numbers[1])


def _evidence(score: Doubles, information: Doubles, prior: Doubles) -> tuple[int, int, int, int, int]:
    cells, parameters = score.shape
    assert parameters in (2, 4)
    return cells, parameters, address(score), address(information), address(prior)
