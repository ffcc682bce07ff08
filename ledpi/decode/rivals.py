"""What else than its best word a panel may show: log odds of that word against patterns that are none.

Beforehand a panel shows a word as often as a pattern that is none. The best other word, and "no bands", are weighed in
`soft`.
"""

from __future__ import annotations

import math

import numpy as np

from ledpi.decode.codebook import NEAREST_PATTERN, Codebook, Mask
from ledpi.decode.evidence import Doubles, Evidence
from ledpi.decode.words import of_neighbours, word_log_likelihoods

# Patterns that are no word count as rivals as if they showed up as often as words: all of them alike, or those that
# differ from a word in 2, 3 or 4 cells, evenly, which is more where panels have many cells.
NEAR_DISTANCES = 3
# Patterns are tried that differ in up to so many cells: what differs in more is less likely than these.
NEIGHBOURS = 3


def odds_against_other_patterns(gain: Doubles, silent: Mask, codebook: Codebook, word: int) -> float:
    """Log odds of a word against all patterns that are too far from it to be it; `gain` is that of its `Fit`.

    Without this rival a panel that shows no word of the dictionary would pass as its neighbour. As with any code, a
    pattern counts as the word itself while no more cells differ than the dictionary can correct; those that are
    `silent` (cells,) are erasures: they may be either, and leave less to be corrected. Given the bands, cells are
    independent, so the patterns that differ in d cells sum up to the d-th elementary symmetric polynomial of the cells'
    likelihood ratios.
    """
    told, correctable = gain[~silent].tolist(), codebook.correctable_beside(silent, word)
    by_distance = [1.0] + [0.0] * correctable  # few cells differ: 0, 1, …
    further = 0.0  # more
    for of_cell in told:
        ratio = math.exp(min(of_cell, 40.0))
        further += (further + by_distance[-1]) * ratio
        for d in range(correctable, 0, -1):
            by_distance[d] += by_distance[d - 1] * ratio
    others = math.log(max(further, 1e-300))
    if others < -600:  # the nearest of them outshines the rest, and may be too small for a number
        others = sum(sorted(told)[-correctable - 1 :])
    return prior_odds_of_word(codebook) - others - int(np.count_nonzero(silent)) * math.log(2)


def odds_against_neighbours(
    evidence: Evidence, silent: Mask, codebook: Codebook, best: int, of_word: float
) -> float:
    """Log odds of a word against patterns a few cells off, each with the bands that fit it best.

    With the word's bands a pattern that is really shown may look unlikely: these are meant for other cells.
    """
    correctable = codebook.correctable_beside(silent, best)
    others = of_neighbours(evidence, codebook.white[best], correctable + 1, max(NEIGHBOURS, correctable + 1))
    return of_word - others + prior_odds_of_word(codebook) - int(np.count_nonzero(silent)) * math.log(2)


def odds_against_negative(of_negative: float, codebook: Codebook, of_word: float) -> float:
    """Log odds of a word against the pattern with all classes swapped, bands fitted anew.

    The one pattern that may look like the word although all its cells differ: where a cell is as high as a band is
    long, the same wave is in every cell, and all that the shared profile leaves of it is where it is *not*. (In
    antiphase it is the word itself.)
    """
    if codebook.spec.phase == "antiphase":
        return math.inf
    return of_word - of_negative + prior_odds_of_word(codebook)


def of_one_class(evidence: Evidence) -> float:
    """Log-likelihood ratio of all cells being of one class, its bands fitted anew, to "no bands".

    So is a lamp that is switched, or a panel whose driver has failed. Where cells are as high as bright bands, whole
    rows of them are dark, and a word that says so where they are outshines patterns that are like it.
    """
    both = np.stack([np.zeros(len(evidence.score)), np.ones(len(evidence.score))]).astype(np.float32)
    return float(word_log_likelihoods(evidence, both)[0].max())


def prior_odds_of_word(codebook: Codebook) -> float:
    """Log odds, beforehand, of one word against one pattern that is none, where words and others are as frequent."""
    cells = int(codebook.white.shape[1])
    alike = 2 if codebook.spec.phase == "antiphase" else 1  # a pattern and its negative are one
    all_even = cells * math.log(2) - math.log(alike * len(codebook.ids))
    return min(all_even, math.log(NEAR_DISTANCES * math.comb(cells, NEAREST_PATTERN)))
