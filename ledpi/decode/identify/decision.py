"""Reads a panel's ID from the evidence of all its cells together.

A codeword of the dictionary says which cells carry which class, so its likelihood is that of *one* fit to the whole
panel: no cell is ever decided alone. Depth and phase are not known beforehand; they are integrated out under a
Gaussian whose width is the depth that the exposure leaves of a square wave (`shutter.harmonic_amplitude`). The best
codeword must win against its alternatives: no bands at all, the best other ID, all patterns that are no codeword, and
one class in all cells.

On an antiphase panel a codeword and its negative are one pattern, half a cycle apart; only codewords that differ
from all others' negatives are in its `Codebook`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from statistics import NormalDist
from typing import NamedTuple

import numpy as np

from ledpi.core.records import Floats, Frame, Rejected
from ledpi.decode.evidence.band_estimate import estimate_bands
from ledpi.decode.evidence.cells import CellSamples
from ledpi.decode.evidence.evidence import UNFIT, Evidence
from ledpi.decode.evidence.single_frame import single_evidence
from ledpi.decode.evidence.waves import are_sinusoids, is_deep_anywhere, is_faint
from ledpi.decode.identify import hypotheses
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.identify.codewords import Fit, rank_codewords
from ledpi.decode.identify.first_pass import first_pass
from ledpi.decode.identify.plausibility import all_rows_blink, is_plausible, misfit_inflation, settles_deep_bands

NO_BANDS = Rejected(stage="identify", reason="no_bands")
NO_CODEWORD = Rejected(stage="identify", reason="not_in_dictionary")
AMBIGUOUS = Rejected(stage="identify", reason="ambiguous")
INCONSISTENT = Rejected(stage="identify", reason="inconsistent_cells")
IMPLAUSIBLE = Rejected(stage="identify", reason="implausible_depth")

# The share of panels showing no codeword, but a pattern two or more cells away from every codeword, that are taken for
# one: in single frames, at the distance where that is most frequent (`docs/evaluating.md`, How sure an ID is). What it
# costs is measured by benchmarks/accuracy/false_ids.py. (Of 100,000 frames of decoys a rate ten times as high let one
# be read.)
FALSE_ID_RATE = 1e-6
# Faint bands are looked at once where more than so much is missing of the odds against other patterns: of
# 89 panels at 1.6 to 2.5 m that a second pass has read it was 5.1 nats at most.
SECOND_PASS_GAIN = 6.0
# An estimate is fitted to the light, so it explains more, of a lamp too. Of
# what a codeword explains a second pass adds 4 to 14 % where a panel shows it (of 24 read so, one 17 and one 40 %), and
# 26 to 80 % where a lamp does that blinks alike everywhere.
MAX_SECOND_PASS_GAIN = 0.2


class Reading(NamedTuple):
    """The best codeword, and how certain it is."""

    id: int
    quarter_turns: int  # clockwise, of the codeword as seen in the picture
    margin: float  # natural-log likelihood ratio to the best alternative
    likelihood: float  # natural-log likelihood ratio to "no bands at all"
    amplitude: tuple[float, float]  # of black's and white's bands over the mean light
    cell_bands: Floats  # (cells, P) cosine and sine of each wave, as each cell shows them


def read_codeword(
    samples: CellSamples,
    frame: Frame,
    codebook: Codebook,
    false_id_rate: float = FALSE_ID_RATE,
) -> Reading | Rejected:
    """The codeword that these samples show by themselves, or the reason why there is none.

    There are two passes if the second may change the answer, or if the exposure leaves more than sinusoids. The first
    fits sinusoids. The second starts from its estimate: it fits what the exposure leaves of a square wave, and the
    static picture that remains.
    """
    spec = codebook.spec
    first_result = first_pass(samples, frame, spec, codebook.white)
    if isinstance(first_result, Rejected):
        return first_result
    evidence, fit = first_result
    first = _judge(fit, evidence, codebook, false_id_rate)
    if isinstance(first, Reading):
        if are_sinusoids(frame.exposure_us, spec):
            return first
    elif not _is_open(first, fit, evidence, codebook, false_id_rate):
        return first
    return _second_pass(first, first_result, samples, frame, codebook, false_id_rate)


def _second_pass(
    first: Reading | Rejected,
    first_result: tuple[Evidence, Fit],
    samples: CellSamples,
    frame: Frame,
    codebook: Codebook,
    false_id_rate: float,
) -> Reading | Rejected:
    """The codeword of the first pass, or one that it left open, by the exact waveform; or a reason against it.

    It starts from the codeword's cells and so favours them: those that are surely of the other class start as such.
    """
    spec, (evidence, fit) = codebook.spec, first_result
    white = (codebook.white[fit.codewords[0]] > 0) ^ (np.array(fit.gain) > odds_needed(false_id_rate))
    estimate = estimate_bands(samples, frame, spec, white, fit.bands)
    again = single_evidence(samples, frame, spec, estimate=estimate)
    if isinstance(again, Rejected):
        return again
    refit = rank_codewords(again, codebook.white)
    if refit.codewords[0] != fit.codewords[0]:
        return INCONSISTENT
    second = _judge(refit, again, codebook, false_id_rate)
    if isinstance(second, Rejected):
        return second
    if isinstance(first, Rejected) and not is_deep_anywhere(evidence.prior):
        needed = odds_needed(false_id_rate)
        if second.likelihood > (1.0 + MAX_SECOND_PASS_GAIN) * fit.likelihood[0]:
            return INCONSISTENT
        if (
            not hypotheses.odds_under_either_estimate(first_result, (again, refit), samples, frame, codebook, needed)
            >= needed
        ):
            return AMBIGUOUS
        if not hypotheses.odds_against_single_light(fit, samples, frame, codebook) >= needed:
            return NO_CODEWORD
    return second._replace(cell_bands=estimate.restore_phases(second.cell_bands))


def _is_open(first: Rejected, fit: Fit, evidence: Evidence, codebook: Codebook, false_id_rate: float) -> bool:
    """Tells whether a second pass may change the result of the first."""
    if first in (NO_BANDS, UNFIT):
        return False
    contradicted = _is_contradicted(fit, evidence, codebook, false_id_rate)
    return not contradicted and not _is_hopeless(fit, evidence, codebook, false_id_rate)


def _is_contradicted(fit: Fit, evidence: Evidence, codebook: Codebook, false_id_rate: float) -> bool:
    """Tells whether the evidence is already against the best codeword: too many cells, or all of one class.

    Too many are more cells of the other class than the dictionary can correct. A second pass starts from the codeword's
    cells and so favours them: it may settle what was open, but not what was decided against the codeword.
    """
    needed = odds_needed(false_id_rate)
    if sum(gain > needed for gain in fit.gain) > codebook.correctable:
        return True
    if not is_deep_anywhere(evidence.prior):
        return False
    misfit = fit.of_cells - fit.likelihood[0]  # by which either may be wrong
    return fit.likelihood[0] - fit.single_class < needed + misfit


def _is_hopeless(fit: Fit, evidence: Evidence, codebook: Codebook, false_id_rate: float) -> bool:
    """Tells whether a second pass over faint bands, which gains little, cannot gain what is missing."""
    if not is_faint(evidence.prior):
        return False
    return hypotheses.odds_against_other_patterns(fit, codebook) < odds_needed(false_id_rate) - SECOND_PASS_GAIN


def _odds_against_other_ids(fit: Fit, codebook: Codebook) -> float:
    ids, best = codebook.ids, fit.codewords[0]
    others = (of for codeword, of in zip(fit.codewords, fit.likelihood, strict=True) if ids[codeword] != ids[best])
    return float(fit.likelihood[0] - next(others, 0.0))  # the likeliest of them comes first


def decide(evidence: Evidence, codebook: Codebook, false_id_rate: float) -> Reading | Rejected:
    """The codeword that the evidence supports, or the reason why there is none."""
    return _judge(rank_codewords(evidence, codebook.white), evidence, codebook, false_id_rate)


@cache
def odds_needed(false_id_rate: float) -> float:
    """The log odds that keep the rate of false IDs: ½z², for two patterns that are as hard to distinguish as can be.

    The log-likelihood ratio of the true pattern to another is normal, with mean D and variance 2D. It is below −m, as
    log odds of m for the other pattern ask for, with a probability that is greatest for D = m: Φ(−√(2m)).
    """
    return 0.5 * NormalDist().inv_cdf(false_id_rate) ** 2


def _judge(fit: Fit, evidence: Evidence, codebook: Codebook, false_id_rate: float) -> Reading | Rejected:
    """The best codeword, if it beats all alternatives."""
    needed = odds_needed(false_id_rate)
    best, none = fit.codewords[0], fit.likelihood[0]
    if none < needed:
        return NO_BANDS
    if not fit.is_finite:
        return UNFIT
    amplitude = [math.hypot(*wave) for wave in fit.bands.reshape(-1, 2).tolist()]
    deviation = [max(wave) for wave in zip(fit.deviation[::2], fit.deviation[1::2], strict=True)]
    if not is_plausible(amplitude, deviation, evidence):
        return IMPLAUSIBLE
    inflation = misfit_inflation(evidence, fit)
    outside = hypotheses.odds_against_no_codeword(evidence, fit, codebook, needed * inflation)
    if outside < needed:
        return NO_CODEWORD
    other = _odds_against_other_ids(fit, codebook)
    if other < needed:
        return AMBIGUOUS
    margin = min(none, other, outside) / inflation
    if margin < needed or not settles_deep_bands(evidence, fit, min(other, outside), needed) or not all_rows_blink(fit):
        return INCONSISTENT
    return Reading(
        id=int(codebook.ids[best]),
        quarter_turns=int(codebook.quarter_turns[best]),
        margin=margin,
        likelihood=none,
        amplitude=(amplitude[0], amplitude[-1]),
        cell_bands=fit.cell_bands,
    )


def select_best(readings: Sequence[Reading | Rejected], false_id_rate: float) -> Reading | Rejected:
    """The most likely reading, of those at each pair of frequencies that panels may have; at least one is given."""
    if len(readings) == 1:
        return readings[0]
    read = sorted((r for r in readings if isinstance(r, Reading)), key=lambda r: -r.likelihood)
    if not read:
        return next(r for r in readings if isinstance(r, Rejected))
    best = read[0]
    ahead = min((best.likelihood - r.likelihood for r in read[1:] if r.id != best.id), default=math.inf)
    if ahead < odds_needed(false_id_rate):
        return AMBIGUOUS
    return best if best.margin <= ahead else best._replace(margin=ahead)
