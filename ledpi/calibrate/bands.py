"""How the two classes of a panel's cells blink, measured from the light of its rows over many frames. Pure.

Camera and panel stand still. The light of cell c in picture row y of frame n, whose row 0 was read out at t_n, is then

    L[n, c, y] = A[c, y] · g_n · (1 + Re Σ_h x_h · exp(2πi·h·(f·t_n + ν·y))) + noise of variance σ²·A,    h = 1, 2

with the static picture A, the camera's gain g_n, and for each class a frequency f, seen from frame to frame, and a
spatial frequency ν = f·t_row in cycles a row, seen within each frame. Both belong to one wave, in one phase, so all
frames add up: f comes out as sharp as the frames' times are known, but only up to multiples of the frame rate; ν tells
which. They are fitted apart, so that ν/f measures the row time where f is known, and doubts it where t_row is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ledpi.markers import Bits
from ledpi.records import Floats

Complexes = NDArray[np.complex128]

SEARCH_FRAMES = 60  # enough to find the waves; all frames then refine them
WORDS_AT_ONCE = 256  # bounds the memory of the search
ROUNDS = 12  # of Gauss-Newton; from the search's grid four are enough
MIN_MOVEMENT = 0.02  # share of a wave's power that the frames' mean must leave, for it to be searched
MIN_CERTAINTY = 8.0  # an amplitude in deviations: the best of 10⁹ guesses at noise reaches 6.5
CLOCK_SIGMA = 50e-6  # deviation of the clock that dates the frames: within ±100 ppm, as a share
STEPS_PER_CYCLE = 4  # of a search's grid: a cycle over all frames that are searched, or over all rows


@dataclass(frozen=True, slots=True, kw_only=True)
class PanelLight:
    """The light of one still panel: sufficient for all that is measured here."""

    light: Floats  # (frames, cells, rows) linear light of a cell's pixels in a picture row, summed; 0 where it has none
    seconds: Floats  # (frames,) when row 0 of the picture was read out
    frame_interval_us: float  # from one frame of the camera to the next, also where some are missing

    def times_from_middle(self) -> Floats:
        """(frames,) seconds, about their mean: phases and frequencies are then told independently."""
        return np.asarray(self.seconds - self.seconds.mean(), np.float64)

    def rows_from_middle(self) -> Floats:
        """(rows,) about the panel's middle row."""
        rows = self.light.shape[2]
        return np.asarray(np.arange(rows) - (rows - 1) / 2.0, np.float64)


@dataclass(frozen=True, slots=True, kw_only=True)
class Waves:
    """Candidates for one class: pairs of frequency and spatial frequency."""

    frequency_hz: Floats  # (waves,)
    cycles_per_row: Floats  # (waves,)


@dataclass(frozen=True, slots=True, kw_only=True)
class ClassBands:
    """What was measured of one class; deviations are one standard deviation, from the residual of the fit."""

    frequency_hz: float
    frequency_sigma_hz: float
    cycles_per_row: float
    cycles_per_row_sigma: float
    amplitude: float  # of the first harmonic, over the mean light
    amplitude_sigma: float
    second: float  # x₂·conj(x₁)²/|x₁|³, real part: the second harmonic in the first one's phase, over the first
    second_sigma: float
    periods: float  # of the bands on the panel

    @property
    def certain(self) -> bool:
        """Whether there are such bands at all. Bands that stand still from frame to frame never are."""
        return self.amplitude >= MIN_CERTAINTY * self.amplitude_sigma


@dataclass(frozen=True, slots=True, kw_only=True)
class Measured:
    """The word that a panel shows, and its two classes."""

    word: int  # index into the words that were searched
    black: ClassBands
    white: ClassBands


def measure_word(panel: PanelLight, words: Bits, black: Waves, white: Waves) -> Measured:
    """The likeliest of `words` (W, cells; True is white) and how its classes blink, each certain or not."""
    word, *likeliest = _find_word(panel, words, black, white)
    of_black, of_white = (
        _measure_class(panel, cells, float(waves.frequency_hz[index]), float(waves.cycles_per_row[index]))
        for cells, waves, index in zip((~words[word], words[word]), (black, white), likeliest, strict=True)
    )
    return Measured(word=word, black=of_black, white=of_white)


def search_step_hz(panel: PanelLight) -> float:
    """How far two frequencies may be apart for a search not to step over what lies between them."""
    return 1.0 / (STEPS_PER_CYCLE * float(np.ptp(panel.seconds[:SEARCH_FRAMES])))


def moved_share(seconds: Floats, frequency_hz: Floats) -> Floats:
    """(waves,) share of a wave's power that is left once the frames' mean is taken off: 0 where it stands still."""
    mean = np.exp(2j * math.pi * np.outer(seconds, frequency_hz)).mean(axis=0)
    return np.asarray(1.0 - np.abs(mean) ** 2, np.float64)


def _find_word(panel: PanelLight, words: Bits, black: Waves, white: Waves) -> tuple[int, int, int]:
    """Index of the likeliest word, of its black wave and of its white one.

    A class's cells share one wave: the log-likelihood ratio of a wave with free amplitude and phase is
    |Σ_c S_c|²/(σ²·V), S_c the light's deviation from the still picture, correlated with the wave, V its expected power.
    """
    change, still = _changes(panel.light[:SEARCH_FRAMES])
    seconds, rows = panel.times_from_middle()[:SEARCH_FRAMES], panel.rows_from_middle()
    best, best_waves = np.zeros(len(words)), np.zeros((2, len(words)), np.int64)
    for k, waves in enumerate((black, white)):
        spectrum = _spectrum(change, seconds, rows, waves)
        moved = moved_share(seconds, waves.frequency_hz)
        power = np.where(moved > MIN_MOVEMENT, moved, np.inf)
        for start in range(0, len(words), WORDS_AT_ONCE):
            some = slice(start, start + WORDS_AT_ONCE)
            own = (words[some] if k else ~words[some]).astype(np.float64)
            light = np.maximum(own @ still.sum(axis=1), 1e-9)
            ratio = np.abs(own @ spectrum) ** 2 / (light[:, None] * power)
            best_waves[k, some] = ratio.argmax(axis=1)
            best[some] += ratio.max(axis=1)
    word = int(best.argmax())
    return word, int(best_waves[0, word]), int(best_waves[1, word])


def _measure_class(panel: PanelLight, cells: Bits, frequency_hz: float, cycles_per_row: float) -> ClassBands:
    """Least squares over the class's `cells` (cells,), from a wave that is nearly right (Gauss-Newton)."""
    change, still = _changes(panel.light[:, cells].sum(axis=1, keepdims=True))
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


def _changes(light: Floats) -> tuple[Floats, Floats]:
    """What changes from frame to frame (frames, cells, rows), each frame's gain taken off, and the still picture."""
    still = light.mean(axis=0)
    gain = light.sum(axis=(1, 2), keepdims=True) / still.sum()
    return light - gain * still, still


def _spectrum(change: Floats, seconds: Floats, rows: Floats, waves: Waves) -> Complexes:
    """(cells, waves): Σ over frames and rows of change · exp(−2πi·(f·t + ν·y))."""
    in_time = np.exp(-2j * math.pi * np.outer(seconds, waves.frequency_hz))
    in_rows = np.exp(-2j * math.pi * np.outer(rows, waves.cycles_per_row))
    out = np.zeros((change.shape[1], len(waves.frequency_hz)), np.complex128)
    for frame, turn in zip(change, in_time, strict=True):
        out += (frame @ in_rows) * turn
    return out


def _design(seconds: Floats, rows: Floats, wave: Floats, harmonics: Floats, weight: Floats) -> Floats:
    """(6, frames, rows): how the relative light changes with x₁, x₂ (real, imaginary), f and ν.

    What a still picture and the frames' gains could explain as well is projected out of each.
    """
    cycles = wave[0] * seconds[:, None] + wave[1] * rows
    first = np.exp(2j * math.pi * cycles)
    second = first * first
    of_cycles = -2 * math.pi * (
        (harmonics[0] + 1j * harmonics[1]) * first + 2 * (harmonics[2] + 1j * harmonics[3]) * second
    ).imag
    design = np.stack(
        [
            first.real,
            -first.imag,
            second.real,
            -second.imag,
            of_cycles * seconds[:, None],
            of_cycles * rows,
        ]
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
