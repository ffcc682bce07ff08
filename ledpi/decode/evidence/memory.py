"""What several frames of one panel say together.

After the first frame a panel's static picture is known, cell by cell, so a further frame is compared with the mean
of those before it: what differs are the bands. Each comparison is independent of all earlier ones (Helmert's
contrasts), and the oscillators are stable, so its evidence adds to theirs in one phase: the wave of the new frame
less the mean wave of the old ones. Where the phases stand still from frame to frame the comparisons say nothing;
then the mean picture, read as a single frame of less noise, still says what one frame would have said, and more.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ledpi.decode.cells import CellSamples, Lattice
from ledpi.decode.evidence.comparison import LEAST_SCALE, Mean, compared_evidence
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.evidence.noise import WHITE, Correlation
from ledpi.decode.evidence.single_frame import single_evidence
from ledpi.decode.evidence.waves import band_prior, class_waves, turned
from ledpi.records import Floats, Frame, PanelSpec, Rejected, Singles

# Old evidence fades, as oscillators drift and a wrong turn must be mended: to a third in 30 frames, half a second.
FORGETTING = 0.97
# Frames that the mean picture remembers: a moving camera changes how a panel looks.
MEAN_FRAMES = 16.0
# Below this share of a wave's power the mean picture has no bands left that are worth reading.
MEAN_WAVE_POWER = 0.02
DARKEST = np.float32(0.02)  # of the mean picture's mean: what is darker is hardly lit, and has no logarithm


@dataclass(frozen=True, slots=True, kw_only=True)
class Known:
    """The mean of some frames, and when they began."""

    lattice: Lattice
    origin_ns: int  # row 0's read-out of the first frame, from which phases count
    mean: Mean


class PanelMemory:
    """The frames of one panel so far, for one pair of frequencies. Frames come in order; corners keep their order."""

    def __init__(self, spec: PanelSpec) -> None:
        self.spec = spec
        self.frames = 0
        self.lattice: Lattice | None = None
        self.origin_ns = 0  # row 0's read-out of the first frame, from which bands are counted
        self._first: tuple[CellSamples, Frame] | None = None  # of the mean picture, until that is made
        self._score: Floats | None = None
        self._information: Floats | None = None
        self._left = 0.0
        self._noise, self._compared = WHITE, 0.0  # of the comparisons, and of how many

    def add(self, samples: CellSamples, frame: Frame) -> Evidence | None:
        """Takes a frame in. Returns what it adds by comparison with those before, if anything."""
        if self.frames == 0:
            self.origin_ns = frame.row0_readout_ns
        compared = None
        if self.frames == 0 or self.lattice is not samples.lattice:
            # A new lattice: what was learnt of the bands stays, the picture does not.
            self.lattice = samples.lattice
            self._first = samples, frame
        else:
            self._begin()
            compared = self._compare(samples, frame)
        self._samples, self._frame = samples, frame
        self.frames += 1
        return compared

    def known(self) -> Known:
        """What there is to compare a further frame with."""
        return Known(lattice=self._samples.lattice, origin_ns=self.origin_ns, mean=self._mean())

    @property
    def noise(self) -> Correlation:
        """How far the comparisons so far found it alike in neighbouring samples."""
        return self._noise

    @property
    def newest(self) -> tuple[CellSamples, Frame]:
        """The frame that was added last."""
        return self._samples, self._frame

    def in_its_time(self, bands: Floats) -> Floats:
        """Bands (cells, P) of the newest frame alone as all frames count them: from row 0 of the first."""
        return turned(bands, self.spec.waves_hz, (self._frame.row0_readout_ns - self.origin_ns) * 1e-9)

    def evidence(self) -> Evidence | Rejected:
        """All that is known: the comparisons so far, and the mean picture read as one frame."""
        total, known = self._of_mean_picture(), self.of_comparisons()
        if known is None:
            return total
        if isinstance(total, Rejected):
            return known
        return replace(known, score=known.score + total.score, information=known.information + total.information)

    def of_comparisons(self) -> Evidence | None:
        """What the frames after the first have said, whatever the panel looks like."""
        if self._score is None or self._information is None:
            return None
        return Evidence(
            score=self._score,
            information=self._information,
            prior=band_prior(self._frame, self.spec),
            left=self._left,
        ).by(self._noise)

    def _begin(self) -> None:
        """Makes a mean picture of the first frame, once it is asked for: most squares are seen once."""
        if self._first is None:
            return
        samples, frame = self._first
        self._count, self._picture = _shown(samples), samples.light / samples.light.mean()
        self._mean_waves = self._waves(samples, frame)
        self._first = None

    def _waves(self, samples: CellSamples, frame: Frame) -> Singles:
        """(P, cells, points): cosine and sine of each wave in this frame."""
        return class_waves(samples, frame, self.spec, (frame.row0_readout_ns - self.origin_ns) * 1e-9)

    def _of_mean_picture(self) -> Evidence | Rejected:
        self._begin()
        seen = self._count > 0
        # A whole wave's cosine and sine have a power of 1 together.
        waves = len(self._mean_waves) // 2
        power = float(np.square(self._mean_waves).sum() / max(1, waves * int(seen.sum())))
        if self._score is not None and power < MEAN_WAVE_POWER:
            nothing = np.zeros((len(self._picture), len(self._mean_waves)))
            return Evidence(
                score=nothing,
                information=np.zeros(nothing.shape * 2),
                prior=band_prior(self._frame, self.spec),
                left=0.0,
            )
        mean = replace(self._samples, light=self._picture, valid=None if seen.all() else seen)
        return single_evidence(mean, self._frame, self.spec, self._mean_waves)

    def _compare(self, samples: CellSamples, frame: Frame) -> Evidence | None:
        waves = self._waves(samples, frame)
        scale, added = compared_evidence(samples, frame, self.spec, waves, self._mean())
        if isinstance(added, Evidence):
            before = 0.0 if self._score is None else FORGETTING * self._score
            known = 0.0 if self._information is None else FORGETTING * self._information
            self._score, self._information = before + added.score, known + added.information
            self._left = FORGETTING * self._left + added.left
            self._noise = added.noise.after(self._noise, self._compared)
            self._compared = 1.0 + FORGETTING * self._compared
        self._remember(samples.light / np.float32(max(scale, LEAST_SCALE)), waves, _shown(samples))
        return added.by(self._noise) if isinstance(added, Evidence) else None

    def _mean(self) -> Mean:
        self._begin()
        return Mean(picture=np.maximum(self._picture, DARKEST), count=self._count, waves=self._mean_waves)

    def _remember(self, light: Singles, waves: Singles, valid: Singles) -> None:
        total = self._count + valid
        share = np.where(valid > 0, 1.0 / np.maximum(total, 1.0), 0.0).astype(np.float32)
        self._picture = self._picture + (light - self._picture) * share
        self._mean_waves = self._mean_waves + (waves - self._mean_waves) * share
        self._count = np.minimum(total, np.float32(MEAN_FRAMES))


def _shown(samples: CellSamples) -> Singles:
    """(cells, points) 1, and 0 where a sample is not valid."""
    return np.ones(samples.light.shape, np.float32) if samples.valid is None else samples.valid.astype(np.float32)
