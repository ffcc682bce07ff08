"""Reads a panel's ID from the bands in its cells, all cells and both classes together.

The light of cell c at lattice point s and picture row y is

    I[c, s] = g_c · p_s · (1 + m_k(c) · cos(2π f_k t_row y − φ_k(c))) + noise

with a gain g_c for each cell, one diffuser profile p_s that all cells share, and the class k(c) of the cell, black or
white. The cells of a class share one oscillator: one frequency, one phase. What the picture would be without bands,
g_c · p_s, is estimated and divided out; what an error of the corners would add (the profile's slope times the shift
that each corner's error makes there) is projected out; what is left is regressed on a cosine and a sine per class.
A word of the dictionary says which cells carry which class, so its likelihood is that of *one* fit to the whole
panel: no cell is ever decided alone. Depth and phase are not known beforehand; they are integrated out under a
Gaussian whose width is the depth that the exposure leaves of a square wave (`shutter.harmonic_amplitude`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ledpi import shutter
from ledpi.decode.cells import CellSamples, Singles
from ledpi.markers import Dictionary
from ledpi.records import Frame, PanelSpec, Rejected

Doubles = NDArray[np.float64]

# Bilinear interpolation averages the noise of four pixels: the mean of the squared weights over all positions is
# (2/3)² of one pixel's variance. Samples that are closer than that allows share noise and count for less.
INTERPOLATION_VARIANCE = 4.0 / 9.0
PARAMETERS = 4  # cosine and sine of each class
SHORTLIST = 16  # words that are compared exactly
NO_BANDS = Rejected(stage="soft", reason="no_bands")
NO_WORD = Rejected(stage="soft", reason="not_in_dictionary")
AMBIGUOUS = Rejected(stage="soft", reason="ambiguous")
UNFIT = Rejected(stage="soft", reason="unfit")
IMPLAUSIBLE = Rejected(stage="soft", reason="implausible_depth")

# A word is taken where it is e^MARGIN times likelier than whatever else the panel may be. At 1e-6 false IDs a
# candidate, one in a day of 60 fps with two lamps in view is about ten candidates that look like a panel at all.
MARGIN = -math.log(1e-6)
# Of the things that blink like a panel, the share that shows no word: a mirror image, a broken panel, another system.
PRIOR_OF_NO_WORD = 0.001
# What a track adds: as much as a frame of its own must bring, less what guards against another panel in its place.
EXPECTED = MARGIN - 4.0
# No square wave leaves deeper bands than `shutter.harmonic_amplitude` of duty 0.5 by more than π/2 (a duty near 0), and
# the classes of one panel are thinned alike by whatever light does not blink. Texture knows of neither.
MAX_DEPTH = math.pi / 2
MAX_DEPTH_RATIO = 2.5
DEVIATIONS = 3.0  # allowed to either, for noise


@dataclass(frozen=True, slots=True, kw_only=True)
class Codebook:
    """The words that a panel may show, turned all four ways, for one pair of frequencies."""

    ids: NDArray[np.int64]  # (W,)
    quarter_turns: NDArray[np.int64]  # (W,) clockwise
    white: Singles  # (W, cells) 1 where the class is white, 0 where black
    correctable: int  # cells that may be wrong while the nearest word is still the right one
    spec: PanelSpec

    @classmethod
    def build(cls, ids: list[int], dictionary: Dictionary, spec: PanelSpec) -> Codebook:
        """The words of those `ids` of a dictionary whose panels have this `spec`."""
        words = dictionary.turned_words()[ids].reshape(len(ids) * 4, -1)
        return cls(
            ids=np.repeat(np.asarray(ids, np.int64), 4),
            quarter_turns=np.tile(np.arange(4), len(ids)),
            white=words.astype(np.float32),
            correctable=dictionary.correctable_cells(),
            spec=spec,
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Reading:
    """The best word, and how sure it is. Amplitudes and phases are of (black, white)."""

    id: int
    quarter_turns: int  # clockwise, of the word as seen in the picture
    margin: float  # natural-log likelihood ratio to the best rival
    amplitude: tuple[float, float]  # of the bands over the mean light
    phase_rad: tuple[float, float]  # of the bands' cosine at picture row 0


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """What the samples say of every cell and class: quadratic in the bands, so that words only add up.

    The log-likelihood of bands x (cosine and sine in each class, one x for all cells of it) is
    `score·x − xᵀ·information·x/2`.
    """

    score: Doubles  # (cells, 4)
    information: Doubles  # (cells, 4, cells, 4)
    prior: Doubles  # (4,) expected variance of x


def read_word(
    samples: CellSamples, frame: Frame, codebook: Codebook, expected_id: int | None = None
) -> Reading | Rejected:
    """The word that these samples show, or why none can be told.

    `expected_id` is what a track has shown at this place so far. It raises that ID's odds, but the frame must show
    bands by itself, and no other ID may fit it better.
    """
    evidence = gather_evidence(samples, frame, codebook.spec)
    if isinstance(evidence, Rejected):
        return evidence
    likely = shortlist(evidence, codebook.white)
    likelihood, fits, covariances = word_log_likelihoods(evidence, codebook.white[likely])
    first = int(np.argmax(likelihood))
    best, none = int(likely[first]), float(likelihood[first])
    if none < MARGIN:
        return NO_BANDS
    bands = fits[first]
    amplitude = (math.hypot(*bands[:2]), math.hypot(*bands[2:]))
    spread = np.sqrt(np.diagonal(covariances[first])).tolist()
    deviation = (max(spread[:2]), max(spread[2:]))
    if not _plausible(amplitude, deviation, evidence):
        return IMPLAUSIBLE
    prior = EXPECTED if codebook.ids[best] == expected_id else 0.0
    outside = _odds_against_other_patterns(evidence, codebook, best, bands) + prior
    if outside < MARGIN:
        return NO_WORD
    rivals = likelihood[codebook.ids[likely] != codebook.ids[best]]
    other = none - float(rivals.max()) + prior if len(rivals) else none
    if other < MARGIN:
        return AMBIGUOUS
    centre = float(samples.rows.mean())
    phases = []
    for k, hz in enumerate((codebook.spec.black_hz, codebook.spec.white_hz)):
        phases.append(math.atan2(bands[2 * k + 1], bands[2 * k]) + 2 * math.pi * _cycles_per_row(frame, hz) * centre)
    return Reading(
        id=int(codebook.ids[best]),
        quarter_turns=int(codebook.quarter_turns[best]),
        margin=min(none, other, outside),
        amplitude=amplitude,
        phase_rad=(phases[0], phases[1]),
    )


def _cycles_per_row(frame: Frame, frequency_hz: float) -> float:
    return frequency_hz * frame.row_time_us * 1e-6


def gather_evidence(samples: CellSamples, frame: Frame, spec: PanelSpec) -> Evidence | Rejected:
    """Divides the static picture out and correlates the rest with each class's bands in each cell."""
    cells, points = samples.light.shape
    gain, profile, residual = _remove_static_picture(samples)
    waves = _class_waves(samples, frame, spec)  # (4, cells, points)
    waves = waves - (waves @ (profile / profile.sum()))[..., None]
    # Weighted by the light: shot noise has the variance of the light, so of the light's ratio its inverse.
    root = np.sqrt(profile)
    weighted = (waves * root).transpose(1, 0, 2).reshape(cells * PARAMETERS, points)
    overlap = (weighted @ weighted.T).astype(np.float64).reshape(cells, PARAMETERS, cells, PARAMETERS)
    # Removing the shared profile takes from each cell what all of them have in common.
    g = gain.astype(np.float64)
    information = overlap * (-np.outer(g, g) / g.sum())[:, None, :, None]
    each = np.arange(cells)
    information[each, :, each, :] += g[:, None, None] * overlap[each, :, each, :]
    light = gain[:, None] * profile
    score = np.einsum("jcs,cs->cj", waves, residual * light, optimize=False).astype(np.float64)
    squares = float((residual * residual * light).sum())
    slopes = _registration_slopes(samples, gain, profile)
    nuisances = 0
    if slopes is not None:
        score, information, squares = _project_out(slopes, light, waves, residual, score, information, squares)
        nuisances = len(slopes)
    variance = _noise_variance(score, information, squares, samples, nuisances)
    if not variance > 0:
        return UNFIT
    independent = min(1.0, INTERPOLATION_VARIANCE * samples.step_px**2)
    scale = independent / variance
    frequencies = (spec.black_hz, spec.white_hz)
    amplitude = [shutter.harmonic_amplitude(1, hz, frame.exposure_us, spec.duty) for hz in frequencies]
    # A depth of which the mean square is the expected one; the phase may be any.
    prior = np.repeat(np.maximum(np.square(amplitude), 1e-12), 2) / 2
    return Evidence(score=score * scale, information=information * scale, prior=prior)


def _remove_static_picture(samples: CellSamples) -> tuple[Singles, Singles, Singles]:
    """Gain (cells,), profile (points,), both of mean 1, and I / (g·p) − 1 (cells, points) without their means."""
    light, valid = samples.light, samples.valid
    count = light.shape[1] if valid is None else valid.sum(axis=1)
    gain = light.sum(axis=1) / count
    if valid is None:
        profile = (light / gain[:, None]).mean(axis=0)
    else:
        seen = np.maximum(valid.sum(axis=0), 1)
        profile = (light / gain[:, None]).sum(axis=0) / seen
    profile = np.maximum(profile, np.float32(1e-3))
    ratio = light / (gain[:, None] * profile) - np.float32(1)
    if valid is not None:
        ratio *= valid
    gain, profile = gain / gain.mean(), profile / profile.mean()
    # Twice where samples are missing: rows and columns are then not independent of each other.
    for _ in range(1 if valid is None else 4):
        w = gain[:, None] * profile if valid is None else gain[:, None] * profile * valid
        ratio = ratio - (ratio * w).sum(axis=1, keepdims=True) / np.maximum(w.sum(axis=1, keepdims=True), 1e-9)
        ratio = ratio - (ratio * w).sum(axis=0) / np.maximum(w.sum(axis=0), 1e-9)
        if valid is not None:
            ratio *= valid
    return gain, profile, ratio


def _class_waves(samples: CellSamples, frame: Frame, spec: PanelSpec) -> Singles:
    """(4, cells, points): cosine and sine of black's bands, then of white's, from the panel's mean row."""
    rows = samples.rows - samples.rows.mean()
    out = np.empty((PARAMETERS, *rows.shape), np.float32)
    for k, hz in enumerate((spec.black_hz, spec.white_hz)):
        angle = rows * np.float32(2 * math.pi * _cycles_per_row(frame, hz))
        np.cos(angle, out=out[2 * k])
        np.sin(angle, out=out[2 * k + 1])
    if samples.valid is not None:
        out *= samples.valid
    return out


def _registration_slopes(samples: CellSamples, gain: Singles, profile: Singles) -> Singles | None:
    """(8, cells, points): relative change of the light for each way in which four corners can be off.

    The profile's logarithmic slopes along u and v, times the shifts that the lattice knows of.
    """
    k = samples.lattice.k
    if k < 3:
        return None
    shape = np.log(profile).reshape(k, k)
    slope = np.empty((2, k, k), np.float32)
    slope[0, :, 1:-1], slope[1, 1:-1] = 0.5 * (shape[:, 2:] - shape[:, :-2]), 0.5 * (shape[2:] - shape[:-2])
    slope[0, :, 0], slope[1, 0] = shape[:, 1] - shape[:, 0], shape[1] - shape[0]
    slope[0, :, -1], slope[1, -1] = shape[:, -1] - shape[:, -2], shape[-1] - shape[-2]
    flat = slope.reshape(2, k * k)
    shifts = samples.lattice.shifts
    fields = shifts[:, 0] * flat[0] + shifts[:, 1] * flat[1]
    fields -= (fields @ (profile / profile.sum()))[..., None]
    fields -= np.matmul(gain / gain.sum(), fields)[:, None, :]
    if samples.valid is not None:
        fields *= samples.valid
    return fields


def _project_out(
    slopes: Singles,
    light: Singles,
    waves: Singles,
    residual: Singles,
    score: Doubles,
    information: Doubles,
    squares: float,
) -> tuple[Doubles, Doubles, float]:
    """Score, information and sum of squares of what the slopes cannot explain (their Schur complement)."""
    cells, n = len(light), len(slopes)
    weighted = slopes * light
    flat = weighted.reshape(n, -1)
    normal = (flat @ slopes.reshape(n, -1).T).astype(np.float64)
    diagonal = np.einsum("ii->i", normal)  # a view
    diagonal += 1e-6 * (diagonal.mean() + 1e-12)
    with_waves = np.matmul(weighted.transpose(1, 0, 2), waves.transpose(1, 2, 0)).astype(np.float64)  # (cells, n, 4)
    with_waves = with_waves.transpose(1, 0, 2).reshape(n, cells * PARAMETERS)
    with_residual = (flat @ residual.reshape(-1)).astype(np.float64)
    solved = np.linalg.solve(normal, np.concatenate([with_waves, with_residual[:, None]], axis=1))
    score = score - (with_waves.T @ solved[:, -1]).reshape(cells, PARAMETERS)
    taken = with_waves.T @ solved[:, :-1]
    return score, information - taken.reshape(information.shape), squares - float(with_residual @ solved[:, -1])


def _noise_variance(
    score: Doubles, information: Doubles, squares: float, samples: CellSamples, nuisances: int
) -> float:
    """Variance of one sample of unit weight: what is left when every cell has bands of its own in both classes."""
    cells, points = samples.light.shape
    size = cells * PARAMETERS
    matrix = information.reshape(size, size).copy()
    diagonal = np.einsum("ii->i", matrix)  # a view
    diagonal += 1e-6 * diagonal.mean()
    flat = score.reshape(size)
    left = squares - float(flat @ np.linalg.solve(matrix, flat))
    used = cells * points if samples.valid is None else int(samples.valid.sum())
    freedom = used - cells - points - nuisances - size
    return left / freedom if freedom > 0 else math.nan


def shortlist(evidence: Evidence, white: Singles) -> NDArray[np.int64]:
    """The SHORTLIST likeliest words of (W, cells), told by a likelihood that leaves out what ties cells together.

    Exact within each cell. What cells share (profile, corners) takes about the same from every word, so the likeliest
    word and its rivals are among these; and the sums are plain matrix products, for any size of dictionary.
    """
    if len(white) <= SHORTLIST:
        return np.arange(len(white))
    score = np.empty((len(white), PARAMETERS))
    normal = np.empty((len(white), 2, 3))  # of each class: cosine², cosine·sine, sine²
    for k, weight in enumerate((1.0 - white, white)):
        two = slice(2 * k, 2 * k + 2)
        score[:, two] = weight @ evidence.score[:, two]
        own = np.einsum("cicj->cij", evidence.information[:, two][..., two])
        normal[:, k] = weight @ own.reshape(len(own), 4)[:, (0, 1, 3)]
    inverse_prior = (1.0 / evidence.prior).reshape(2, 2)
    a, b, d = normal[..., 0] + inverse_prior[:, 0], normal[..., 1], normal[..., 2] + inverse_prior[:, 1]
    x, y = score[:, 0::2], score[:, 1::2]
    det = a * d - b * b
    likelihood = 0.5 * ((d * x * x - 2 * b * x * y + a * y * y) / det - np.log(det)).sum(axis=1)
    chosen: NDArray[np.int64] = np.argpartition(likelihood, -SHORTLIST)[-SHORTLIST:]
    return chosen


def word_log_likelihoods(evidence: Evidence, white: Singles) -> tuple[Doubles, Doubles, Doubles]:
    """Log-likelihood ratio of each word (W, cells) to "no bands", depth and phase integrated out.

    With score b and information A of the word's four parameters and prior variance Λ:
    ½ bᵀ(A + Λ⁻¹)⁻¹b − ½ ln det(I + ΛA). Also the parameters' most probable values (W, 4) and covariance (W, 4, 4).
    """
    normal, score = _word_normal_equations(evidence, white.astype(np.float64))
    inverse_prior = 1.0 / evidence.prior
    normal[:, range(PARAMETERS), range(PARAMETERS)] += inverse_prior
    covariance: Doubles = np.linalg.inv(normal)
    bands: Doubles = np.matmul(covariance, score[..., None])[..., 0]
    log_det = np.linalg.slogdet(normal)[1] - np.log(inverse_prior).sum()
    likelihood: Doubles = 0.5 * ((bands * score).sum(axis=1) - log_det)
    return likelihood, bands, covariance


def _class_masks(white: Doubles) -> Doubles:
    """(W, cells, 4): which parameters each cell takes part in."""
    black = 1.0 - white
    return np.stack([black, black, white, white], axis=-1)


def _word_normal_equations(evidence: Evidence, white: Doubles) -> tuple[Doubles, Doubles]:
    """Information (W, 4, 4) and score (W, 4) of the parameters that all cells of a class share."""
    masks = _class_masks(white)
    score = np.einsum("wcj,cj->wj", masks, evidence.score)
    normal = np.empty((len(white), PARAMETERS, PARAMETERS))
    for j in range(PARAMETERS):
        for i in range(j + 1):
            pair = evidence.information[:, i, :, j]
            normal[:, i, j] = normal[:, j, i] = ((masks[:, :, i] @ pair) * masks[:, :, j]).sum(axis=1)
    return normal, score


def _plausible(amplitude: tuple[float, float], deviation: tuple[float, float], evidence: Evidence) -> bool:
    """Whether a square wave, seen through this exposure, can look like this in both classes of one panel."""
    expected = [math.sqrt(2.0 * variance) for variance in evidence.prior[::2].tolist()]
    most = [(a + DEVIATIONS * d) / e for a, d, e in zip(amplitude, deviation, expected, strict=True)]
    least = [(a - DEVIATIONS * d) / e for a, d, e in zip(amplitude, deviation, expected, strict=True)]
    if max(least) > MAX_DEPTH:
        return False
    return least[0] <= MAX_DEPTH_RATIO * most[1] and least[1] <= MAX_DEPTH_RATIO * most[0]


def _odds_against_other_patterns(evidence: Evidence, codebook: Codebook, best: int, bands: Doubles) -> float:
    """Log odds of the best word against all patterns that are too far from it to be it.

    Without this rival a panel that shows no word of the dictionary would pass as its neighbour. As with any code, a
    pattern counts as the word itself while no more cells differ than the dictionary can correct (a dead cell).
    Given the bands, cells are independent, so the patterns that differ in d cells sum up to the d-th elementary
    symmetric polynomial of the cells' likelihood ratios.
    """
    cells = len(evidence.score)
    masks = _class_masks(codebook.white[best].astype(np.float64))
    shown = masks * bands
    left = evidence.score - np.einsum("cidj,dj->ci", evidence.information, shown)
    change = (1.0 - masks) * bands - shown  # of a cell that changes its class
    own = np.einsum("cicj->cij", evidence.information)
    gain = (change * left).sum(axis=1) - 0.5 * np.einsum("ci,cij,cj->c", change, own, change)
    by_distance = np.zeros(cells + 1)
    by_distance[0] = 1.0
    for ratio in np.exp(np.minimum(gain, 40.0)).tolist():
        by_distance[1:] += by_distance[:-1] * ratio
    others = float(by_distance[codebook.correctable + 1 :].sum())
    # Beforehand: all words together against all patterns together, evenly within either.
    word_prior = math.log((1 - PRIOR_OF_NO_WORD) / len(codebook.ids))
    pattern_prior = math.log(PRIOR_OF_NO_WORD) - cells * math.log(2)
    return word_prior - pattern_prior - math.log(max(others, 1e-300))
