"""Competing hypotheses: log odds of the best codeword against patterns that are no codeword.

Beforehand a panel is as likely to show a codeword as another pattern. The best other codeword, and "no bands", are
compared in `decision`.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from ledpi.core.records import Mask
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.identify.codebook import NEAREST_PATTERN, Codebook
from ledpi.decode.identify.codewords import Fit, likeliest_far_pattern, likeliest_part, near_pattern_likelihood

# Patterns that are no codeword count as alternatives as if they showed up as often as codewords: all of them alike, or
# those that differ from a codeword in 2, 3 or 4 cells, evenly, which is more where panels have many cells.
NEAR_DISTANCES = 3
# Patterns are tried that differ in up to so many cells: what differs in more is less likely than these.
NEIGHBOURS = 3
# A codeword that leads the patterns near it by so many times what is needed is not held against patterns further off,
# which takes longer than all the rest: those that came nearer (two in 12,600 mirrored panels) it led by 1.1 and 1.7
# times.
FURTHER_ODDS = 4.0


def odds_against_no_codeword(evidence: Evidence, fit: Fit, codebook: Codebook, needed: float) -> float:
    """Log odds of the best codeword against patterns that are none: the least of those computed.

    The expensive ones are computed only while the codeword has the odds that are `needed`.
    """
    odds = _least(
        odds_against_other_patterns(fit, codebook),
        odds_against_negative(fit.negative, codebook, fit.likelihood[0]),
    )
    if odds >= needed:
        odds = _least(
            odds,
            odds_against_near_patterns(evidence, fit, codebook),
        )
        odds = _least(odds, odds_against_parts(evidence, fit, codebook, min(odds, FURTHER_ODDS * needed)))
    if needed <= odds < FURTHER_ODDS * needed:
        odds = _least(odds, odds_against_any_pattern(evidence, fit, codebook))
    return odds


def _least(*odds: float) -> float:
    """The least of them; −∞ where one is not a number, which `min` might skip."""
    return -math.inf if any(map(math.isnan, odds)) else min(odds)


def odds_against_other_patterns(fit: Fit, codebook: Codebook) -> float:
    """Log odds of the best codeword against all patterns that are too far from it to be corrected to it.

    Without this alternative, a panel that shows no codeword of the dictionary would pass as the nearest one. As in any
    code, a pattern counts as the codeword while no more cells differ than the dictionary can correct. Erased cells may
    be either class, and leave fewer to be corrected.
    """
    others = fit.beyond[codebook.correctable_beside(fit.erased, fit.codewords[0])]
    return prior_odds_of_codeword(codebook) - others - log_patterns(fit.erased)


def odds_against_near_patterns(evidence: Evidence, fit: Fit, codebook: Codebook) -> float:
    """Log odds of the best codeword against patterns a few cells off, each with the bands that fit it best.

    With the codeword's bands, the pattern that is really there may look unlikely: those bands fit other cells.
    """
    best, of_codeword, erased = fit.codewords[0], fit.likelihood[0], fit.erased
    correctable = codebook.correctable_beside(erased, best)
    others = near_pattern_likelihood(evidence, codebook.white[best], correctable + 1, max(NEIGHBOURS, correctable + 1))
    return of_codeword - others + prior_odds_of_codeword(codebook) - log_patterns(erased)


def odds_against_any_pattern(evidence: Evidence, fit: Fit, codebook: Codebook) -> float:
    """Log odds of the best codeword against the likeliest pattern that is too far from it; its bands are fitted anew.

    If a cell is about as high as a band, bands of other phases may explain nearly the same light in many other cells.
    """
    best = fit.codewords[0]
    correctable = codebook.correctable_beside(fit.erased, best)
    likelihood, _ = likeliest_far_pattern(evidence, codebook.white[best], correctable)
    return fit.likelihood[0] - likelihood + prior_odds_of_codeword(codebook) - log_patterns(fit.erased)


def log_patterns(erased: Mask | None) -> float:
    """Log of the number of patterns that `erased` (cells,) may have."""
    return 0.0 if erased is None else int(np.count_nonzero(erased)) * math.log(2)


def odds_against_negative(of_negative: float, codebook: Codebook, of_codeword: float) -> float:
    """Log odds of a codeword against the pattern with all classes swapped, bands fitted anew.

    This pattern may look like the codeword although all its cells differ: if a cell is as high as a band, every cell
    has the same wave, and the shared profile leaves only the cells where it is *not*. (In antiphase it is the codeword
    itself.)
    """
    if codebook.spec.phase == "antiphase":
        return math.inf
    return of_codeword - of_negative + prior_odds_of_codeword(codebook)


def odds_against_parts(evidence: Evidence, fit: Fit, codebook: Codebook, enough: float) -> float:
    """Log odds of the best codeword against a part of a panel that fills its square; exact where less than `enough`.

    Such a part has fewer rows or columns of cells: one cell (or a switched lamp), two whose panel is dark or hidden
    else, two of panels side by side. Parts together are as frequent as codewords, each size as any other, and so is
    each pattern of a size. What a part can show that is the codeword itself, is for `panels.ids` to exclude.
    """
    codewords, cells = codebook.white.shape
    most = fit.likelihood[0] + math.log(cells - 1) - math.log(codewords)
    return most - likeliest_part(evidence, codebook.white, fit.codewords[0], most - enough)


def prior_odds_of_codeword(codebook: Codebook) -> float:
    """Prior log odds of one codeword against one other pattern, if codewords and others are equally frequent."""
    alike = 2 if codebook.spec.phase == "antiphase" else 1  # a pattern and its negative are one
    return _prior_odds(*codebook.white.shape, alike)


@cache
def _prior_odds(codewords: int, cells: int, alike: int) -> float:
    all_even = cells * math.log(2) - math.log(alike * codewords)
    return min(all_even, math.log(NEAR_DISTANCES * math.comb(cells, NEAREST_PATTERN)))
