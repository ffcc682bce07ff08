"""The light of a still panel over many frames, and the search for the waves in it. Pure.

What waves there are is told by `bands`, which fits them.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from ledpi.core.records import Floats
from ledpi.decode.evidence.classes import wave_shares
from ledpi.markers.codewords import Bits

Complexes = NDArray[np.complex128]

SEARCH_FRAMES = 60  # enough to find the waves; all frames then refine them
CODEWORDS_AT_ONCE = 256  # bounds the memory of the search
MIN_MOVEMENT = 0.02  # share of a wave's power that the frames' mean must leave, for it to be searched
STEPS_PER_CYCLE = 4  # of a search's grid: a cycle over all frames that are searched, or over all rows


@dataclass(frozen=True, slots=True, kw_only=True)
class PanelLight:
    """The light of one still panel: sufficient for all that is measured here."""

    light: Floats  # (frames, cells, rows) linear light of a cell's pixels in a picture row, summed; 0 where it has none
    seconds: Floats  # (frames,) when row 0 of the picture was read out
    frame_interval_us: float  # from one frame of the camera to the next, also where some are missing

    def parts(self, frames: int) -> list[PanelLight]:
        """The frames in as many parts of at least `frames` as there are."""
        count = max(1, len(self.light) // frames)
        return [
            replace(self, light=light, seconds=seconds)
            for light, seconds in zip(
                np.array_split(self.light, count), np.array_split(self.seconds, count), strict=True
            )
        ]

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
