"""Competing hypotheses: log odds of the best codeword against patterns that are no codeword.

Beforehand a panel is as likely to show a codeword as another pattern. The best other codeword, and "no bands", are
compared in `decision`.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np

from ledpi.core.records import Frame, Mask, Rejected, Singles
from ledpi.decode.evidence.band_estimate import estimate_bands
from ledpi.decode.evidence.cells import CellSamples
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.evidence.single_frame import single_evidence
from ledpi.decode.evidence.waves import band_prior
from ledpi.decode.identify.codebook import NEAREST_PATTERN, Codebook
from ledpi.decode.identify.codewords import Fit, likeliest_far_pattern, near_pattern_likelihood, rank_codewords
from ledpi.decode.identify.first_pass import first_pass

# Patterns that are no codeword count as alternatives as if they showed up as often as codewords: all of them alike, or
# those that differ from a codeword in 2, 3 or 4 cells, evenly, which is more where panels have many cells.
NEAR_DISTANCES = 3
# Patterns are tried that differ in up to so many cells: what differs in more is less likely than these.
NEIGHBOURS = 3
# A codeword that leads the patterns near it by so many times what is needed is not held against patterns further off,
# which takes longer than all the rest: those that came nearer (two in 12,600 mirrored panels) it led by 1.1 and 1.7
# times.
FURTHER_ODDS = 4.0
# Of the lower announced frequency, and of the higher: from here to there lights are tried. Slower ones hardly change
# over a panel, and quicker ones hardly show at an exposure that makes bands invisible.
LIGHTS = (0.25, 2.0)


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
            odds_against_single_class(fit, codebook),
        )
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
    return prior_odds_of_codeword(codebook) - others - _log_patterns(fit.erased)


def odds_against_near_patterns(evidence: Evidence, fit: Fit, codebook: Codebook) -> float:
    """Log odds of the best codeword against patterns a few cells off, each with the bands that fit it best.

    With the codeword's bands, the pattern that is really there may look unlikely: those bands fit other cells.
    """
    best, of_codeword, erased = fit.codewords[0], fit.likelihood[0], fit.erased
    correctable = codebook.correctable_beside(erased, best)
    others = near_pattern_likelihood(evidence, codebook.white[best], correctable + 1, max(NEIGHBOURS, correctable + 1))
    return of_codeword - others + prior_odds_of_codeword(codebook) - _log_patterns(erased)


def odds_against_any_pattern(evidence: Evidence, fit: Fit, codebook: Codebook) -> float:
    """Log odds of the best codeword against the likeliest pattern that is too far from it; its bands are fitted anew.

    If a cell is about as high as a band, bands of other phases may explain nearly the same light in many other cells.
    """
    best = fit.codewords[0]
    correctable = codebook.correctable_beside(fit.erased, best)
    likelihood, _ = likeliest_far_pattern(evidence, codebook.white[best], correctable)
    return fit.likelihood[0] - likelihood + prior_odds_of_codeword(codebook) - _log_patterns(fit.erased)


def _log_patterns(erased: Mask | None) -> float:
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


def odds_against_single_class(fit: Fit, codebook: Codebook) -> float:
    """Log odds of the best codeword against all cells being of one class, bands fitted anew.

    A switched lamp is like that, or a panel with a failed driver. If cells are as high as bright bands, whole rows of
    them are dark; a codeword that agrees with that beats patterns that are like it.
    """
    return fit.likelihood[0] - fit.single_class + prior_odds_of_codeword(codebook)


def odds_against_single_light(fit: Fit, samples: CellSamples, frame: Frame, codebook: Codebook) -> float:
    """Log odds of the best codeword, in a first pass, against one light that blinks alike everywhere.

    All frequencies are tried, so close that one is within a quarter of a cycle over the panel's rows.
    """
    spec, rows = codebook.spec, samples.rows
    step_hz = 0.5e6 / (float(rows.max() - rows.min()) * abs(frame.row_time_us))
    lowest, highest = LIGHTS[0] * min(spec.waves_hz), LIGHTS[1] * max(spec.waves_hz)
    tried = np.arange(lowest, highest + 2 * step_hz, step_hz).tolist()
    as_deep = np.full(4, band_prior(frame, spec).max())
    all_alike = np.repeat(np.array([[0.0], [1.0]], np.float32), len(samples.light), axis=1)
    likelihood = [-math.inf]
    for one_hz, other_hz in zip(tried[::2], tried[1::2], strict=False):
        lights = replace(spec, black_hz=one_hz, white_hz=other_hz, phase="free")
        result = first_pass(samples, frame, lights, all_alike, as_deep)
        if not isinstance(result, Rejected):
            likelihood.append(result[1].likelihood[0])
    return fit.likelihood[0] - float(np.max(likelihood)) + prior_odds_of_codeword(codebook)


def odds_under_either_estimate(
    first: tuple[Evidence, Fit],
    second: tuple[Evidence, Fit],
    samples: CellSamples,
    frame: Frame,
    codebook: Codebook,
    needed: float,
) -> float:
    """Log odds of a second pass's best codeword against distant patterns: the mean under both linearisations, or each
    under its own, if that is less.

    A second pass divides an estimate out of the light before it compares cells, so it disfavours what blinks in other
    phases; one that starts from the alternative disfavours the codeword as much. The alternatives are the first pass's
    likeliest pattern and other ID, unless the first pass already has the odds that are `needed`: it has no estimate, so
    it is fair.
    """
    (evidence, fit), (own, refit) = first, second
    codeword, ids, odds = codebook.white[refit.codewords[0]], codebook.ids, math.inf
    likelihood, far = likeliest_far_pattern(evidence, codeword, NEIGHBOURS)
    alternatives = (
        [(far, prior_odds_of_codeword(codebook) - _log_patterns(fit.erased))] if likelihood != -math.inf else []
    )
    alternatives += [(codebook.white[other], 0.0) for other in fit.codewords if ids[other] != ids[refit.codewords[0]]][
        :1
    ]
    for alternative, before in alternatives:
        if before + _log_likelihood_ratio(codeword, alternative, evidence) >= needed:
            continue
        estimate = estimate_bands(
            samples, frame, codebook.spec, alternative > 0, rank_codewords(evidence, alternative[None]).bands
        )
        theirs = single_evidence(samples, frame, codebook.spec, estimate=estimate)
        if isinstance(theirs, Rejected):
            return -math.inf
        under_either = [_log_likelihood_ratio(codeword, alternative, each) for each in (own, theirs)]
        each_by_its_own = refit.likelihood[0] - rank_codewords(theirs, alternative[None]).likelihood[0]
        odds = _least(odds, before + 0.5 * sum(under_either), before + each_by_its_own)
    return odds


def _log_likelihood_ratio(codeword: Singles, alternative: Singles, evidence: Evidence) -> float:
    """Log-likelihood ratio of a codeword to an alternative (cells,), each with the bands that fit it best."""
    both = rank_codewords(evidence, np.stack([codeword, alternative]))
    lead = both.likelihood[0] - both.likelihood[1]
    return lead if both.codewords[0] == 0 else -lead


def prior_odds_of_codeword(codebook: Codebook) -> float:
    """Prior log odds of one codeword against one other pattern, if codewords and others are equally frequent."""
    alike = 2 if codebook.spec.phase == "antiphase" else 1  # a pattern and its negative are one
    return _prior_odds(*codebook.white.shape, alike)


@cache
def _prior_odds(codewords: int, cells: int, alike: int) -> float:
    all_even = cells * math.log(2) - math.log(alike * codewords)
    return min(all_even, math.log(NEAR_DISTANCES * math.comb(cells, NEAREST_PATTERN)))
