"""Reads the codeword that one frame shows by itself.

As long as bands are not deep, the light that was fitted tells: by sinusoids at first, and by the waves that an exposure
leaves of square ones, once their phases are known. Deep bands hide the static picture, so there cells are compared with
each other, twice too.
"""

from __future__ import annotations

import math

import numpy as np

from ledpi.core.records import Frame, Rejected
from ledpi.decode.evidence.band_estimate import estimate_bands
from ledpi.decode.evidence.cells import CellSamples
from ledpi.decode.evidence.evidence import UNFIT, Evidence
from ledpi.decode.evidence.light import LightWeigher
from ledpi.decode.evidence.single_frame import single_evidence
from ledpi.decode.evidence.waves import are_sinusoids, band_prior, is_deep_anywhere
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.identify.codewords import Fit, likeliest_far_pattern, rank_codewords
from ledpi.decode.identify.decision import (
    AMBIGUOUS,
    FALSE_ID_RATE,
    INCONSISTENT,
    NO_BANDS,
    STEADY,
    Reading,
    judge,
    odds_needed,
    surest_bands,
)
from ledpi.decode.identify.hypotheses import log_patterns, prior_odds_of_codeword
from ledpi.decode.identify.plausibility import misfit_inflation
from ledpi.decode.observation import Observation


def read_frame(
    seen: Observation, codebook: Codebook, weigher: LightWeigher, false_id_rate: float = FALSE_ID_RATE
) -> Reading | Rejected:
    """The codeword that this frame shows, its bands as counted from row 0; or the reason why there is none."""
    if is_deep_anywhere(band_prior(seen.frame, codebook.spec)):
        assert seen.samples is not None, "bands are deep"
        return read_deep_bands(seen.samples, seen.frame, codebook, false_id_rate)
    evidence = weigher.alone(seen, codebook.spec)
    if evidence is None:
        return UNFIT
    fit = rank_codewords(evidence, codebook.white)
    reading = judge(fit, evidence, codebook, false_id_rate)
    if isinstance(reading, Reading) and are_sinusoids(seen.frame.exposure_us, codebook.spec):
        return reading
    bands = surest_bands(fit, codebook, false_id_rate)
    if bands is None:
        return reading
    again = weigher.with_harmonics(seen, codebook.spec, bands)
    if again is None:
        return UNFIT
    refit = rank_codewords(again, codebook.white)
    if refit.codewords[0] != fit.codewords[0]:
        return INCONSISTENT
    reading = judge(refit, again, codebook, false_id_rate)
    if isinstance(reading, Rejected):
        return reading
    margin = _odds_under_either(again, refit, seen, codebook, weigher) / misfit_inflation(again, refit)
    if not margin >= odds_needed(false_id_rate):
        return AMBIGUOUS
    return reading._replace(margin=min(reading.margin, margin))


def _odds_under_either(
    evidence: Evidence, fit: Fit, seen: Observation, codebook: Codebook, weigher: LightWeigher
) -> float:
    """Log odds of the best codeword against patterns far from it: the mean under its phases, and under its rival's.

    Phases that fit a codeword favour it, and phases that fit the likeliest of those patterns favour that one.
    """
    best = fit.codewords[0]
    correctable = codebook.correctable_beside(fit.erased, best)
    of_rival, rival = likeliest_far_pattern(evidence, codebook.white[best], correctable)
    if of_rival == -math.inf:
        return math.inf
    theirs = weigher.with_harmonics(seen, codebook.spec, rank_codewords(evidence, rival[None]).bands)
    if theirs is None:
        return -math.inf
    own = fit.likelihood[0] - of_rival
    of_codeword = rank_codewords(theirs, codebook.white[best][None]).likelihood[0]
    under_rival = of_codeword - likeliest_far_pattern(theirs, codebook.white[best], correctable)[0]
    return 0.5 * (own + under_rival) + prior_odds_of_codeword(codebook) - log_patterns(fit.erased)


def read_deep_bands(
    samples: CellSamples, frame: Frame, codebook: Codebook, false_id_rate: float = FALSE_ID_RATE
) -> Reading | Rejected:
    """The codeword that cells show where bands are deep, or the reason why there is none.

    The first pass fits sinusoids. The second starts from its estimate: it fits what the exposure leaves of a square
    wave, and the static picture that remains. It starts from the codeword's cells and so favours them: those that are
    surely of the other class start as such.
    """
    spec = codebook.spec
    evidence = single_evidence(samples, frame, spec)
    if isinstance(evidence, Rejected):
        return evidence
    fit = rank_codewords(evidence, codebook.white)
    first = judge(fit, evidence, codebook, false_id_rate)
    if first in (NO_BANDS, STEADY, UNFIT) or (
        isinstance(first, Rejected) and _is_contradicted(fit, codebook, false_id_rate)
    ):
        return first
    white = (codebook.white[fit.codewords[0]] > 0) ^ (np.array(fit.gain) > odds_needed(false_id_rate))
    estimate = estimate_bands(samples, frame, spec, white, fit.bands)
    again = single_evidence(samples, frame, spec, estimate)
    if isinstance(again, Rejected):
        return again
    refit = rank_codewords(again, codebook.white)
    if refit.codewords[0] != fit.codewords[0]:
        return INCONSISTENT
    second = judge(refit, again, codebook, false_id_rate)
    if isinstance(second, Rejected):
        return second
    return second._replace(cell_bands=estimate.restore_phases(second.cell_bands))


def _is_contradicted(fit: Fit, codebook: Codebook, false_id_rate: float) -> bool:
    """Tells whether the evidence is already against the best codeword: too many cells, or all of one class.

    Too many are more cells of the other class than the dictionary can correct. A second pass may settle what was open,
    but not what was decided against the codeword.
    """
    needed = odds_needed(false_id_rate)
    if sum(gain > needed for gain in fit.gain) > codebook.correctable:
        return True
    misfit = fit.of_cells - fit.likelihood[0]  # by which either may be wrong
    return fit.likelihood[0] - fit.single_class < needed + misfit
