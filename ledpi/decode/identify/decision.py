"""Reads a panel's ID from the evidence of all its cells together.

A codeword of the dictionary says which cells carry which class, so its likelihood is that of *one* fit to the whole
panel: no cell is ever decided alone. Depth and phase are not known beforehand; they are integrated out under a
Gaussian whose width is the depth that the exposure leaves of a square wave (`shutter.harmonic_amplitude`). The best
codeword must win against its alternatives: no bands at all, the best other ID, all patterns that are no codeword, and
parts of panels.

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

from ledpi.core.records import Floats, Rejected, Singles
from ledpi.decode.evidence.classes import band_shares
from ledpi.decode.evidence.evidence import UNFIT, Evidence
from ledpi.decode.identify import hypotheses
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.identify.codewords import Fit, rank_codewords
from ledpi.decode.identify.model_error import as_noise, with_model_error
from ledpi.decode.identify.plausibility import all_rows_blink, has_other_class, is_plausible

NO_BANDS = Rejected(stage="identify", reason="no_bands")
STEADY = Rejected(stage="identify", reason="steady")
NO_CODEWORD = Rejected(stage="identify", reason="not_in_dictionary")
AMBIGUOUS = Rejected(stage="identify", reason="ambiguous")
INCONSISTENT = Rejected(stage="identify", reason="inconsistent_cells")
IMPLAUSIBLE = Rejected(stage="identify", reason="implausible_depth")

# The share of panels showing no codeword, but a pattern two or more cells away from every codeword, that are taken for
# one: in single frames, at the distance where that is most frequent (`docs/evaluating.md`, How sure an ID is). What it
# costs is measured by evaluation/accuracy/false_ids.py. (Of 100,000 frames of decoys a rate ten times as high let one
# be read.)
FALSE_ID_RATE = 1e-6
SHALLOW = 0.25  # of the squares that bands should explain, as of a fit (panel_fit.c): they are half as deep


class Reading(NamedTuple):
    """The best codeword, and how certain it is."""

    id: int
    quarter_turns: int  # clockwise, of the codeword as seen in the picture
    margin: float  # natural-log likelihood ratio to the best alternative
    likelihood: float  # natural-log likelihood ratio to "no bands at all"
    amplitude: tuple[float, float]  # of black's and white's bands over the mean light
    cell_bands: Floats  # (cells, P) cosine and sine of each wave, as each cell shows them


@cache
def odds_needed(false_id_rate: float) -> float:
    """The log odds that keep the rate of false IDs: ½z², for two patterns that are as hard to distinguish as can be.

    The log-likelihood ratio of the true pattern to another is normal, with mean D and variance 2D. It is below −m, as
    log odds of m for the other pattern ask for, with a probability that is greatest for D = m: Φ(−√(2m)).
    """
    return 0.5 * NormalDist().inv_cdf(false_id_rate) ** 2


def decide(evidence: Evidence, codebook: Codebook, false_id_rate: float) -> Reading | Rejected:
    """The codeword that the evidence supports, if it beats all alternatives; or the reason why there is none.

    It must do so whether what it leaves beyond noise is noise, or an error of the model in single cells: cells that
    speak against it lose weight by the one, cells that are as large in light as they are wrong by the other.
    """
    needed = odds_needed(false_id_rate)
    fit = rank_codewords(evidence, codebook.white)
    if fit.likelihood[0] < needed:
        return STEADY if _would_show(evidence, codebook.white[fit.codewords[0]], needed) else NO_BANDS
    if not fit.is_finite:
        return UNFIT
    reading = _judge(as_noise(evidence, fit), codebook, needed)
    if isinstance(reading, Rejected):
        return reading
    by_cells = _judge(with_model_error(evidence, fit, codebook.white[fit.codewords[0]]), codebook, needed)
    if isinstance(by_cells, Rejected):
        return by_cells
    if (by_cells.id, by_cells.quarter_turns) != (reading.id, reading.quarter_turns):
        return AMBIGUOUS
    if has_other_class(evidence, fit, needed):
        return INCONSISTENT
    return reading._replace(margin=min(reading.margin, by_cells.margin), likelihood=fit.likelihood[0])


def _judge(evidence: Evidence, codebook: Codebook, needed: float) -> Reading | Rejected:
    """The best codeword of evidence in which errors are counted, if it beats all alternatives."""
    fit = rank_codewords(evidence, codebook.white)
    if not fit.is_finite:
        return UNFIT
    best, none = fit.codewords[0], fit.likelihood[0]
    amplitude = [math.hypot(*wave) for wave in fit.bands.reshape(-1, 2).tolist()]
    deviation = [max(wave) for wave in zip(fit.deviation[::2], fit.deviation[1::2], strict=True)]
    if not is_plausible(amplitude, deviation, evidence):
        return IMPLAUSIBLE
    outside = hypotheses.odds_against_no_codeword(evidence, fit, codebook, needed)
    if outside < needed:
        return NO_CODEWORD
    other = _odds_against_other_ids(fit, codebook)
    if other < needed:
        return AMBIGUOUS
    if none < needed or not all_rows_blink(fit):
        return INCONSISTENT
    return Reading(
        id=int(codebook.ids[best]),
        quarter_turns=int(codebook.quarter_turns[best]),
        margin=min(none, other, outside),
        likelihood=none,
        amplitude=(amplitude[0], amplitude[-1]),
        cell_bands=fit.cell_bands,
    )


def _would_show(evidence: Evidence, white: Singles, needed: float) -> bool:
    """Tells whether bands of half the expected depth had shown, but for one case in as many as the odds are for.

    Their log-likelihood ratio is normal, with mean D and variance 2D, and above ½z² where D − z·√(2D) is.
    """
    shows = band_shares(white.astype(np.float64), len(evidence.prior))
    information = np.einsum("cp,cpdp,dp->p", shows, evidence.information, shows)
    return SHALLOW * float(evidence.prior @ information) > 2.0 * needed * (1.0 + math.sqrt(2.0)) ** 2


def surest_bands(evidence: Evidence, fit: Fit, codebook: Codebook, false_id_rate: float) -> Floats | None:
    """The bands (P,) of the best codeword, if only patterns near it are open; None where their phases are.

    Cells that deviate from the codeword show the same bands.
    """
    needed = odds_needed(false_id_rate)
    if not fit.likelihood[0] >= needed or not fit.is_finite:
        return None
    if sum(gain > needed for gain in fit.gain) > codebook.correctable:
        return None
    odds = (
        _odds_against_other_ids(fit, codebook),
        hypotheses.odds_against_negative(fit.negative, codebook, fit.likelihood[0]),
        hypotheses.odds_against_parts(evidence, fit, codebook, needed),
    )
    return fit.bands if min(odds) >= needed else None


def _odds_against_other_ids(fit: Fit, codebook: Codebook) -> float:
    ids, best = codebook.ids, fit.codewords[0]
    others = (of for codeword, of in zip(fit.codewords, fit.likelihood, strict=True) if ids[codeword] != ids[best])
    return float(fit.likelihood[0] - next(others, 0.0))  # the likeliest of them comes first


def select_best(readings: Sequence[Reading | Rejected], false_id_rate: float) -> Reading | Rejected:
    """The most likely reading, of those at each pair of frequencies that panels may have; at least one is given."""
    if len(readings) == 1:
        return readings[0]
    read = sorted((r for r in readings if isinstance(r, Reading)), key=lambda r: -r.likelihood)
    if not read:
        return next((r for r in readings if isinstance(r, Rejected) and r != STEADY), STEADY)
    best = read[0]
    ahead = min((best.likelihood - r.likelihood for r in read[1:] if r.id != best.id), default=math.inf)
    if ahead < odds_needed(false_id_rate):
        return AMBIGUOUS
    return best if best.margin <= ahead else best._replace(margin=ahead)
