"""What the light of a panel's cells says of the bands in them, in one frame.

The light of cell c at lattice point s and picture row y is

    I[c, s] = a[c, s] · (1 + m_k(c) · cos(2π f_k t − φ_k(c))) + noise,    t: when row y was exposed

with the cell's static picture a and the class k(c) of the cell, black or white. The cells of a class share one
oscillator: one frequency, one phase. Of a single frame a is not known, but all cells share one diffuser profile:
a[c, s] = g_c · p_s with a gain for each cell. What the picture would be without bands is estimated and divided out;
what an error of the corners would add (the picture's slope times the shift that each corner's error makes there) is
projected out; what is left is correlated with a cosine and a sine per class, in each cell.

`memory` does the same over several frames, where a is learnt from the frames before.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ledpi import shutter
from ledpi.decode.cells import CellSamples, Singles
from ledpi.records import Frame, PanelSpec, Rejected

Doubles = NDArray[np.float64]

# Bilinear interpolation averages the noise of four pixels: the mean of the squared weights over all positions is
# (2/3)² of one pixel's variance. Samples that are closer than that allows share noise and count for less.
INTERPOLATION_VARIANCE = 4.0 / 9.0
PARAMETERS = 4  # cosine and sine of each class
UNFIT = Rejected(stage="soft", reason="unfit")


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """What the samples say of every cell and class: quadratic in the bands, so that words and frames only add up.

    The log-likelihood of bands x (cosine and sine in each class, one x for all cells of it) is
    `score·x − xᵀ·information·x/2`.
    """

    score: Doubles  # (cells, 4)
    information: Doubles  # (cells, 4, cells, 4)
    prior: Doubles  # (4,) expected variance of x


@dataclass(frozen=True, slots=True, kw_only=True)
class Correlation:
    """A residual (cells, points) against the class waves and against nuisances, before the noise is known."""

    residual: Singles  # relative: what the static picture leaves
    weight: Singles  # the inverse of the residual's variance, up to a factor
    waves: Singles  # (4, cells, points)
    nuisances: Singles  # (n, cells, points) what may also be in the residual; none of it is a band
    score: Doubles  # (cells, 4) waves · weight · residual
    information: Doubles  # (cells, 4, cells, 4) waves · weight · waves, what else is projected out taken off
    freedom: int  # of the residual, without what nuisances and bands take


def single_evidence(
    samples: CellSamples, frame: Frame, spec: PanelSpec, waves: Singles | None = None
) -> Evidence | Rejected:
    """The evidence of one picture; `waves` are its bands' shapes where it is no plain frame but a mean of several."""
    cells, points = samples.light.shape
    gain, profile, residual = _remove_shared_profile(samples)
    if waves is None:
        waves = class_waves(samples, frame, spec)
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
    weight = gain[:, None] * profile
    nuisances = _shared_slopes(samples, gain, profile)
    used = cells * points if samples.valid is None else int(samples.valid.sum())
    return evidence_from(
        Correlation(
            residual=residual,
            weight=weight,
            waves=waves,
            nuisances=nuisances,
            score=np.einsum("jcs,cs->cj", waves, residual * weight).astype(np.float64),
            information=information,
            freedom=used - cells - points - len(nuisances) - cells * PARAMETERS,
        ),
        samples,
        frame,
        spec,
    )


def evidence_from(
    correlation: Correlation, samples: CellSamples, frame: Frame, spec: PanelSpec
) -> Evidence | Rejected:
    """Takes the nuisances off, and weighs the rest by the noise that is left when every cell has bands of its own."""
    score, information, squares = _project_out(correlation)
    if correlation.freedom <= 0:
        return UNFIT
    size = score.size
    matrix = information.reshape(size, size).copy()
    diagonal = np.einsum("ii->i", matrix)  # a view
    diagonal += 1e-6 * diagonal.mean() + 1e-12
    flat = score.reshape(size)
    variance = (squares - float(flat @ np.linalg.solve(matrix, flat))) / correlation.freedom
    if not variance > 0:
        return UNFIT
    scale = min(1.0, INTERPOLATION_VARIANCE * samples.step_px**2) / variance
    return Evidence(score=score * scale, information=information * scale, prior=band_prior(frame, spec))


def band_prior(frame: Frame, spec: PanelSpec) -> Doubles:
    """(4,) variance of each class's cosine and sine: a depth whose mean square is the expected one, in any phase."""
    frequencies = (spec.black_hz, spec.white_hz)
    amplitude = [shutter.harmonic_amplitude(1, hz, frame.exposure_us, spec.duty) for hz in frequencies]
    return np.repeat(np.maximum(np.square(amplitude), 1e-12), 2) / 2


def class_waves(samples: CellSamples, frame: Frame, spec: PanelSpec, since_s: float = 0.0) -> Singles:
    """(4, cells, points): cosine and sine of black's bands, then of white's; `since_s` from the origin to row 0."""
    out = np.empty((PARAMETERS, *samples.rows.shape), np.float32)
    for k, hz in enumerate((spec.black_hz, spec.white_hz)):
        start = 2 * math.pi * ((hz * since_s) % 1.0)
        angle = samples.rows * np.float32(2 * math.pi * hz * frame.row_time_us * 1e-6) + np.float32(start)
        np.cos(angle, out=out[2 * k])
        np.sin(angle, out=out[2 * k + 1])
    if samples.valid is not None:
        out *= samples.valid
    return out


def _remove_shared_profile(samples: CellSamples) -> tuple[Singles, Singles, Singles]:
    """Gain (cells,), profile (points,), both of mean 1, and I / (g·p) − 1 (cells, points) without their means."""
    light, valid = samples.light, samples.valid
    count = light.shape[1] if valid is None else valid.sum(axis=1)
    gain = light.sum(axis=1) / count
    if valid is None:
        profile = (light / gain[:, None]).mean(axis=0)
    else:
        profile = (light / gain[:, None]).sum(axis=0) / np.maximum(valid.sum(axis=0), 1)
    profile = np.maximum(profile, np.float32(1e-3))
    ratio = light / (gain[:, None] * profile) - np.float32(1)
    gain, profile = gain / gain.mean(), profile / profile.mean()
    weight = gain[:, None] * profile
    if valid is not None:
        weight = weight * valid
    # More than once where samples are missing: rows and columns are then not independent of each other.
    by_cell, by_point = np.maximum(weight.sum(axis=1, keepdims=True), 1e-9), np.maximum(weight.sum(axis=0), 1e-9)
    for _ in range(1 if valid is None else 4):
        ratio = ratio - (ratio * weight).sum(axis=1, keepdims=True) / by_cell
        ratio = ratio - (ratio * weight).sum(axis=0) / by_point
    if valid is not None:
        ratio = ratio * valid
    return gain, profile, ratio


def _shared_slopes(samples: CellSamples, gain: Singles, profile: Singles) -> Singles:
    """(8, cells, points): relative change of the light for each way in which four corners can be off.

    The profile's logarithmic slopes along u and v, times the shifts that the lattice knows of. (0, …) where the
    lattice is too small to have slopes.
    """
    k = samples.lattice.k
    if k < 3:
        return np.empty((0, *samples.light.shape), np.float32)
    shape = np.log(profile).reshape(k, k)
    slope = np.empty((2, k, k), np.float32)
    slope[0, :, 1:-1], slope[1, 1:-1] = 0.5 * (shape[:, 2:] - shape[:, :-2]), 0.5 * (shape[2:] - shape[:-2])
    slope[0, :, 0], slope[1, 0] = shape[:, 1] - shape[:, 0], shape[1] - shape[0]
    slope[0, :, -1], slope[1, -1] = shape[:, -1] - shape[:, -2], shape[-1] - shape[-2]
    flat = slope.reshape(2, k * k)
    shifts = samples.lattice.shifts
    fields: Singles = shifts[:, 0] * flat[0] + shifts[:, 1] * flat[1]
    fields -= (fields @ (profile / profile.sum()))[..., None]
    fields -= np.matmul(gain / gain.sum(), fields)[:, None, :]
    if samples.valid is not None:
        fields *= samples.valid
    return fields


def _project_out(c: Correlation) -> tuple[Doubles, Doubles, float]:
    """Score, information and sum of squares of what the nuisances cannot explain (their Schur complement)."""
    cells, n = len(c.residual), len(c.nuisances)
    squares = float((c.residual * c.residual * c.weight).sum())
    if not n:
        return c.score, c.information, squares
    weighted = c.nuisances * c.weight
    flat = weighted.reshape(n, -1)
    normal = (flat @ c.nuisances.reshape(n, -1).T).astype(np.float64)
    diagonal = np.einsum("ii->i", normal)  # a view
    diagonal += 1e-6 * (diagonal.mean() + 1e-12)
    with_waves = np.matmul(weighted.transpose(1, 0, 2), c.waves.transpose(1, 2, 0)).astype(np.float64)  # (cells, n, 4)
    with_waves = with_waves.transpose(1, 0, 2).reshape(n, cells * PARAMETERS)
    with_residual = (flat @ c.residual.reshape(-1)).astype(np.float64)
    solved = np.linalg.solve(normal, np.concatenate([with_waves, with_residual[:, None]], axis=1))
    score = c.score - (with_waves.T @ solved[:, -1]).reshape(cells, PARAMETERS)
    taken = (with_waves.T @ solved[:, :-1]).reshape(c.information.shape)
    return score, c.information - taken, squares - float(with_residual @ solved[:, -1])
