"""The error of the model of a panel's light, as large as each cell shows it.

A cell has its codeword's bands and an error of its own: walls, blur, tone, harmonics, a wrong corner, something before
it. What it shows beside the codeword, as χ² more than noise leaves, is that error. With its variance V, a share of the
mean square of the bands in each cell, evidence of score b and information A becomes

    (I + A·V)⁻¹b    and    (I + A·V)⁻¹A

so that a cell counts for no more than the model is worth in it, however much light it gives.
"""

from __future__ import annotations

import math

import numpy as np

from ledpi.core.records import Floats, Singles
from ledpi.decode.evidence.evidence import RARE_Z, Evidence
from ledpi.decode.identify.codewords import Fit, rank_codewords

# Of what a codeword explains: the bands of one panel's cells differ by a quarter, a deviation.
MODEL_VARIANCE = 1.0 / 16.0
LEAST_INFORMATION, LEAST_SQUARE = 1e-9, 1e-12  # of a band: less is none, and nothing is divided by it


def as_noise(evidence: Evidence, fit: Fit) -> Evidence:
    """The evidence where all that a codeword leaves beyond noise is noise; `fit` is of both, the codeword its best."""
    inflation = _misfit(evidence, fit) / _allowed_misfit(evidence, fit)
    return evidence.divided(inflation) if inflation > 1.0 else evidence


def with_model_error(evidence: Evidence, fit: Fit, codeword: Singles) -> Evidence:
    """The evidence with the errors of cells that show a codeword (cells,); `fit` is of both, the codeword its best.

    A misfit that remains in all cells together is of no one cell, and counts as noise.
    """
    share = _share_of_error(evidence, fit)
    if not share.any():
        return as_noise(evidence, fit)
    known = _with_variance(evidence, (share[:, None] * _mean_square(fit)).reshape(-1))
    return as_noise(known, rank_codewords(known, codeword[None]))


def _share_of_error(evidence: Evidence, fit: Fit) -> Floats:
    """(cells,) variance of each cell's error over the mean square of the codeword's bands.

    With it a cell's misfit is χ² with P degrees of freedom on average; at what noise may leave it begins at 0.
    """
    left, each = evidence.unexplained(fit.cell_bands), len(evidence.prior)
    beside = np.linalg.solve(evidence.own_information + LEAST_INFORMATION * np.eye(each), left[..., None])[..., 0]
    misfit = (beside * left).sum(axis=1)
    beyond = np.maximum(misfit - _most_of_noise(each), 0.0) / each
    share: Floats = (beside**2 / _mean_square(fit)).sum(axis=1) * beyond / np.maximum(misfit, each)
    return share


def _most_of_noise(freedom: int) -> float:
    """Returns what χ² exceeds once in a thousand, after Wilson and Hilferty: its cube root is nearly normal."""
    variance = 2.0 / (9.0 * freedom)
    return freedom * float((1.0 - variance + RARE_Z * math.sqrt(variance)) ** 3)


def _mean_square(fit: Fit) -> Floats:
    """(P,) of the bands: half the square of each wave's depth."""
    square: Floats = np.square(fit.bands.reshape(-1, 2)).sum(axis=1) / 2.0
    return np.maximum(square, LEAST_SQUARE).repeat(2)


def _with_variance(evidence: Evidence, variance: Floats) -> Evidence:
    """The evidence where each band has an error of this variance (cells · P,) besides."""
    size = evidence.score.size
    information, score = evidence.information.reshape(size, size), evidence.score.reshape(size)
    known = np.linalg.solve(np.eye(size) + information * variance, np.column_stack([information, score]))
    return evidence._replace(
        score=np.ascontiguousarray(known[:, -1]).reshape(evidence.score.shape),
        information=np.ascontiguousarray(known[:, :-1]).reshape(evidence.information.shape),
    )


def _misfit(evidence: Evidence, fit: Fit) -> float:
    """By how much bands of its own in every cell are likelier than the best codeword's best ones, in nats.

    A codeword's bands are open beforehand by ½ ln det(I + ΛA), which is no misfit: some 10 nats, here from the
    deviation of each cosine and sine by itself, which makes it less, if anything.
    """
    both = zip(evidence.prior.tolist(), fit.deviation, strict=True)
    return fit.of_cells - fit.likelihood[0] - sum(math.log(math.sqrt(variance) / each) for variance, each in both)


def _allowed_misfit(evidence: Evidence, fit: Fit) -> float:
    """Returns what noise leaves at most, half of a χ² and RARE_Z deviations, and some of what the codeword explains.

    Of that no more than a nat a cell: there a cell's noise is as large as the model's error may be.
    """
    cells = len(fit.gain) - (0 if fit.erased is None else int(np.count_nonzero(fit.erased)))
    mean = 0.5 * (cells - 1) * len(evidence.prior)
    return mean + RARE_Z * math.sqrt(mean) + min(MODEL_VARIANCE * fit.likelihood[0], cells)
