"""What the light of a panel's cells says of the bands in them, in one frame.

The light of cell c at lattice point s and picture row y is

    I[c, s] = a[c, s] · (1 + m_k(c) · cos(2π f_k t − φ_k(c))) + noise,    t: when row y was exposed

with the cell's static picture a and the class k(c) of the cell, black or white. The cells of a class share one
oscillator: one frequency, one phase (in antiphase both classes do, as `classes` says). Of a single frame a is not
known; but all cells are built alike and seen through one lens, so but for a gain g they all send the same to point s of
their own, and across a border near s to a neighbour:

    a[c, s] = g_c · (p_s + Σ_m r_{m,s}) + Σ_n g_n · q_{n,s},    n: neighbours of c beyond a border near s

and m the sides near s where there is no neighbour: at a panel's rim stands no wall, or another one than between cells.
For known gains that is linear in p, q and r, at each point by itself. What it can explain is taken off, and with it
what a wrong gain and wrong corners would add (the picture's slope times the shift that each corner's error makes
there). What is left is correlated with a cosine and a sine of each wave, in each cell.

`single_frame` does so with one picture; `memory` over several frames, where a is learnt from the frames before.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np

from ledpi import shutter
from ledpi.decode.cells import CellSamples, Lattice
from ledpi.decode.evidence.classes import band_shares, wave_shares
from ledpi.decode.evidence.noise import WHITE, Correlation, expected_of
from ledpi.kernels import evidence as kernel
from ledpi.kernels.library import compiled
from ledpi.records import Floats, Frame, Mask, PanelSpec, Rejected, SeenBands, Singles

# Of full bands the darkest part: there is stray light, read noise, and a waveform that is not quite a square wave's, so
# that the dark says less of a cell than its few photons would.
DARKEST = 0.1
FULL_DEPTH = 0.5  # bands as deep as this outshine all noise
UNFIT = Rejected(stage="soft", reason="unfit")


@dataclass(frozen=True, slots=True, kw_only=True)
class Evidence:
    """What the samples say of every cell and wave: quadratic in the bands, so that words and frames only add up.

    The log-likelihood of bands x, cosine and sine of each wave in each cell, is `score·x − xᵀ·information·x/2`. There
    are P of them to a cell: 4 where the classes blink at two frequencies, 2 in antiphase.
    """

    score: Floats  # (cells, P)
    information: Floats  # (cells, P, cells, P)
    prior: Floats  # (P,) expected variance of x
    left: float  # log-likelihood of what no bands explain; noise if the model is right
    noise: Correlation = WHITE  # of the noise that it was weighed by

    @property
    def silent(self) -> Mask:
        """(cells,) of which it holds nothing."""
        own = self.information.reshape(self.score.size, -1).diagonal().reshape(self.score.shape)
        return np.asarray(~own.any(axis=1))

    @property
    def of_own_bands(self) -> Floats:
        """(cells, P, P) of the information, each cell's about its own bands."""
        return np.asarray(np.einsum("cicj->cij", self.information))

    def unexplained(self, bands: Floats) -> Floats:
        """(cells, P) the score that these bands (cells, P) leave: score − information·bands."""
        left: Floats = self.score - (self.information.reshape(bands.size, -1) @ bands.reshape(-1)).reshape(bands.shape)
        return left

    def by(self, noise: Correlation) -> Evidence:
        """As it is where noise is as alike as that: of what it claims as much as `volume` leaves."""
        volume = noise.volume
        if volume == 1.0:
            return self
        return replace(
            self, score=self.score / volume, information=self.information / volume, left=self.left / volume, noise=WHITE
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class Believed:
    """Bands that a first look has shown, from which a second one takes its bearings."""

    phases: tuple[float, ...]  # of each wave's fundamental; `waves` begin there
    bands: Floats  # (cells, P), by these waves
    waves: Singles  # (P, cells, points): what to measure them by
    white: Mask  # (cells,)
    light: Singles  # (2, cells, points): what the bands of either class make of an even light

    def own_light(self) -> Singles:
        """(cells, points): what each cell's bands make of it."""
        return np.asarray(np.where(self.white[:, None], self.light[1], self.light[0]), np.float32)

    def turned_back(self, bands: Floats) -> Floats:
        """Bands (cells, P) by these waves, as cosine and sine."""
        return rotated(bands, self.phases)


def rotated(bands: Floats, angles: Sequence[float]) -> Floats:
    """Bands (cells, P), cosine and sine of each wave, once that is shifted by its angle."""
    out = np.empty_like(bands)
    for k, angle in enumerate(angles):
        c, s = math.cos(angle), math.sin(angle)
        out[:, 2 * k : 2 * k + 2] = bands[:, 2 * k : 2 * k + 2] @ np.array([[c, s], [-s, c]])
    return out


def believed_bands(
    samples: CellSamples, frame: Frame, spec: PanelSpec, white: Mask, bands: Floats
) -> Believed:
    """What `bands` (P,), sinusoids in cells of which these are `white` (cells,), are as square waves seen through the
    exposure.

    Phase and depth of a square wave are those of its fundamental. Its own waves: what more depth adds, and what a
    later phase does, so that a small change of either is measured by the exact waveform, harmonics and all.
    """
    waves = np.empty((len(bands), *samples.rows.shape), np.float32)
    light = np.ones((2, *samples.rows.shape), np.float32)
    turned = np.zeros(len(bands))
    phases = [math.atan2(sine, cosine) for cosine, sine in bands.reshape(-1, 2).tolist()]
    of_classes = wave_shares(np.array([0.0, 1.0]), len(phases)).astype(np.float32)  # (black and white, waves)
    for k, (hz, phase) in enumerate(zip(spec.waves_hz, phases, strict=True)):
        two = slice(2 * k, 2 * k + 2)
        turned[2 * k] = math.hypot(*bands[two])
        waves[two] = square_waves(samples, frame, spec, hz, -phase / (2 * math.pi))
        light += of_classes[:, k, None, None] * np.float32(turned[2 * k]) * waves[2 * k]
    if samples.valid is not None:
        waves *= samples.valid
    return Believed(
        phases=tuple(phases),
        bands=band_shares(white.astype(np.float64), len(bands)) * turned,
        waves=waves,
        white=white,
        light=np.maximum(light, np.float32(DARKEST)),
    )


def bands_of(seen: SeenBands, frame: Frame, spec: PanelSpec) -> Floats:
    """(P,) cosine and sine of the fundamentals of square waves that are full and in these phases."""
    bands = []
    for hz, cycles in zip(spec.waves_hz, seen.phases, strict=False):
        fundamental = shutter.fundamental_amplitude(hz, frame.exposure_us, spec.duty)
        # Where a row is brightest: the middle of its exposure in the middle of the time that the wave is on.
        turn = 2 * math.pi * (cycles + 0.5 * hz * frame.exposure_us * 1e-6 - 0.5 * spec.duty)
        bands += [fundamental * math.cos(turn), -fundamental * math.sin(turn)]
    return np.array(bands)


def square_waves(samples: CellSamples, frame: Frame, spec: PanelSpec, hz: float, start_cycles: float) -> Singles:
    """(2, cells, points): `shutter.square_wave_bands` in each sample, smoothed as its bands are seen to be."""
    a_row, exposure_us = hz * frame.row_time_us * 1e-6, frame.exposure_us
    count, apart = 1, 1.0
    if samples.bands is not None and (shape := samples.bands.shape) is not None:
        exposure_us = shape.exposure_us
        count, apart = shutter.mean_of_rows(1, shape.smoothing_rows2)
    if compiled():
        return kernel.square_waves(
            samples.rows,
            cycles_a_row=a_row,
            start_cycles=start_cycles,
            averaged=count,
            apart=apart,
            exposure_cycles=hz * exposure_us * 1e-6,
            duty=spec.duty,
            fundamental=shutter.fundamental_amplitude(hz, exposure_us, spec.duty),
        )
    cycles = samples.rows.astype(np.float64) * a_row + start_cycles
    around = (np.arange(count) - (count - 1) / 2) * apart * a_row
    each = [shutter.square_wave_bands(cycles + row, hz, exposure_us, spec.duty) for row in around]
    return np.asarray(np.mean(each, axis=0), np.float32)


def is_deep(prior: Floats) -> bool:
    """Whether bands of this variance (P,) are so deep that their harmonics show, and hide what is static."""
    return math.sqrt(2.0 * min(prior.tolist())) > FULL_DEPTH


def is_deep_anywhere(prior: Floats) -> bool:
    """Whether one class's are: then what a model leaves open is not noise."""
    return math.sqrt(2.0 * max(prior.tolist())) > FULL_DEPTH


def evidence_of(
    found: kernel.Weighed | None, samples: CellSamples, frame: Frame, spec: PanelSpec, fitted: int
) -> Evidence | Rejected:
    """Evidence for which `fitted` functions were fitted to each cell."""
    if found is None:
        return UNFIT
    cells, parameters = len(samples.light), 2 * len(spec.waves_hz)
    return Evidence(
        score=found.score.reshape(cells, parameters),
        information=found.information.reshape(cells, parameters, cells, parameters),
        prior=band_prior(frame, spec),
        left=0.5 * samples.independence * found.free,
        noise=expected_of(samples, fitted).correlation(found.near, found.far, found.free),
    )


def band_prior(frame: Frame, spec: PanelSpec) -> Floats:
    """(P,) variance of each wave's cosine and sine: a depth whose mean square is the expected one, in any phase."""
    return _prior_of(frame.exposure_us, spec.waves_hz, spec.duty).copy()


@lru_cache(maxsize=64)  # exposures, of an automatic one too, are whole rows
def _prior_of(exposure_us: float, waves_hz: tuple[float, ...], duty: float) -> Floats:
    amplitude = [shutter.harmonic_amplitude(1, hz, exposure_us, duty) for hz in waves_hz]
    return np.repeat(np.maximum(np.square(amplitude), 1e-12), 2) / 2


def class_waves(samples: CellSamples, frame: Frame, spec: PanelSpec, since_s: float = 0.0) -> Singles:
    """(P, cells, points): cosine and sine of each of the panel's waves; `since_s` from the origin to row 0."""
    if compiled():
        out = kernel.waves(samples.rows, spec.waves_hz, frame.row_time_us, since_s)
        return out if samples.valid is None else np.asarray(out * samples.valid, np.float32)
    out = np.empty((2 * len(spec.waves_hz), *samples.rows.shape), np.float32)
    for k, hz in enumerate(spec.waves_hz):
        start = 2 * math.pi * ((hz * since_s) % 1.0)
        angle = samples.rows * np.float32(2 * math.pi * hz * frame.row_time_us * 1e-6) + np.float32(start)
        np.cos(angle, out=out[2 * k])
        np.sin(angle, out=out[2 * k + 1])
    if samples.valid is not None:
        out *= samples.valid
    return out


def picture_slopes(picture: Singles, lattice: Lattice) -> Singles:
    """(8, cells, points): relative change of this picture for each way in which its corners can be off."""
    n, k = lattice.cells, lattice.k
    whole = np.log(picture).reshape(n, n, k, k).transpose(0, 2, 1, 3).reshape(n * k, n * k)
    apart = np.diff(lattice.along)  # further across a border between cells
    before = apart[1:] / (apart[1:] + apart[:-1])
    slopes = np.empty((2, n * k, n * k), np.float32)
    for across, slope in ((whole.T, slopes[0].T), (whole, slopes[1])):
        step = (across[1:] - across[:-1]) / apart[:, None]
        slope[0], slope[-1] = step[0], step[-1]
        slope[1:-1] = step[1:] + (step[:-1] - step[1:]) * before[:, None]  # of a parabola through three
    flat = slopes.reshape(2, n, k, n, k).transpose(0, 1, 3, 2, 4).reshape(2, 1, n * n, k * k)
    out: Singles = lattice.shifts[:, 0] * flat[0]
    out += lattice.shifts[:, 1] * flat[1]
    return out
