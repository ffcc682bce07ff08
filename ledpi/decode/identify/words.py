"""How well words explain the evidence of all of a panel's cells together.

In C (kernels/words.c) and, where there is no compiler, in numpy, which is the reference.
"""

from __future__ import annotations

import math

import numpy as np

from ledpi.decode.evidence.classes import band_shares, in_other_class, wave_shares
from ledpi.decode.evidence.evidence import Evidence
from ledpi.kernels import words as kernel
from ledpi.kernels.library import compiled
from ledpi.kernels.words import Fit
from ledpi.records import Floats, Integers, Singles

MOST_CORRECTED = 1  # cells that may be of the other class while a pattern still is a word: `Codebook.correctable`
MOST_GAIN, SMALLEST_LOG = 40.0, -600.0  # what e can be taken to the power of, and summed up; more is as sure as this
SHORTLIST = 16  # words that are compared exactly


def likeliest(evidence: Evidence, white: Singles) -> Fit:
    """The SHORTLIST likeliest of the words (W, cells), 1 where the class is white."""
    if compiled():
        return kernel.likeliest(evidence.score, evidence.information, evidence.prior, white, SHORTLIST)
    words = shortlist(evidence, white)
    likelihood, bands, covariances = word_log_likelihoods(evidence, white[words])
    order = np.argsort(-likelihood)
    first = order[0]
    best = white[words[first]]
    shown = band_shares(best.astype(np.float64), len(evidence.prior)) * bands[first]
    gain, silent = gain_by_other_class(evidence, shown), evidence.silent
    return Fit(
        words=words[order].tolist(),
        likelihood=likelihood[order].tolist(),
        bands=bands[first],
        deviation=np.sqrt(np.diagonal(covariances[first])).tolist(),
        shown=shown,
        gain=gain.tolist(),
        weakest_row=weakest_row(evidence, shown),
        negative=float(word_log_likelihoods(evidence, 1.0 - best[None])[0][0]),
        of_cells=_explained_by_cells(evidence),
        one_class=float(word_log_likelihoods(evidence, np.stack([0 * best, 0 * best + 1]))[0].max()),
        beyond=_of_patterns_beyond(gain[~silent].tolist()),
        silent=silent if silent.any() else None,
    )


def gain_by_other_class(evidence: Evidence, shown: Floats) -> Floats:
    """(cells,) log-likelihood ratio of each cell in the other class to the one whose bands are `shown` (cells, P)."""
    change = in_other_class(shown) - shown
    by_half = 0.5 * np.matmul(evidence.of_own_bands, change[..., None])[..., 0]
    gain: Floats = (change * (evidence.unexplained(shown) - by_half)).sum(axis=1)
    return gain


def weakest_row(evidence: Evidence, shown: Floats) -> float:
    """Least log odds of a row or column of cells with the bands `shown` (cells, P) to one with none."""
    side = math.isqrt(len(shown))
    by_half = 0.5 * np.matmul(evidence.of_own_bands, shown[..., None])[..., 0]
    with_bands = (shown * (evidence.unexplained(shown) + by_half)).sum(axis=1).reshape(side, side)
    return float(min(with_bands.sum(axis=0).min(), with_bands.sum(axis=1).min()))


def _of_patterns_beyond(gain: list[float]) -> list[float]:
    """`beyond` of a `Fit`, from the `gain` of the cells that are not silent.

    Given the bands, cells are independent, so the patterns that differ in d cells sum up to the d-th elementary
    symmetric polynomial of the cells' likelihood ratios.
    """
    beyond = []
    for corrected in range(MOST_CORRECTED + 1):
        by_distance = [1.0] + [0.0] * corrected  # few cells differ: 0, 1, …
        further = 0.0  # more
        for of_cell in gain:
            ratio = math.exp(min(of_cell, MOST_GAIN))
            further += (further + by_distance[-1]) * ratio
            for d in range(corrected, 0, -1):
                by_distance[d] += by_distance[d - 1] * ratio
        others = math.log(max(further, 1e-300))
        if others < SMALLEST_LOG:  # the nearest of them outshines the rest, and may be too small for a number
            others = sum(sorted(gain)[-corrected - 1 :])
        beyond.append(others)
    return beyond


def _explained_by_cells(evidence: Evidence) -> float:
    """Log-likelihood ratio of bands of its own in every cell to "no bands"."""
    score = evidence.score.reshape(-1)
    matrix = evidence.information.reshape(score.size, score.size)
    ridged = matrix + (1e-6 * float(np.trace(matrix)) / score.size + 1e-12) * np.eye(score.size)
    return 0.5 * float(score @ np.linalg.solve(ridged, score))


def shortlist(evidence: Evidence, white: Singles) -> Integers:
    """The SHORTLIST likeliest words of (W, cells), told by a likelihood that leaves out what ties cells together.

    Exact within each cell. What cells share (profile, corners) takes about the same from every word, so the likeliest
    word and its rivals are among these; and the sums are plain matrix products, for any size of dictionary.
    """
    if len(white) <= SHORTLIST:
        return np.arange(len(white))
    parameters = len(evidence.prior)
    shares = wave_shares(white, parameters // 2).transpose(2, 0, 1)  # (waves, W, cells)
    own = evidence.of_own_bands.reshape(len(evidence.score), -1)
    likelihood = np.zeros(len(white))
    for k, share in enumerate(shares):
        cosine, sine = 2 * k, 2 * k + 1
        squares = own[:, (cosine * (parameters + 1), cosine * parameters + sine, sine * (parameters + 1))]
        x, y = (share @ evidence.score[:, (cosine, sine)].astype(np.float32)).T
        a, b, d = ((share * share) @ squares.astype(np.float32)).T
        a, d = a + 1.0 / evidence.prior[cosine], d + 1.0 / evidence.prior[sine]
        det = a * d - b * b
        likelihood += 0.5 * ((d * x * x - 2 * b * x * y + a * y * y) / det - np.log(det))
    chosen: Integers = np.argpartition(likelihood, -SHORTLIST)[-SHORTLIST:]
    return chosen


def word_log_likelihoods(evidence: Evidence, white: Singles) -> tuple[Floats, Floats, Floats]:
    """Log-likelihood ratio of each word (W, cells) to "no bands", depth and phase integrated out.

    With score b and information A of the word's P parameters and prior variance Λ:
    ½ bᵀ(A + Λ⁻¹)⁻¹b − ½ ln det(I + ΛA). Also the parameters' most probable values (W, P) and covariance (W, P, P).
    """
    normal, score = _word_normal_equations(evidence, white.astype(np.float64))
    inverse_prior = 1.0 / evidence.prior
    normal[:, range(len(inverse_prior)), range(len(inverse_prior))] += inverse_prior
    covariance = np.asarray(np.linalg.inv(normal), np.float64)
    bands: Floats = np.matmul(covariance, score[..., None])[..., 0]
    log_det = np.linalg.slogdet(normal)[1] - np.log(inverse_prior).sum()
    likelihood: Floats = 0.5 * ((bands * score).sum(axis=1) - log_det)
    return likelihood, bands, covariance


def _word_normal_equations(evidence: Evidence, white: Floats) -> tuple[Floats, Floats]:
    """Information (W, P, P) and score (W, P) of the parameters that all cells share."""
    parameters = len(evidence.prior)
    shares = band_shares(white, parameters)
    words, cells, _ = shares.shape
    score = (shares * evidence.score).sum(axis=1)
    by_row = evidence.information.transpose(1, 0, 2, 3).reshape(parameters, cells, cells * parameters)
    rows = np.matmul(shares.transpose(2, 0, 1), by_row).reshape(parameters, words, cells, parameters)
    return np.ascontiguousarray((rows * shares).sum(axis=2).transpose(1, 0, 2)), score
