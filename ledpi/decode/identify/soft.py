"""Reads a panel's ID from the evidence of all its cells together.

A word of the dictionary says which cells carry which class, so its likelihood is that of *one* fit to the whole
panel: no cell is ever decided alone. Depth and phase are not known beforehand; they are integrated out under a
Gaussian whose width is the depth that the exposure leaves of a square wave (`shutter.harmonic_amplitude`). Three
rivals are weighed against the best word: no bands at all, the best other ID, and all patterns that are no word.

On an antiphase panel a word and its negative are one pattern, half a cycle apart; only words that can be told from all
others' negatives are in its `Codebook`.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import cache
from statistics import NormalDist
from typing import NamedTuple

from ledpi.core.records import Floats, Frame, Rejected
from ledpi.decode.cells import CellSamples
from ledpi.decode.evidence.believed import believed_bands
from ledpi.decode.evidence.evidence import UNFIT, Evidence
from ledpi.decode.evidence.single_frame import single_evidence
from ledpi.decode.evidence.waves import (
    are_sinusoids,
    is_deep_anywhere,
    is_faint,
)
from ledpi.decode.identify import rivals
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.identify.first_look import first_look
from ledpi.decode.identify.plausible import all_rows_blink, is_consistent, is_plausible
from ledpi.decode.identify.words import likeliest
from ledpi.kernels.words import Fit

NO_BANDS = Rejected(stage="soft", reason="no_bands")
NO_WORD = Rejected(stage="soft", reason="not_in_dictionary")
AMBIGUOUS = Rejected(stage="soft", reason="ambiguous")
INCONSISTENT = Rejected(stage="soft", reason="inconsistent_cells")
IMPLAUSIBLE = Rejected(stage="soft", reason="implausible_depth")

# The share of panels showing no word, but a pattern two or more cells away from every word, that are taken for one: in
# single frames, at the distance where that is most frequent (`docs/evaluating.md`, How sure an ID is). What it costs is
# measured by benchmarks/accuracy/false_ids.py. (Of 100,000 frames of decoys a rate ten times as high let one be read.)
FALSE_ID_RATE = 1e-6
# Faint bands are looked at once where more than so much is missing of the odds against other patterns: of
# 89 panels at 1.6 to 2.5 m that a second look has read it was 5.1 nats at most.
SECOND_LOOK_ADDS = 6.0
# Whatever is believed explains more: what a lamp shows, as a word with its own bands, more than the lamp does. Of what
# a word explains a second look adds 4 to 14 % where a panel shows it (of 24 read so, one 17 and one 40 %), and 26 to
# 80 % where a lamp does that blinks alike everywhere.
MOST_ADDED = 0.2


class Reading(NamedTuple):
    """The best word, and how sure it is."""

    id: int
    quarter_turns: int  # clockwise, of the word as seen in the picture
    margin: float  # natural-log likelihood ratio to the best rival
    likelihood: float  # natural-log likelihood ratio to "no bands at all"
    amplitude: tuple[float, float]  # of black's and white's bands over the mean light
    cell_bands: Floats  # (cells, P) cosine and sine of each wave, as each cell shows them


def read_word(
    samples: CellSamples,
    frame: Frame,
    codebook: Codebook,
    false_id_rate: float = FALSE_ID_RATE,
) -> Reading | Rejected:
    """The word that these samples show by themselves, or why none can be told.

    Bands are looked at twice where that may change the answer, or where the exposure leaves more than sinusoids: as
    such; and, once it is known where in their period they are, as what the exposure leaves of a square wave, with the
    static picture that is then left.
    """
    spec = codebook.spec
    looked = first_look(samples, frame, spec, codebook.white)
    if isinstance(looked, Rejected):
        return looked
    evidence, fit = looked
    first = _judged(fit, evidence, codebook, false_id_rate)
    if isinstance(first, Reading):
        if are_sinusoids(frame.exposure_us, spec):
            return first
    elif not _is_open(first, fit, evidence, codebook, false_id_rate):
        return first
    return _looked_again(first, looked, samples, frame, codebook, false_id_rate)


def _looked_again(
    first: Reading | Rejected,
    looked: tuple[Evidence, Fit],
    samples: CellSamples,
    frame: Frame,
    codebook: Codebook,
    false_id_rate: float,
) -> Reading | Rejected:
    """The word that a first look has shown, or left open, by the exact waveform; or why it cannot be told."""
    spec, (evidence, fit) = codebook.spec, looked
    believed = believed_bands(samples, frame, spec, codebook.white[fit.words[0]] > 0, fit.bands)
    again = single_evidence(samples, frame, spec, believed=believed)
    if isinstance(again, Rejected):
        return again
    refit, exact = likeliest(again, codebook.white), not are_sinusoids(frame.exposure_us, spec)
    if refit.words[0] != fit.words[0]:
        return INCONSISTENT
    second = _judged(refit, again, codebook, false_id_rate, exact=exact)
    if isinstance(second, Rejected):
        return second
    if isinstance(first, Rejected) and not is_deep_anywhere(evidence.prior):
        needed = odds_needed(false_id_rate)
        if second.likelihood > (1.0 + MOST_ADDED) * fit.likelihood[0]:
            return INCONSISTENT
        if not rivals.odds_by_either_belief(looked, (again, refit), samples, frame, codebook, needed) >= needed:
            return AMBIGUOUS
        if not rivals.odds_against_one_light(fit, samples, frame, codebook) >= needed:
            return NO_WORD
    return second._replace(cell_bands=believed.turned_back(second.cell_bands))


def _is_open(
    first: Rejected,
    fit: Fit,
    evidence: Evidence,
    codebook: Codebook,
    false_id_rate: float,
) -> bool:
    """Whether a second look may change what the first has told."""
    if first in (NO_BANDS, UNFIT):
        return False
    contradicted = _is_contradicted(fit, evidence, codebook, false_id_rate)
    return not contradicted and not _is_hopeless(fit, evidence, codebook, false_id_rate)


def _is_contradicted(fit: Fit, evidence: Evidence, codebook: Codebook, false_id_rate: float) -> bool:
    """Whether more cells than the dictionary can correct are surely of the other class than the best word says, or all
    of them may be of one class.

    A second look believes the word's cells, and so finds more of what it believes: it may settle what was open, but not
    what was decided against the word.
    """
    needed = odds_needed(false_id_rate)
    if sum(gain > needed for gain in fit.gain) > codebook.correctable:
        return True
    if not is_deep_anywhere(evidence.prior):
        return False
    misfit = fit.of_cells - fit.likelihood[0]  # by which either may be wrong
    return fit.likelihood[0] - fit.one_class < needed + misfit


def _is_hopeless(fit: Fit, evidence: Evidence, codebook: Codebook, false_id_rate: float) -> bool:
    """Whether a second look at faint bands, which adds little, cannot add what is missing."""
    if not is_faint(evidence.prior):
        return False
    return rivals.odds_against_other_patterns(fit, codebook) < odds_needed(false_id_rate) - SECOND_LOOK_ADDS


def _odds_against_other_ids(fit: Fit, codebook: Codebook) -> float:
    ids, best = codebook.ids, fit.words[0]
    others = (of for word, of in zip(fit.words, fit.likelihood, strict=True) if ids[word] != ids[best])
    return float(fit.likelihood[0] - next(others, 0.0))  # the likeliest of them comes first


def decide(evidence: Evidence, codebook: Codebook, false_id_rate: float) -> Reading | Rejected:
    """The word that the evidence is for, or why none can be told."""
    return _judged(likeliest(evidence, codebook.white), evidence, codebook, false_id_rate)


@cache
def odds_needed(false_id_rate: float) -> float:
    """The log odds at which so many are false, of two patterns where these cannot be told apart well or badly: ½z².

    The log-likelihood ratio of what is shown to what is not is normal, with mean D and variance 2D. It is below −m, as
    log odds of m for the other one ask for, by a chance that is greatest for D = m: Φ(−√(2m)).
    """
    return 0.5 * NormalDist().inv_cdf(false_id_rate) ** 2


def _judged(
    fit: Fit,
    evidence: Evidence,
    codebook: Codebook,
    false_id_rate: float,
    *,
    exact: bool = False,
) -> Reading | Rejected:
    """The best word, if it stands against all its rivals. `exact`: as of `is_consistent`."""
    needed = odds_needed(false_id_rate)
    best, none = fit.words[0], fit.likelihood[0]
    if none < needed:
        return NO_BANDS
    if not fit.is_finite:
        return UNFIT
    amplitude = [math.hypot(*wave) for wave in fit.bands.reshape(-1, 2).tolist()]
    deviation = [max(wave) for wave in zip(fit.deviation[::2], fit.deviation[1::2], strict=True)]
    if not is_plausible(amplitude, deviation, evidence):
        return IMPLAUSIBLE
    outside = rivals.odds_against_no_word(evidence, fit, codebook, needed)
    if outside < needed:
        return NO_WORD
    other = _odds_against_other_ids(fit, codebook)
    if other < needed:
        return AMBIGUOUS
    if not is_consistent(evidence, fit, min(other, outside) - needed, exact=exact):
        return INCONSISTENT
    if not all_rows_blink(fit):
        return INCONSISTENT
    return Reading(
        id=int(codebook.ids[best]),
        quarter_turns=int(codebook.quarter_turns[best]),
        margin=min(none, other, outside),
        likelihood=none,
        amplitude=(amplitude[0], amplitude[-1]),
        cell_bands=fit.shown,
    )


def surest(readings: Sequence[Reading | Rejected], false_id_rate: float) -> Reading | Rejected:
    """The reading to believe, of those under each pair of frequencies that panels may have; at least one is given."""
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
