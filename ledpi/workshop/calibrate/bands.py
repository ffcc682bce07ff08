"""Bands of a panel at rest: found near the announced frequencies, then measured.

Camera and panel stand still. The light of cell c in picture row y of frame n, whose row 0 was read out at t_n, is then

    L[n, c, y] = A[c, y] · g_n · (1 + Re Σ_h x_h · exp(2πi·h·(f·t_n + ν·y))) + noise of variance σ²·A,    h = 1, 2

with the static picture A, the camera's gain g_n, and for each class a frequency f, seen from frame to frame, and a
spatial frequency ν = f·t_row in cycles a row, seen within each frame. Both belong to one wave, in one phase, so all
frames add up: f comes out as sharp as the frames' times are known, but only up to multiples of the frame rate; ν tells
which. They are fitted apart, so that ν/f measures the row time where f is known, and doubts it where t_row is.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from ledpi.core.codewords import Bits
from ledpi.core.records import Floats
from ledpi.decode.evidence.classes import wave_shares

Complexes = NDArray[np.complex128]

SEARCH_FRAMES = 60  # enough to find the waves; all frames then refine them
CODEWORDS_AT_ONCE = 256  # bounds the memory of the search
MIN_MOVEMENT = 0.02  # share of a wave's power that the frames' mean must leave, for it to be searched
STEPS_PER_CYCLE = 4  # of a search's grid: a cycle over all frames that are searched, or over all rows

PART_FRAMES = 30  # half a second, within which an RC oscillator is steady enough
MAX_WANDER = 0.005  # of the frequency, to either side, from part to part
STEADY = (4.0, 1e-4)  # deviations, and share of the frequency: the larger may lie between the parts of a steady one
ROUNDS = 12  # of Gauss-Newton; from the search's grid four are enough
MIN_CERTAINTY = 8.0  # an amplitude in deviations: the best of 10⁹ guesses at noise reaches 6.5
CLOCK_SIGMA = 50e-6  # deviation of the clock that dates the frames: within ±100 ppm, as a share


@dataclass(frozen=True, slots=True, kw_only=True)
class PanelLight:
    """The light of one still panel: sufficient for all that is measured here."""

    light: Floats  # (frames, cells, rows) linear light of a cell's pixels in a picture row, summed; 0 where it has none
    seconds: Floats  # (frames,) when row 0 of the picture was read out
    frame_interval_us: float  # from one frame of the camera to the next, also where some are missing

    def parts(self, frames: int) -> list[PanelLight]:
        """The frames in as many parts of at least `frames` as there are."""
        count = max(1, len(self.light) // frames)
        lights, seconds = np.array_split(self.light, count), np.array_split(self.seconds, count)
        return [replace(self, light=one, seconds=when) for one, when in zip(lights, seconds, strict=True)]

    def times_from_middle(self) -> Floats:
        """(frames,) seconds, about their mean: phases and frequencies are then told independently."""
        return np.asarray(self.seconds - self.seconds.mean(), np.float64)

    def rows_from_middle(self) -> Floats:
        """(rows,) about the panel's middle row."""
        rows = self.light.shape[2]
        return np.asarray(np.arange(rows) - (rows - 1) / 2.0, np.float64)


@dataclass(frozen=True, slots=True, kw_only=True)
class Waves:
    """Candidates for one of a panel's waves: pairs of frequency and spatial frequency."""

    frequency_hz: Floats  # (waves,)
    cycles_per_row: Floats  # (waves,)


def find_codeword(panel: PanelLight, codewords: Bits, waves: Sequence[Waves]) -> tuple[int, list[int]]:
    """Index of the likeliest codeword, and which of each of the panel's `waves` (`decode.classes`) it shows.

    The log-likelihood ratio of a wave with free amplitude and phase is |Σ_c s_c·S_c|²/(σ²·V): S_c the light's deviation
    from the still picture, correlated with the wave, s_c how much of it the cell shows, V its expected power.
    """
    change, still = changes(panel.light[:SEARCH_FRAMES])
    seconds, rows = panel.times_from_middle()[:SEARCH_FRAMES], panel.rows_from_middle()
    shares = wave_shares(codewords.astype(np.float64), len(waves))
    best, best_waves = np.zeros(len(codewords)), np.zeros((len(waves), len(codewords)), np.int64)
    for k, candidates in enumerate(waves):
        spectrum = spectrum_of(change, seconds, rows, candidates)
        moved = moved_share(seconds, candidates.frequency_hz)
        power = np.where(moved > MIN_MOVEMENT, moved, np.inf)
        for start in range(0, len(codewords), CODEWORDS_AT_ONCE):
            some = slice(start, start + CODEWORDS_AT_ONCE)
            own = shares[some, :, k]
            light = np.maximum(np.square(own) @ still.sum(axis=1), 1e-9)
            ratio = np.abs(own @ spectrum) ** 2 / (light[:, None] * power)
            best_waves[k, some] = ratio.argmax(axis=1)
            best[some] += ratio.max(axis=1)
    codeword = int(best.argmax())
    return codeword, best_waves[:, codeword].tolist()


def search_step_hz(panel: PanelLight) -> float:
    """Returns how far two frequencies may be apart for a search not to step over what lies between them."""
    return 1.0 / (STEPS_PER_CYCLE * float(np.ptp(panel.seconds[:SEARCH_FRAMES])))


def moved_share(seconds: Floats, frequency_hz: Floats) -> Floats:
    """(waves,) share of a wave's power that is left once the frames' mean is taken off: 0 where it stands still."""
    mean = np.exp(2j * math.pi * np.outer(seconds, frequency_hz)).mean(axis=0)
    return np.asarray(1.0 - np.abs(mean) ** 2, np.float64)


def changes(light: Floats) -> tuple[Floats, Floats]:
    """Returns what changes from frame to frame (frames, cells, rows), each frame's gain off, and the still picture."""
    still = light.mean(axis=0)
    gain = light.sum(axis=(1, 2), keepdims=True) / still.sum()
    return light - gain * still, still


def spectrum_of(change: Floats, seconds: Floats, rows: Floats, waves: Waves) -> Complexes:
    """(cells, waves): Σ over frames and rows of change · exp(−2πi·(f·t + ν·y))."""
    in_time = np.exp(-2j * math.pi * np.outer(seconds, waves.frequency_hz))
    in_rows = np.exp(-2j * math.pi * np.outer(rows, waves.cycles_per_row))
    out = np.zeros((change.shape[1], len(waves.frequency_hz)), np.complex128)
    for frame, turn in zip(change, in_time, strict=True):
        out += (frame @ in_rows) * turn
    return out


@dataclass(frozen=True, slots=True, kw_only=True)
class ClassBands:
    """Measurements of one class; deviations are one standard deviation, from the residual of the fit."""

    frequency_hz: float
    frequency_sigma_hz: float
    cycles_per_row: float
    cycles_per_row_sigma: float
    amplitude: float  # of the first harmonic, over the mean light
    amplitude_sigma: float
    second: float  # x₂·conj(x₁)²/|x₁|³, real part: the second harmonic in the first one's phase, over the first
    second_sigma: float
    periods: float  # of the bands on the panel
    wander_hz: float = 0.0  # deviation of the frequency from part to part of the frames, where it is no steady one

    @property
    def certain(self) -> bool:
        """Tells whether there are such bands at all. Bands that stand still from frame to frame never are."""
        return self.amplitude >= MIN_CERTAINTY * self.amplitude_sigma


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """The codeword that a panel shows, and its two classes."""

    codeword: int  # index into the codewords that were searched
    black: ClassBands
    white: ClassBands


def measure_codeword(panel: PanelLight, codewords: Bits, waves: Sequence[Waves]) -> Measured:
    """The likeliest of `codewords` (W, cells; True is white) and how its classes blink, each certain or not.

    `waves` are candidates for black's and for white's; of a panel in antiphase for the one, which either class is then
    measured for by itself.
    """
    codeword, likeliest = find_codeword(panel, codewords, waves)
    of_black, of_white = (
        _measure_steady(panel, cells, float(own.frequency_hz[index]), float(own.cycles_per_row[index]))
        for cells, own, index in (
            (~codewords[codeword], waves[0], likeliest[0]),
            (codewords[codeword], waves[-1], likeliest[-1]),
        )
    )
    return Measured(codeword=codeword, black=of_black, white=of_white)


def _measure_steady(panel: PanelLight, cells: Bits, frequency_hz: float, cycles_per_row: float) -> ClassBands:
    """All frames in one phase; or, where the oscillator wanders too much for that, the mean of parts of them."""
    whole = _measure_class(panel, cells, frequency_hz, cycles_per_row)
    parts = []
    for part in panel.parts(PART_FRAMES):
        hz = _nearest(part, cells, frequency_hz, cycles_per_row)
        parts.append(_measure_class(part, cells, hz, cycles_per_row * hz / frequency_hz))
    apart = max(p.frequency_hz for p in parts) - min(p.frequency_hz for p in parts)
    allowed = max(STEADY[0] * math.sqrt(2) * max(p.frequency_sigma_hz for p in parts), STEADY[1] * frequency_hz)
    if apart <= allowed or not all(p.certain for p in parts):
        return whole
    return _mean_of(parts)


def _nearest(panel: PanelLight, cells: Bits, frequency_hz: float, cycles_per_row: float) -> float:
    """The strongest frequency within MAX_WANDER of one."""
    reach, step = MAX_WANDER * frequency_hz, 1.0 / (STEPS_PER_CYCLE * float(np.ptp(panel.seconds)))
    steps = math.ceil(reach / step)
    grid = np.asarray(frequency_hz + step * np.arange(-steps, steps + 1), np.float64)
    change, _ = changes(panel.light[:, cells].sum(axis=1, keepdims=True))
    waves = Waves(frequency_hz=grid, cycles_per_row=np.asarray(grid * (cycles_per_row / frequency_hz), np.float64))
    spectrum = spectrum_of(change, panel.times_from_middle(), panel.rows_from_middle(), waves)
    return float(grid[int(np.abs(spectrum[0]).argmax())])


def _mean_of(parts: Sequence[ClassBands]) -> ClassBands:
    """Averages an oscillator that wanders: means over the parts, and the deviation that wandering leaves to theirs."""
    root, wander = math.sqrt(len(parts)), float(np.std([p.frequency_hz for p in parts], ddof=1))
    means = {f.name: float(np.mean([getattr(p, f.name) for p in parts])) for f in fields(ClassBands)}
    means |= {name: means[name] / root for name in ("cycles_per_row_sigma", "amplitude_sigma", "second_sigma")}
    return ClassBands(**means | {"frequency_sigma_hz": wander / root, "wander_hz": wander})


def _measure_class(panel: PanelLight, cells: Bits, frequency_hz: float, cycles_per_row: float) -> ClassBands:
    """Least squares over the class's `cells` (cells,), from a wave that is nearly right (Gauss-Newton)."""
    change, still = changes(panel.light[:, cells].sum(axis=1, keepdims=True))
    seen = still[0] > 0
    change, weight = change[:, 0, seen], still[0, seen]
    seconds, rows = panel.times_from_middle(), panel.rows_from_middle()[seen]
    wave = np.array([frequency_hz, cycles_per_row])
    harmonics = np.zeros(4)
    normal = np.eye(6)
    residual = change
    for _ in range(ROUNDS):
        design = _design(seconds, rows, wave, harmonics, weight)
        linear = design[:4]
        if not harmonics.any():
            harmonics = _solve(linear, change, weight)[0]
            design = _design(seconds, rows, wave, harmonics, weight)
        residual = change - weight * np.tensordot(harmonics, design[:4], 1)
        step, normal = _solve(design, residual, weight)
        harmonics, wave = harmonics + step[:4], wave + step[4:]
    freedom = max(1, (change.shape[0] - 1) * (change.shape[1] - 1) - 6)
    covariance = np.linalg.inv(normal) * float((residual**2 / weight).sum()) / freedom
    return _class_bands(wave, harmonics, covariance, periods=float(wave[1] * np.ptp(rows)))


def _design(seconds: Floats, rows: Floats, wave: Floats, harmonics: Floats, weight: Floats) -> Floats:
    """(6, frames, rows): how the relative light changes with x₁, x₂ (real, imaginary), f and ν.

    What a still picture and the frames' gains could explain as well is projected out of each.
    """
    cycles = wave[0] * seconds[:, None] + wave[1] * rows
    first = np.exp(2j * math.pi * cycles)
    second = first * first
    of_cycles = (
        -2
        * math.pi
        * ((harmonics[0] + 1j * harmonics[1]) * first + 2 * (harmonics[2] + 1j * harmonics[3]) * second).imag
    )
    design = np.stack(
        [first.real, -first.imag, second.real, -second.imag, of_cycles * seconds[:, None], of_cycles * rows]
    )
    share = weight / weight.sum()
    design -= design.mean(axis=1, keepdims=True)
    design -= (design @ share)[..., None]
    return np.asarray(design)


def _solve(design: Floats, change: Floats, weight: Floats) -> tuple[Floats, Floats]:
    """Weighted least squares of change ≈ weight · Σ p·design with variance ∝ weight: p, and the normal matrix."""
    flat = design.reshape(len(design), -1)
    weighted = (design * weight).reshape(len(design), -1)
    normal = weighted @ flat.T
    scale = np.sqrt(np.maximum(np.diagonal(normal), 1e-30))
    scaled = normal / np.outer(scale, scale) + 1e-12 * np.eye(len(design))
    return np.linalg.solve(scaled, flat @ change.ravel() / scale) / scale, normal


def _class_bands(wave: Floats, harmonics: Floats, covariance: Floats, periods: float) -> ClassBands:
    sigma = np.sqrt(np.diagonal(covariance))
    first, second = complex(*harmonics[:2]), complex(*harmonics[2:])
    amplitude = abs(first)
    return ClassBands(
        frequency_hz=float(wave[0]),
        frequency_sigma_hz=float(sigma[4]),
        cycles_per_row=float(wave[1]),
        cycles_per_row_sigma=float(sigma[5]),
        amplitude=amplitude,
        amplitude_sigma=float(np.hypot(sigma[0], sigma[1]) / math.sqrt(2)),
        second=(second * first.conjugate() ** 2).real / amplitude**3,
        second_sigma=float(np.hypot(sigma[2], sigma[3]) / math.sqrt(2) / amplitude),
        periods=periods,
    )
