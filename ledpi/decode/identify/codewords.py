"""Codewords, and patterns that are none, as explanations of the evidence of all of a panel's cells together.

With score b and information A of the bands that all cells of a codeword share (P numbers), and their prior variance Λ,
the log-likelihood ratio of the codeword to "no bands", depth and phase integrated out, is

    ½ bᵀ(A + Λ⁻¹)⁻¹b − ½ ln det(I + ΛA)

and (A + Λ⁻¹)⁻¹b are the bands that fit it best (codewords.c; neighbours.c and hill_climb.c for other patterns).
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from ledpi.core.library import doubles, lib, pointer
from ledpi.core.records import Floats, Integers, Mask, Singles
from ledpi.decode.evidence.classes import flip_classes
from ledpi.decode.evidence.evidence import Evidence

MOST_CELLS: int = lib.LEDPI_MOST_CELLS
SHORTLIST = 16  # codewords that are compared exactly


class Fit(NamedTuple):
    """The likeliest codewords under some evidence, best first, and what speaks against the best of them."""

    codewords: list[int]  # indices of the codebook
    likelihood: list[float]  # log-likelihood ratio of each to "no bands"
    bands: Floats  # (P,) of the best codeword
    deviation: list[float]  # (P,)
    cell_bands: Floats  # (cells, P) the bands that each cell of it shows
    gain: list[float]  # (cells,) of each cell in the other class to the one that the codeword says
    weakest_row: float  # of the codeword's bands to none, in the row or column of cells where that is the least
    negative: float  # of the codeword with all classes swapped to "no bands", its bands fitted anew
    of_cells: float  # of bands of its own in every cell to "no bands"
    beyond: list[float]  # of all patterns that differ from it in more cells than 0, 1, to itself
    erased: Mask | None  # (cells,) of which the evidence holds nothing; None where it does of all

    @property
    def is_finite(self) -> bool:
        """Tells whether all of it are numbers; evidence that rounding has left indefinite may have no likelihood."""
        of_best = self.negative + self.of_cells + sum(self.gain) + sum(self.deviation)
        return math.isfinite(of_best + sum(self.likelihood))

    @classmethod
    def from_output(cls, chosen: Integers, erased: Mask, numbers: Floats, parameters: int) -> Fit:
        """From what the C function has put into `chosen`, `erased` (cells,) and `numbers`."""
        arrays, most = parameters * (1 + len(erased)), len(chosen)
        rest = numbers[arrays:].tolist()
        gain, after = most + parameters, most + parameters + len(erased)
        return cls(
            codewords=chosen.tolist(),
            likelihood=rest[:most],
            bands=numbers[:parameters],
            deviation=rest[most:gain],
            cell_bands=numbers[parameters:arrays].reshape(-1, parameters),
            gain=rest[gain:after],
            weakest_row=rest[after],
            negative=rest[after + 1],
            of_cells=rest[after + 2],
            beyond=rest[after + 3 : after + 5],
            erased=erased if rest[after + 5] else None,
        )


def rank_codewords(evidence: Evidence, white: Singles) -> Fit:
    """The SHORTLIST likeliest of the codewords (W, cells), 1 where the class is white. Raises MemoryError."""
    cells, parameters = evidence.score.shape
    most = min(SHORTLIST, len(white))
    chosen, erased = np.empty(most, np.int64), np.empty(cells, np.bool_)
    numbers = np.empty(most + 2 * parameters + cells * parameters + cells + 6)
    if not lib.ledpi_rank_codewords(
        *(*_known(evidence), pointer(white), len(white), most, pointer(chosen), pointer(erased), pointer(numbers))
    ):
        raise MemoryError
    return Fit.from_output(chosen, erased, numbers, parameters)


def class_flip_gain(evidence: Evidence, cell_bands: Floats) -> Floats:
    """(cells,) log-likelihood ratio of each cell in the other class to its class in `cell_bands` (cells, P)."""
    cells, parameters = cell_bands.shape
    gain, room = np.empty((2, cells))
    arrays = (evidence.score, evidence.information, cell_bands, flip_classes(cell_bands))
    given = (pointer(doubles(array)) for array in arrays)
    lib.ledpi_class_flip_gains(cells, parameters, *given, pointer(gain), pointer(room))
    return gain


def near_pattern_likelihood(evidence: Evidence, codeword: Singles, nearest: int, furthest: int) -> float:
    """Log of the summed likelihoods of patterns that differ from a codeword (cells,) in `nearest` to `furthest` cells.

    Each has the bands that fit it best. Of all these patterns those are tried that are near the likeliest, found from
    the codeword outward; cells that are erased are left as they are.
    """
    given = pointer(np.ascontiguousarray(codeword))
    log_sum: float = lib.ledpi_near_pattern_likelihood(*_known(evidence), given, nearest, furthest)
    return log_sum


def likeliest_far_pattern(evidence: Evidence, codeword: Singles, correctable: int) -> tuple[float, Singles]:
    """The likeliest pattern that is too far from a codeword (cells,) to be it: how likely, over "no bands", and which.

    It differs in more cells than are `correctable`, and has the bands that fit it best. Cells that are erased are left
    as they are.
    """
    pattern = np.empty(len(evidence.score), np.float32)
    given = pointer(np.ascontiguousarray(codeword))
    return lib.ledpi_likeliest_far_pattern(*_known(evidence), given, correctable, pointer(pattern)), pattern


def likeliest_part(evidence: Evidence, white: Singles, best: int, enough: float) -> float:
    """Log-likelihood ratio to "no bands" of the likeliest part of a panel, less the log of how many its size has.

    A part fills the square with fewer rows or columns of cells, each larger than a fitted one, and shows what codewords
    (W, cells) have there; but not what shows the `best` codeword itself. −∞ where none is above `enough`, NaN where one
    cannot be weighed.
    """
    log_likelihood: float = lib.ledpi_likeliest_part(*_known(evidence), pointer(white), len(white), best, enough)
    return log_likelihood


def _known(evidence: Evidence) -> tuple[Any, ...]:
    """The evidence as C takes it: cells, parameters, score, information, prior."""
    cells, parameters = evidence.score.shape
    assert parameters in (2, 4)
    assert cells <= MOST_CELLS
    return cells, parameters, pointer(evidence.score), pointer(evidence.information), pointer(evidence.prior)
