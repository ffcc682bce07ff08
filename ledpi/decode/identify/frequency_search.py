"""Estimates a panel's true frequencies from the frames of one track.

An RC oscillator is off by a percent. Within a frame that hardly shows. But from frame to frame the bands then advance
by a tenth of a cycle and more besides what was expected, so that frames do not add up. So the frames are added up at
the phases of each frequency around the configured one, for each class. The codeword and the two frequencies that
together have the most power are proposed. `decision` then judges them on the same frames.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ledpi.core.records import Floats, Frame, PanelSpec
from ledpi.decode.evidence.cells import CellSamples, Lattice, Observation
from ledpi.decode.evidence.classes import wave_shares
from ledpi.decode.identify.codebook import Codebook

Complexes = NDArray[np.complex128]

MAX_OFF = 0.012  # relative: of an RC oscillator that was trimmed by hand
MIN_FRAMES = 4
# The phases of the first and the last frame tell frequencies apart that differ by 1/time; a quarter of that is fine
# enough for a parabola through three of them.
STEPS_PER_CYCLE = 4.0
# Of a wave whose phase hardly moves the mean takes almost all; what is left then is mostly noise.
MIN_LEFT = 0.2
# Cosine and sine may be so much alike; what is left of two that are more so is mostly noise, too.
MOST_ALIKE = 0.8
# Over the mean of noise: one of e^10 looks so by chance, and there are some 10 independent frequencies and 100
# codewords.
SIGNIFICANT = 10.0
# Codeword, black and white frequency are chosen among so many that are independent (12 frames of 17 ms): what is found
# must be surer by as much: 2·1.2 %·1250 Hz·0.2 s = 6, times 12; each of them may also stand still.
CHOICES = 300.0


class _Sampled(NamedTuple):
    samples: CellSamples
    frame: Frame  # its times count


@dataclass(frozen=True, slots=True, kw_only=True)
class Proposal:
    """A panel at frequencies that may be its own."""

    spec: PanelSpec
    measured: bool  # both; else one is only such that its phase stands still


def propose_frequencies(observations: Sequence[Observation], spec: PanelSpec, codebook: Codebook) -> Proposal | None:
    """The panel with the frequencies of the most power in these frames; None if no peak stands out.

    Frames on another lattice than the last one's are ignored. If a class has no peak, its phase is assumed to stand
    still from frame to frame, so that differences do not show it.
    """
    assert observations[-1].samples is not None, "frequencies are searched for"
    last = observations[-1].samples.lattice
    frames = [
        _Sampled(seen.samples, seen.frame)
        for seen in observations
        if seen.samples is not None and seen.samples.lattice is last and seen.samples.valid is None
    ]
    if len(frames) < MIN_FRAMES:
        return None
    times_s = np.array([(s.frame.row0_readout_ns - frames[0].frame.row0_readout_ns) * 1e-9 for s in frames])
    residual, weight = _residuals(frames)
    shares = wave_shares(codebook.white.astype(np.float64), len(spec.waves_hz))
    searched = [
        _powers(
            _sums(frames, residual, weight, hz),
            _image_sums(frames, weight, hz),
            times_s,
            hz,
            shares[..., k],
        )
        for k, hz in enumerate(spec.waves_hz)
    ]
    codeword = int(np.argmax(np.sum([power.max(axis=0) for _, power in searched], axis=0)))
    period_s = times_s[-1] / (len(frames) - 1)
    noise = _noise(frames, residual, weight)
    peaks = [_peak(frequencies, power[:, codeword], noise) for frequencies, power in searched]
    if not any(peaks):
        return None
    hz = tuple(peak or _frozen(hz, period_s) for peak, hz in zip(peaks, spec.waves_hz, strict=True))
    if min(hz) <= 0.0 or len(set(hz)) < len(hz):  # no panel's: what stands still may be either
        return None
    return Proposal(spec=spec.retune(hz), measured=all(peaks))


def off_frequency_note(marker_id: int, found: PanelSpec) -> str:
    """A note for the user on a panel that blinks at other frequencies than configured."""
    seen_hz = " and ".join(f"{hz:.0f}" for hz in found.waves_hz)
    return f"panel {marker_id} blinks at about {seen_hz} Hz, not as configured; `ledpi calibrate panel` measures it"


def _residuals(observations: Sequence[_Sampled]) -> tuple[Floats, Floats]:
    """(frames, cells·points) light of each frame over the mean picture's, corners' errors taken off; and weights."""
    light = np.stack([s.samples.light / s.samples.light.mean() for s in observations]).astype(np.float64)
    picture = np.maximum(light.mean(axis=0), 0.02)
    weight = picture / picture.mean()
    root = np.sqrt(weight).reshape(-1)
    residual = ((light / picture - 1.0).reshape(len(observations), -1)) * root
    basis = _nuisance_basis(picture, observations[-1].samples.lattice, root)
    residual -= (residual @ basis) @ basis.T
    return residual / root, weight.reshape(-1)


def _nuisance_basis(picture: Floats, lattice: Lattice, root: Floats) -> Floats:
    """(cells·points, 9) orthonormal: what another exposure and eight ways of wrong corners add, times `root`."""
    n, k, along = lattice.cells, lattice.k, lattice.along.astype(np.float64)
    rows = picture.reshape(n, n, k, k).transpose(0, 2, 1, 3).reshape(n * k, n * k)
    down, across = np.gradient(rows, along, along)
    q, p = np.meshgrid(2.0 * along - 1.0, 2.0 * along - 1.0, indexing="ij")
    both = p * across + q * down
    ways = np.stack([rows, across, p * across, q * across, down, p * down, q * down, p * both, q * both]) / rows
    by_cell = ways.reshape(9, n, k, n, k).transpose(0, 1, 3, 2, 4).reshape(9, -1)
    return np.asarray(np.linalg.qr((by_cell * root).T)[0])


def _sums(observations: Sequence[_Sampled], residual: Floats, weight: Floats, hz: float) -> Complexes:
    """(frames, cells): the wave that each cell shows, with the phase that it had when row 0 was read out."""
    rows = np.stack([s.samples.rows for s in observations]).astype(np.float64)
    turns = np.array([hz * s.frame.row_time_us * 1e-6 for s in observations])[:, None, None]
    waves = np.exp(-2j * math.pi * turns * rows)
    return np.asarray((waves * (residual * weight).reshape(rows.shape)).sum(axis=2))


def _image_sums(observations: Sequence[_Sampled], weight: Floats, hz: float) -> Complexes:
    """(frames, cells): the mean square of the wave that `_sums` demodulates by; 0 where it goes round in each cell."""
    cells = len(observations[-1].samples.light)
    even = np.full((len(observations), weight.size), cells / (len(observations) * weight.sum()))
    return _sums(observations, even, weight, 2.0 * hz)


def _powers(sums: Complexes, mirrored: Complexes, times_s: Floats, hz: float, shares: Floats) -> tuple[Floats, Floats]:
    """Frequencies (F,), and the power (F, codewords) of a wave in all cells of a codeword, over that of noise.

    `shares` (codewords, cells): how much of the wave each cell shows. The power is what the least-squares cosine and
    sine explain. In few frames, and in cells lower than a band, these are not orthogonal: real light turns both ways,
    and near half a cycle a frame either way looks much like the other, which would pull the frequency.
    """
    time_s = max(times_s[-1], 1e-3)
    # Those a frame rate apart advance alike from frame to frame, so that only one of them may be among those tried.
    reach = min(MAX_OFF * hz, 0.5 * (len(times_s) - 1) / time_s)
    count = math.ceil(reach * STEPS_PER_CYCLE * time_s)
    frequencies = hz + np.linspace(-reach, reach, 2 * count + 1)
    turning = np.exp(-2j * math.pi * frequencies[:, None] * times_s)
    turning -= turning.mean(axis=1, keepdims=True)  # as the residuals are without their mean
    left = np.maximum(np.square(np.abs(turning)).mean(axis=1), MIN_LEFT)
    squares = np.square(shares)
    total = turning @ sums @ shares.T  # (F, codewords)
    own = left[:, None] * np.maximum(squares.sum(axis=1), 1.0)
    other = np.square(turning) @ mirrored @ squares.T
    other *= np.minimum(1.0, MOST_ALIKE * own / np.maximum(np.abs(other), 1e-9))
    power = own * np.square(np.abs(total)) - (other.conj() * np.square(total)).real
    return frequencies, power / (np.square(own) - np.square(np.abs(other)))


def _frozen(hz: float, period_s: float) -> float:
    """The frequency nearest to `hz` whose bands stand still from frame to frame, so that differences do not show it."""
    return float(round(hz * period_s) / period_s)


def _noise(observations: Sequence[_Sampled], residual: Floats, weight: Floats) -> float:
    """The mean of `_powers` for noise alone, as if the whole residual were noise.

    A residual has the variance σ²/weight, so a sum over samples that are weighted by it has σ²·Σ weight.
    """
    frames, cells = len(observations), len(observations[-1].samples.light)
    variance = float((np.square(residual) * weight).mean()) * frames / (frames - 1)
    return frames * variance * float(weight.sum()) / cells / observations[-1].samples.independence


def _peak(frequencies: Floats, power: Floats, noise: float) -> float | None:
    """Top of a parabola through the highest and its neighbours; None where nothing stands out of `noise`."""
    if power.max() < SIGNIFICANT * noise:
        return None
    top = int(np.clip(np.argmax(power), 1, len(power) - 2))
    before, here, after = power[top - 1 : top + 2].tolist()
    bend = before - 2 * here + after
    shift = 0.5 * (before - after) / bend if bend < 0 else 0.0
    return float(frequencies[top] + min(1.0, max(-1.0, shift)) * (frequencies[1] - frequencies[0]))
