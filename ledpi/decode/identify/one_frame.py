"""Reads the codeword that one frame shows by itself, by the light that was fitted.

By sinusoids at first, and by the waves that an exposure leaves of square ones, once their phases are known.
"""

from __future__ import annotations

import math

from ledpi.core.records import Rejected
from ledpi.decode.evidence.cells import Observation
from ledpi.decode.evidence.evidence import UNFIT, Evidence
from ledpi.decode.evidence.light import LightWeigher
from ledpi.decode.evidence.waves import are_sinusoids
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.identify.codewords import Fit, likeliest_far_pattern, rank_codewords
from ledpi.decode.identify.decision import (
    AMBIGUOUS,
    FALSE_ID_RATE,
    INCONSISTENT,
    Reading,
    decide,
    odds_needed,
    surest_bands,
)
from ledpi.decode.identify.hypotheses import log_patterns, prior_odds_of_codeword
from ledpi.decode.identify.model_error import with_model_error


def read_frame(
    seen: Observation, codebook: Codebook, weigher: LightWeigher, false_id_rate: float = FALSE_ID_RATE
) -> Reading | Rejected:
    """The codeword that this frame shows, its bands as counted from row 0; or the reason why there is none."""
    evidence = weigher.alone(seen, codebook.spec)
    if evidence is None:
        return UNFIT
    reading = decide(evidence, codebook, false_id_rate)
    if isinstance(reading, Reading) and are_sinusoids(seen.frame.exposure_us, codebook.spec):
        return reading
    fit = rank_codewords(evidence, codebook.white)
    bands = surest_bands(evidence, fit, codebook, false_id_rate)
    if bands is None:
        return reading if isinstance(reading, Rejected) else AMBIGUOUS
    again = weigher.with_harmonics(seen, codebook.spec, bands)
    if again is None:
        return UNFIT
    refit = rank_codewords(again, codebook.white)
    if refit.codewords[0] != fit.codewords[0]:
        return INCONSISTENT
    reading = decide(again, codebook, false_id_rate)
    if isinstance(reading, Rejected):
        return reading
    margin = _odds_under_either(again, refit, seen, codebook, weigher)
    if not margin >= odds_needed(false_id_rate):
        return AMBIGUOUS
    return reading._replace(margin=min(reading.margin, margin))


def _odds_under_either(
    again: Evidence, fit: Fit, seen: Observation, codebook: Codebook, weigher: LightWeigher
) -> float:
    """Log odds of the best codeword against patterns far from it: the mean under its phases, and under its rival's.

    Phases that fit a codeword favour it, and phases that fit the likeliest of those patterns favour that one.
    """
    best = fit.codewords[0]
    codeword, correctable = codebook.white[best], codebook.correctable_beside(fit.erased, best)
    evidence = with_model_error(again, fit, codeword)
    of_rival, rival = likeliest_far_pattern(evidence, codeword, correctable)
    if of_rival == -math.inf:
        return math.inf
    theirs = weigher.with_harmonics(seen, codebook.spec, rank_codewords(evidence, rival[None]).bands)
    if theirs is None:
        return -math.inf
    known = with_model_error(theirs, rank_codewords(theirs, codeword[None]), codeword)
    own = rank_codewords(evidence, codeword[None]).likelihood[0] - of_rival
    of_codeword = rank_codewords(known, codeword[None]).likelihood[0]
    under_rival = of_codeword - likeliest_far_pattern(known, codeword, correctable)[0]
    return 0.5 * (own + under_rival) + prior_odds_of_codeword(codebook) - log_patterns(fit.erased)
