"""What several frames of one panel say together.

After the first frame a panel's static picture is known, cell by cell, so a further frame is comparisons with the mean
of those before it: what differs are the bands. Each comparison is independent of all earlier ones (Helmert's
contrasts), and the oscillators are stable, so its evidence adds to theirs in one phase: the wave of the new frame
less the mean wave of the old ones. Where the phases stand still from frame to frame the comparisons say nothing;
then the mean picture, read as a single frame of less noise, still says what one frame would have said, and more.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ledpi.core.records import Floats, Frame, PanelSpec, Rejected, Singles
from ledpi.decode.cells import CellSamples, Lattice
from ledpi.decode.evidence.comparison import Mean, compared_evidence
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.evidence.noise import WHITE, Correlation
from ledpi.decode.evidence.single_frame import single_evidence
from ledpi.decode.evidence.waves import band_prior, class_waves, is_deep, turned

# Old evidence fades, as oscillators drift and a wrong turn must be mended: to a third in 30 frames, half a second.
FORGETTING = 0.97
# Frames that the mean picture remembers: a moving camera changes how a panel looks.
MEAN_FRAMES = 16.0
# Below this share of a wave's power the mean picture has no bands left that are worth reading.
MEAN_WAVE_POWER = 0.02
DARKEST = np.float32(0.02)  # of the mean picture's mean: what is darker is hardly lit, and has no logarithm


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparisonSum:
    """The sum of comparisons of frames with those before them; old ones fade."""

    score: Floats
    information: Floats
    residual: float
    noise: Correlation
    count: float  # of the comparisons

    @classmethod
    def accumulate(cls, before: ComparisonSum | None, added: Evidence) -> ComparisonSum:
        """The sum with one more comparison."""
        if before is None:
            noise = added.noise.average(WHITE, 0.0)
            return cls(
                score=added.score, information=added.information, residual=added.residual, noise=noise, count=1.0
            )
        return cls(
            score=FORGETTING * before.score + added.score,
            information=FORGETTING * before.information + added.information,
            residual=FORGETTING * before.residual + added.residual,
            noise=added.noise.average(before.noise, before.count),
            count=1.0 + FORGETTING * before.count,
        )


class PanelMemory(NamedTuple):
    """The frames of one panel so far, for one pair of frequencies. Frames come in order; corners keep their order."""

    spec: PanelSpec
    frames: int = 0
    origin_ns: int = 0  # row 0's read-out of the first frame, from which bands are counted
    last: tuple[CellSamples, Frame] | None = None
    running_mean: Mean | None = None  # picture of the frames on this lattice; None where the last one alone is
    comparisons: ComparisonSum | None = None

    def add_frame(self, samples: CellSamples, frame: Frame) -> tuple[PanelMemory, Evidence | None]:
        """The memory with one more frame, and the evidence that this adds by comparison with those before, if any.

        A frame on another lattice cannot be compared.
        """
        origin_ns = self.origin_ns if self.frames else frame.row0_readout_ns
        further = self._replace(frames=self.frames + 1, origin_ns=origin_ns, last=(samples, frame), running_mean=None)
        if self.lattice is not samples.lattice:  # or a first one; what was learnt of the bands stays, the picture not
            return further, None
        before, waves = self._mean(), self._waves(samples, frame)
        scale, added = compared_evidence(samples, frame, self.spec, waves, _clamp_dark(before))
        light = samples.light / np.float32(scale)
        running_mean = _update_mean(before, light, waves, _valid_counts(samples))
        if isinstance(added, Rejected):
            return further._replace(running_mean=running_mean), None
        comparisons = ComparisonSum.accumulate(self.comparisons, added)
        return further._replace(running_mean=running_mean, comparisons=comparisons), added.discount(comparisons.noise)

    @property
    def effective_frames(self) -> float:
        """Of how many frames the evidence is, as old ones have faded."""
        return min(self.frames, 1.0 / (1.0 - FORGETTING))

    @property
    def lattice(self) -> Lattice | None:
        """That of the newest frame; None before there is one."""
        return None if self.last is None else self.last[0].lattice

    @property
    def newest(self) -> tuple[CellSamples, Frame]:
        """The frame that was added last. Here and below: there must be one."""
        assert self.last is not None
        return self.last

    def newest_evidence(self) -> Evidence | None:
        """The newest frame's evidence by itself; None for deep bands, which need a second pass."""
        samples, frame = self.newest
        if is_deep(band_prior(frame, self.spec)):
            return None
        alone = single_evidence(samples, frame, self.spec, self._waves(samples, frame))
        return None if isinstance(alone, Rejected) else alone

    def mean(self) -> Mean:
        """The frames that there are to compare a further one with."""
        return _clamp_dark(self._mean())

    @property
    def noise(self) -> Correlation:
        """How far the comparisons so far found it alike in neighbouring samples."""
        return WHITE if self.comparisons is None else self.comparisons.noise

    def count_from_origin(self, bands: Floats) -> Floats:
        """Bands (cells, P) of the newest frame alone as all frames count them: from row 0 of the first."""
        _, frame = self.newest
        return turned(bands, self.spec.waves_hz, (frame.row0_readout_ns - self.origin_ns) * 1e-9)

    def evidence(self) -> Evidence | Rejected:
        """All evidence: the comparisons so far, and the mean picture read as one frame."""
        total, known = self._mean_picture_evidence(), self.comparison_evidence()
        if known is None:
            return total
        if isinstance(total, Rejected):
            return known
        return known._replace(
            score=known.score + total.score,
            information=known.information + total.information,
            residual=known.residual + total.residual,
        )

    def comparison_evidence(self) -> Evidence | None:
        """The evidence of the frames after the first, whatever the panel looks like."""
        if (known := self.comparisons) is None:
            return None
        prior = band_prior(self.newest[1], self.spec)
        return Evidence(
            score=known.score, information=known.information, prior=prior, residual=known.residual
        ).discount(known.noise)

    def _waves(self, samples: CellSamples, frame: Frame) -> Singles:
        """(P, cells, points): cosine and sine of each wave in this frame."""
        return class_waves(samples, frame, self.spec, (frame.row0_readout_ns - self.origin_ns) * 1e-9)

    def _mean(self) -> Mean:
        """Of the frames on this lattice; made of a first one when it is asked for, as most squares are seen once."""
        if self.running_mean is not None:
            return self.running_mean
        samples, frame = self.newest
        picture = samples.light / samples.light.mean()
        return Mean(picture=picture, count=_valid_counts(samples), waves=self._waves(samples, frame))

    def _mean_picture_evidence(self) -> Evidence | Rejected:
        mean, (samples, frame) = self._mean(), self.newest
        seen = mean.count > 0
        # A whole wave's cosine and sine have a power of 1 together.
        waves = len(mean.waves) // 2
        power = float(np.square(mean.waves).sum() / max(1, waves * int(seen.sum())))
        if self.comparisons is not None and power < MEAN_WAVE_POWER:
            nothing = np.zeros((len(mean.picture), len(mean.waves)))
            return Evidence(
                score=nothing,
                information=np.zeros(nothing.shape * 2),
                prior=band_prior(frame, self.spec),
                residual=0.0,
            )
        picture = replace(samples, light=mean.picture, valid=None if seen.all() else seen)
        return single_evidence(picture, frame, self.spec, mean.waves)


def _clamp_dark(mean: Mean) -> Mean:
    """The same, its picture above 0."""
    return replace(mean, picture=np.maximum(mean.picture, DARKEST))


def _update_mean(before: Mean, light: Singles, waves: Singles, valid: Singles) -> Mean:
    """The mean with a further frame, of `light` in its unit."""
    total = before.count + valid
    share = np.where(valid > 0, 1.0 / np.maximum(total, 1.0), 0.0).astype(np.float32)
    return Mean(
        picture=before.picture + (light - before.picture) * share,
        count=np.minimum(total, np.float32(MEAN_FRAMES)),
        waves=before.waves + (waves - before.waves) * share,
    )


def _valid_counts(samples: CellSamples) -> Singles:
    """(cells, points) 1, and 0 where a sample is not valid."""
    return np.ones(samples.light.shape, np.float32) if samples.valid is None else samples.valid.astype(np.float32)
