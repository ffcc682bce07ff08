"""Adds up the evidence of several frames of one panel.

After the first frame a panel's static picture is known, place by place, so a further frame is compared with the mean
of those before it: what differs are the bands. Each comparison is independent of all earlier ones (Helmert's
contrasts), and the oscillators are stable, so its evidence adds to theirs in one phase: the wave of the new frame
less the mean wave of the old ones. Where the phases stand still from frame to frame the comparisons say nothing;
then the mean picture, read as a single frame of less noise, still says what one frame would have said, and more.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ledpi.core.records import Floats, PanelSpec, Rejected
from ledpi.decode.evidence.cells import Observation
from ledpi.decode.evidence.evidence import UNFIT, Evidence
from ledpi.decode.evidence.light import LightWeigher, Mean
from ledpi.decode.evidence.waves import band_prior, turned

# Old evidence fades, as oscillators drift and a wrong turn must be mended: to a third in 30 frames, half a second.
FORGETTING = 0.97
# Frames that the mean picture remembers: a moving camera changes how a panel looks.
MEAN_FRAMES = 16.0
# Below this share of a wave's power the mean picture has no bands left that are worth reading.
MEAN_WAVE_POWER = 0.02


@dataclass(frozen=True, slots=True, kw_only=True)
class ComparisonSum:
    """The sum of comparisons of frames with those before them; old ones fade."""

    score: Floats
    information: Floats

    @classmethod
    def accumulate(cls, before: ComparisonSum | None, added: Evidence) -> ComparisonSum:
        """The sum with one more comparison."""
        if before is None:
            return cls(score=added.score, information=added.information)
        return cls(
            score=FORGETTING * before.score + added.score,
            information=FORGETTING * before.information + added.information,
        )


class PanelMemory(NamedTuple):
    """The frames of one panel so far, for one pair of frequencies. Frames come in order; corners keep their order."""

    spec: PanelSpec
    frames: int = 0
    origin_ns: int = 0  # row 0's read-out of the first frame, from which bands are counted
    last: Observation | None = None
    mean: Mean | None = None  # picture of the frames on one grid; None where the last one alone is
    comparisons: ComparisonSum | None = None
    looked_at: float = 0.0  # samples of a cell that these are from, and those of a first frame; old ones fade alike

    def begin(self, seen: Observation) -> PanelMemory:
        """The memory of a first frame."""
        return self._replace(frames=1, origin_ns=seen.frame.row0_readout_ns, last=seen)

    def add_frame(
        self, seen: Observation, weigher: LightWeigher, *, decimate: bool = False
    ) -> tuple[PanelMemory, Evidence | None]:
        """The memory with one more frame, and the evidence that this adds by comparison with those before, if any.

        `decimate`: by fewer samples, where the panel is near. A frame on another grid cannot be compared.
        """
        if not self.frames:
            return self.begin(seen), None
        further = self._replace(frames=self.frames + 1, last=seen, mean=None)
        before = self._mean(weigher).decimated if decimate else self._mean(weigher)
        if not weigher.is_comparable(seen, before, decimate=decimate):
            return further, None  # what was learnt of the bands stays, the picture does not
        picture, added = weigher.compare(seen, self.spec, further._since_s(seen), before)
        further = further._replace(mean=before.add(picture, MEAN_FRAMES))
        if added is None:
            return further, None
        samples = before.each**2
        looked_at = FORGETTING * (self.looked_at or samples) + samples
        comparisons = ComparisonSum.accumulate(self.comparisons, added)
        return further._replace(comparisons=comparisons, looked_at=looked_at), added

    def frames_of(self, each: int) -> float:
        """Number of frames, with so many samples along a cell, that the evidence is worth."""
        return max(1.0, self.looked_at / each**2)

    @property
    def newest(self) -> Observation:
        """The frame that was added last. Here and below: there must be one."""
        assert self.last is not None
        return self.last

    def newest_evidence(self, weigher: LightWeigher) -> Evidence | None:
        """The newest frame's evidence by itself; None where it is too little to tell bands."""
        return weigher.alone(self.newest, self.spec, self._since_s(self.newest))

    def count_from_origin(self, bands: Floats) -> Floats:
        """Bands (cells, P) of the newest frame alone as all frames count them: from row 0 of the first."""
        return turned(bands, self.spec.waves_hz, self._since_s(self.newest))

    def evidence(self, weigher: LightWeigher) -> Evidence | Rejected:
        """All evidence: the comparisons so far, and the mean picture read as one frame."""
        total, known = self._mean_picture_evidence(weigher), self.comparison_evidence()
        if known is None:
            return UNFIT if total is None else total
        if total is None:
            return known
        return known._replace(score=known.score + total.score, information=known.information + total.information)

    def comparison_evidence(self) -> Evidence | None:
        """The evidence of the frames after the first, whatever the panel looks like."""
        if (known := self.comparisons) is None:
            return None
        prior = band_prior(self.newest.frame, self.spec)
        return Evidence(score=known.score, information=known.information, prior=prior)

    def _since_s(self, seen: Observation) -> float:
        """From the origin to row 0 of a frame."""
        return (seen.frame.row0_readout_ns - self.origin_ns) * 1e-9

    def _mean(self, weigher: LightWeigher) -> Mean:
        """The frames on this grid; made of a first one when it is asked for, as most squares are seen once."""
        return self.mean or weigher.first(self.newest, self.spec, self._since_s(self.newest))

    def _mean_picture_evidence(self, weigher: LightWeigher) -> Evidence | None:
        """None where the mean has no bands that are worth reading, or tells none."""
        mean = self._mean(weigher)
        # A whole wave's cosine and sine have a power of 1 together, less where rows are averaged.
        waves, seen = len(mean.waves) // 2, int((mean.count > 0).sum())
        power = float(np.square(mean.waves).sum() / max(1, waves * seen))
        if self.comparisons is not None and power < MEAN_WAVE_POWER:
            return None
        return weigher.of_mean(self.newest, self.spec, mean)
