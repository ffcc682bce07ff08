"""Weighs the light of a fitted panel for the bands in each of its cells, by the equation that the fit solves.

In C (decode/model/panel_evidence.c). Of a frame alone, or the mean of several, all that the fit does not know is
eliminated: corners, blur, walls, gains, and one free profile that all cells share. A frame that is compared with the
mean of those before differs from it by its bands, by what moves, and by the light's level, so the static picture need
not be known.
"""

from __future__ import annotations

import cmath
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ledpi.core.lens import bending_lens_of
from ledpi.core.library import NONE, lib
from ledpi.core.records import Floats, Intrinsics, PanelSpec, Singles
from ledpi.decode.evidence.cells import SAME_LATTICE, Observation
from ledpi.decode.evidence.evidence import UNLIT, Evidence, erase_cells
from ledpi.decode.evidence.waves import LEAST_DEPTH, band_prior
from ledpi.decode.model.fit import pitch_px_of, solver_view
from ledpi.decode.model.light import fundamentals, waves
from ledpi.decode.model.panel import Weigher
from ledpi.decode.model.prior import COMMON, OWN, built_in, prior

# Samples along a cell, one a pixel but for these: fewer tell no bands from gains. Of several frames, which add up, each
# may have fewer; and of a panel that is clear a third of these: still two for each unknown.
FEWEST_EACH, MOST_EACH_OF_SEVERAL, THIN = 3, 12, 3
MOST_EACH: int = lib.LEDPI_MOST_EACH
# Of a frame by itself no sample is in a pixel that a border may cross: within half of its diagonal. How dark that is
# hangs on where a wall's edge crosses it, in each cell by itself. Half of a small cell is left.
WALL_PX, MOST_INSET = math.sqrt(0.5), 0.25
EACH_LOOK, EACH_SAMPLE = 3000, 2  # places that a look costs, in those of a fit, and that each of its samples does


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Mean:
    """The light of some frames of one panel on one grid, and what their waves were there."""

    light: Singles  # (lines, lines) over the panel's own
    count: Singles  # (lines, lines) how many frames tell it
    waves: Singles  # (P, lines, lines) cosine and sine of each wave
    built: Floats  # what does not change from frame to frame, as the unknowns have it

    @property
    def each(self) -> int:
        """Samples along a cell."""
        return len(self.light) // self.cells

    @property
    def cells(self) -> int:
        """Along a side."""
        return math.isqrt((len(self.built) - COMMON) // OWN)

    @property
    def decimated(self) -> Mean:
        """The same on every third line, if it has as many as there are: thirds have their middles on lines of these."""
        if self.each < MOST_EACH_OF_SEVERAL:
            return self
        every = slice(THIN // 2, None, THIN)
        light, count, waves = (
            np.ascontiguousarray(of[..., every, every]) for of in (self.light, self.count, self.waves)
        )
        return Mean(light=light, count=count, waves=waves, built=self.built)

    def add(self, frame: Mean, most_frames: float) -> Mean:
        """The mean with a further frame; it remembers `most_frames`."""
        total = self.count + frame.count
        share = np.where(frame.count > 0, 1.0 / np.maximum(total, 1.0), 0.0).astype(np.float32)
        return Mean(
            light=self.light + (frame.light - self.light) * share,
            count=np.minimum(total, np.float32(most_frames)),
            waves=self.waves + (frame.waves - self.waves) * share,
            built=frame.built,
        )


class LightWeigher:
    """Weighs the light of panels of `cells` × `cells`, in room that it keeps."""

    def __init__(self, cells: int, intrinsics: Intrinsics | None) -> None:
        self.cells, self._intrinsics = cells, intrinsics
        self._lens = bending_lens_of(intrinsics)
        self._weigher = Weigher()
        self.sampled = 0  # places that all looks so far have cost

    def alone(self, seen: Observation, spec: PanelSpec, since_s: float = 0.0) -> Evidence | None:
        """The evidence of one frame; None where it is too little to tell bands.

        `since_s`: from the moment that bands are counted from to its row 0.
        """
        return self._weigh(seen, spec, since_s, self._each(seen), None, wall_px=WALL_PX)[1]

    def with_harmonics(self, seen: Observation, spec: PanelSpec, bands: Floats) -> Evidence | None:
        """The evidence of one frame, where waves have the harmonics that an exposure leaves of square ones.

        `bands` (P,) say in which phases: in row 0, as those of `alone`.
        """
        phases, turns = [0.0, 0.0], np.empty(len(bands), np.float32)
        tables = fundamentals(spec, seen.frame.exposure_us, seen.frame.row_time_us, seen.window.shrink)
        for k, (fundamental, row_average) in enumerate(
            zip(tables[: len(bands) // 2], _row_average(seen, spec), strict=False)
        ):
            angle = cmath.phase(complex(*bands[2 * k : 2 * k + 2]))
            turned = cmath.rect(row_average / max(abs(fundamental), LEAST_DEPTH), angle)
            phases[k] = (cmath.phase(fundamental) - angle) / math.tau
            turns[2 * k : 2 * k + 2] = turned.real, turned.imag
        return self._weigh(seen, spec, 0.0, self._each(seen), None, wall_px=WALL_PX, phases=phases, turns=turns)[1]

    def first(self, seen: Observation, spec: PanelSpec, since_s: float) -> Mean:
        """A first frame to compare others with; `since_s` as above."""
        return self._weigh(seen, spec, since_s, self._each(seen, MOST_EACH_OF_SEVERAL), None)[0]

    def compare(self, seen: Observation, spec: PanelSpec, since_s: float, mean: Mean) -> tuple[Mean, Evidence | None]:
        """A further frame, shifted to where the mean is, and the evidence of how it differs from that."""
        frames = float(mean.count.max())
        built = mean.built + (seen.unknown - mean.built) / (frames + 1.0)
        return self._weigh(seen, spec, since_s, mean.each, mean, built=built, compared=True)

    def of_mean(self, seen: Observation, spec: PanelSpec, mean: Mean) -> Evidence | None:
        """The evidence of the mean picture, read as one frame; `seen` is its newest."""
        return self._weigh(seen, spec, 0.0, mean.each, mean, built=mean.built)[1]

    def is_comparable(self, seen: Observation, mean: Mean, *, decimate: bool) -> bool:
        """Tells whether the mean's grid still suits the panel's size in the picture; `decimate`: it may be thin."""
        each = self._each(seen, MOST_EACH_OF_SEVERAL)
        suits = (each, self._each(seen, MOST_EACH_OF_SEVERAL // THIN)) if decimate else (each,)
        return any(abs(of - mean.each) <= max(1.0, SAME_LATTICE * mean.each) for of in suits)

    def _each(self, seen: Observation, most: int = MOST_EACH) -> int:
        pitch = pitch_px_of(seen.lattice_px, self.cells * seen.window.shrink)
        return min(most, max(FEWEST_EACH, round(math.sqrt(pitch[0] * pitch[1]))))

    def _weigh(
        self,
        seen: Observation,
        spec: PanelSpec,
        since_s: float,
        each: int,
        mean: Mean | None,
        *,
        built: Floats | None = None,
        compared: bool = False,
        wall_px: float = 0.0,
        phases: Sequence[float] = (0.0, 0.0),
        turns: Singles | None = None,
    ) -> tuple[Mean, Evidence | None]:
        cells, count, frame, window = self.cells, len(spec.waves_hz), seen.frame, seen.window
        lines, steps_px = _lines(cells, each, pitch_px_of(seen.lattice_px, cells * window.shrink), wall_px)
        across, down = (round(max(1.0, min(each, each * step)), 1) for step in steps_px)
        unknown = seen.unknown if built is None else np.where(built_in(cells), built, seen.unknown)
        shape, parameters = (len(lines), len(lines)), 2 * count
        light, valid, wave = (np.zeros(of, np.float32) for of in (shape, shape, (parameters, *shape)))
        score, information = np.empty((cells**2, parameters)), np.empty((cells**2, parameters) * 2)
        found, weighed = self._weigher.weigh(
            {
                **solver_view(window, self._intrinsics, self._lens),
                "cells": cells,
                "waves": waves(spec, frame.exposure_us, frame.row_time_us, window.shrink),
                "cycles_a_row": tuple(hz * frame.row_time_us * 1e-6 for hz in (spec.black_hz, spec.white_hz)),
                "lines": len(lines),
                "along": lines,
                "prior": prior(cells, (across, down), frame.exposure_us, even=False, faint=True, compared=compared),
                "banded": True,
                "corners": seen.lattice_px.reshape(-1).tolist(),
                "unknown": unknown,
            },
            waves=count,
            cycles_before=[math.fmod(hz * since_s, 1.0) for hz in (spec.black_hz, spec.white_hz)],
            row_average=_row_average(seen, spec),
            step_px=steps_px,
            phases=phases,
            turns=NONE if turns is None else turns,
            mean_light=NONE if mean is None else mean.light,
            mean_count=NONE if mean is None else mean.count,
            mean_wave=NONE if mean is None else mean.waves,
            compared=compared,
            light=light,
            valid=valid,
            wave=wave,
            score=score,
            information=information,
        )
        self.sampled += EACH_LOOK + EACH_SAMPLE * light.size
        picture = Mean(light=light, count=valid, waves=wave, built=unknown)
        return picture, self._evidence(seen, spec, unknown, score, information, weighed) if found else None

    def _evidence(
        self, seen: Observation, spec: PanelSpec, unknown: Floats, score: Floats, information: Floats, weighed: Any
    ) -> Evidence:
        gains = unknown[COMMON::OWN]
        evidence = Evidence(
            score=score / weighed.inflation,
            information=information / weighed.inflation,
            prior=band_prior(seen.frame, spec),
        )
        return erase_cells(evidence, np.asarray(gains < UNLIT * gains.mean()))


def _row_average(seen: Observation, spec: PanelSpec) -> list[float]:
    """To how much of black's wave, and of white's, the mean of as many rows lowers it as a window averages."""
    row_s = seen.frame.row_time_us * 1e-6
    angles = (math.pi * hz * seen.window.shrink * row_s for hz in (spec.black_hz, spec.white_hz))
    return [math.sin(angle) / angle for angle in angles]


def _lines(cells: int, each: int, pitch_px: tuple[float, float], wall_px: float) -> tuple[Floats, list[float]]:
    """(lines,) of a grid in cells, `each` a cell, so far from its borders; and the steps across and down, in pixels."""
    inset = min(MOST_INSET, wall_px / math.sqrt(pitch_px[0] * pitch_px[1]))
    step = (1.0 - 2.0 * inset) / each
    lines = np.arange(cells)[:, None] + inset + step * (np.arange(each) + 0.5)
    return lines.reshape(-1), [step * pitch for pitch in pitch_px]
