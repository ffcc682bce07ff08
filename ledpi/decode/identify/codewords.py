"""Codewords, and patterns that are none, as explanations of the evidence of all of a panel's cells together.

With score b and information A of the bands that all cells of a codeword share (P numbers), and their prior variance Λ,
the log-likelihood ratio of the codeword to "no bands", depth and phase integrated out, is

    ½ bᵀ(A + Λ⁻¹)⁻¹b − ½ ln det(I + ΛA)

and (A + Λ⁻¹)⁻¹b are the bands that fit it best (kernels/codewords.c; neighbours.c and hill_climb.c for other patterns).
"""

from __future__ import annotations

from ledpi.core.records import Floats, Singles
from ledpi.decode.evidence.classes import flip_classes
from ledpi.decode.evidence.evidence import Evidence
from ledpi.kernels import codewords as kernel
from ledpi.kernels.codewords import Fit

SHORTLIST = 16  # codewords that are compared exactly


def rank_codewords(evidence: Evidence, white: Singles) -> Fit:
    """The SHORTLIST likeliest of the codewords (W, cells), 1 where the class is white."""
    return kernel.rank_codewords(evidence.score, evidence.information, evidence.prior, white, SHORTLIST)


def class_flip_gain(evidence: Evidence, cell_bands: Floats) -> Floats:
    """(cells,) log-likelihood ratio of each cell in the other class to its class in `cell_bands` (cells, P)."""
    return kernel.class_flip_gains(evidence.score, evidence.information, cell_bands, flip_classes(cell_bands))


def near_pattern_likelihood(evidence: Evidence, codeword: Singles, nearest: int, furthest: int) -> float:
    """Log of the summed likelihoods of patterns `nearest` to `furthest` cells off a codeword (cells,)."""
    return kernel.near_pattern_likelihood(
        evidence.score, evidence.information, evidence.prior, codeword, nearest, furthest
    )


def likeliest_far_pattern(evidence: Evidence, codeword: Singles, correctable: int) -> tuple[float, Singles]:
    """The likeliest pattern that is more than `correctable` cells off a codeword (cells,): how likely, and which."""
    return kernel.likeliest_far_pattern(evidence.score, evidence.information, evidence.prior, codeword, correctable)
