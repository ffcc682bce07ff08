"""What several frames of one panel say together.

After the first frame a panel's static picture is known, cell by cell, so a further frame is compared with the mean
of those before it: what differs are the bands. Each comparison is independent of all earlier ones (Helmert's
contrasts), and the oscillators are stable, so its evidence adds to theirs in one phase: the wave of the new frame
less the mean wave of the old ones. Where the phases stand still from frame to frame the comparisons say nothing;
then the mean picture, read as a single frame of less noise, still says what one frame would have said, and more.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ledpi.decode.cells import CellSamples, Lattice, Singles
from ledpi.decode.evidence import (
    Doubles,
    Evidence,
    Normal,
    band_prior,
    class_waves,
    evidence_from,
    picture_slopes,
)
from ledpi.decode.single_frame import single_evidence
from ledpi.decode.unlit import without_unlit
from ledpi.records import Frame, PanelSpec, Rejected

# Old evidence fades, as oscillators drift and a wrong turn must be mended: to a third in 30 frames, half a second.
FORGETTING = 0.97
# Frames that the mean picture remembers: a moving camera changes how a panel looks.
MEAN_FRAMES = 16.0
# Below this share of a wave's power the mean picture has no bands left that are worth reading.
MEAN_WAVE_POWER = 0.02


@dataclass(frozen=True, slots=True, kw_only=True)
class Known:
    """The mean picture of some frames, and what is in it of the class's waves."""

    lattice: Lattice
    origin_ns: int  # row 0's read-out of the first frame, from which phases count
    picture: Singles  # (cells, points)
    count: Singles  # (cells, points) frames that showed it
    mean_waves: Singles  # (P, cells, points)


class PanelMemory:
    """The frames of one panel so far, for one pair of frequencies. Frames come in order; corners keep their order."""

    def __init__(self, spec: PanelSpec) -> None:
        self.spec = spec
        self.frames = 0
        self.lattice: Lattice | None = None
        self._origin_ns = 0
        self._score: Doubles | None = None
        self._information: Doubles | None = None
        self._left = 0.0

    def add(self, samples: CellSamples, frame: Frame) -> Evidence | None:
        """Takes a frame in. Returns what it adds by comparison with those before, if anything."""
        if self.frames == 0:
            self._origin_ns = frame.row0_readout_ns
        since_s = (frame.row0_readout_ns - self._origin_ns) * 1e-9
        waves = class_waves(samples, frame, self.spec, since_s)
        valid = np.ones(samples.light.shape, np.float32) if samples.valid is None else samples.valid.astype(np.float32)
        self._samples, self._frame = samples, frame
        compared = None
        if self.frames == 0 or self.lattice is not samples.lattice:
            # A new lattice: what was learnt of the bands stays, the picture does not.
            self.lattice = samples.lattice
            self._count, self._picture, self._mean_waves = valid, samples.light / samples.light.mean(), waves
        else:
            compared = self._compare(samples, frame, waves, valid)
        self.frames += 1
        return compared

    def known(self) -> Known:
        """What there is to compare a further frame with."""
        return Known(
            lattice=self._samples.lattice,
            origin_ns=self._origin_ns,
            picture=np.maximum(self._picture, np.float32(0.02)),
            count=self._count,
            mean_waves=self._mean_waves,
        )

    @property
    def mean_waves(self) -> Singles:
        """(P, cells, points): cosine and sine of each wave as the mean picture has them; of one frame, its own."""
        return self._mean_waves

    @property
    def newest(self) -> tuple[CellSamples, Frame]:
        """The frame that was added last."""
        return self._samples, self._frame

    def in_its_time(self, bands: Doubles) -> Doubles:
        """Bands (cells, P) of the newest frame alone as all frames count them: from row 0 of the first."""
        out = np.empty_like(bands)
        since_s = (self._frame.row0_readout_ns - self._origin_ns) * 1e-9
        for k, hz in enumerate(self.spec.waves_hz):
            angle = 2 * math.pi * ((hz * since_s) % 1.0)
            c, s = math.cos(angle), math.sin(angle)
            out[:, 2 * k : 2 * k + 2] = bands[:, 2 * k : 2 * k + 2] @ np.array([[c, s], [-s, c]])
        return out

    def evidence(self) -> Evidence | Rejected:
        """All that is known: the comparisons so far, and the mean picture read as one frame."""
        total = self._of_mean_picture()
        if self._score is None or self._information is None:
            return total
        known = Evidence(
            score=self._score,
            information=self._information,
            prior=band_prior(self._frame, self.spec),
            left=self._left,
        )
        if isinstance(total, Rejected):
            return known
        return replace(known, score=known.score + total.score, information=known.information + total.information)

    def _of_mean_picture(self) -> Evidence | Rejected:
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
        mean = CellSamples(
            lattice=self._samples.lattice,
            light=self._picture,
            valid=None if seen.all() else seen,
            rows=self._samples.rows,
            averaged=self._samples.averaged,
            cell_px=self._samples.cell_px,
            independence=self._samples.independence,
        )
        return single_evidence(mean, self._frame, self.spec, self._mean_waves)

    def _compare(self, samples: CellSamples, frame: Frame, waves: Singles, valid: Singles) -> Evidence | None:
        both = valid * (self._count > 0)
        picture = np.maximum(self._picture, np.float32(0.02))
        scale = float((samples.light * picture * both).sum() / max(1e-9, float((picture * picture * both).sum())))
        light = samples.light / np.float32(max(scale, 1e-9))
        residual = (light / picture - np.float32(1)) * both
        # The mean of n frames has a noise of its own: the difference has the variance 1 + 1/n.
        weight = picture * both * (self._count / (self._count + 1))
        weight /= max(float(weight.mean()), 1e-9)
        new_waves = (waves - self._mean_waves) * both
        added = self._evidence(residual, weight, new_waves, picture, samples, frame)
        if isinstance(added, Evidence):
            before = 0.0 if self._score is None else FORGETTING * self._score
            known = 0.0 if self._information is None else FORGETTING * self._information
            self._score, self._information = before + added.score, known + added.information
            self._left = FORGETTING * self._left + added.left
        self._remember(light, waves, valid)
        return added if isinstance(added, Evidence) else None

    def _evidence(
        self,
        residual: Singles,
        weight: Singles,
        waves: Singles,
        picture: Singles,
        samples: CellSamples,
        frame: Frame,
    ) -> Evidence | Rejected:
        cells, points = residual.shape
        parameters = len(waves)
        root = np.sqrt(weight)
        seen = (residual * root).reshape(-1)
        shapes = (waves * root).transpose(1, 0, 2)  # (cells, P, points)
        gain_and_slopes = np.concatenate([root[None], picture_slopes(picture, samples.lattice) * root])
        nuisances = gain_and_slopes.reshape(-1, cells * points)
        information = np.zeros((cells, parameters, cells, parameters))
        each = np.arange(cells)
        information[each, :, each, :] = np.matmul(shapes, shapes.transpose(0, 2, 1))
        both = np.matmul(shapes, gain_and_slopes.transpose(1, 2, 0)).reshape(cells * parameters, -1)
        normal = Normal(
            of_nuisances=(nuisances @ nuisances.T).astype(np.float64),
            of_both=both.T.astype(np.float64),
            of_bands=information.reshape(cells * parameters, -1),
            nuisances=(nuisances @ seen).astype(np.float64),
            bands=np.matmul(shapes, seen.reshape(cells, points, 1)).reshape(-1).astype(np.float64),
            squares=float(seen @ seen),
            freedom=int((weight > 0).sum()) - len(nuisances) - cells * parameters,
        )
        evidence = evidence_from(normal, samples, frame, self.spec)
        return evidence if isinstance(evidence, Rejected) else without_unlit(evidence, samples)

    def _remember(self, light: Singles, waves: Singles, valid: Singles) -> None:
        total = self._count + valid
        share = np.where(valid > 0, 1.0 / np.maximum(total, 1.0), 0.0).astype(np.float32)
        self._picture = self._picture + (light - self._picture) * share
        self._mean_waves = self._mean_waves + (waves - self._mean_waves) * share
        self._count = np.minimum(total, np.float32(MEAN_FRAMES))
