"""The bands that a first pass has estimated: where a second pass, by the exact waveform, is linearised."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ledpi.core.records import Floats, Frame, Mask, PanelSpec, Singles
from ledpi.decode.evidence.cells import CellSamples
from ledpi.decode.evidence.classes import band_shares, wave_shares
from ledpi.decode.evidence.waves import rotated, square_waves

# Of full bands the darkest part: there is stray light, read noise, and a waveform that is not quite a square wave's, so
# that the dark says less of a cell than its few photons would.
DARKEST = 0.1


@dataclass(frozen=True, slots=True, kw_only=True)
class BandEstimate:
    """Bands as a first pass has estimated them."""

    phases: tuple[float, ...]  # of each wave's fundamental; `waves` begin there
    bands: Floats  # (cells, P), by these waves
    waves: Singles  # (P, cells, points): what to measure them by
    white: Mask  # (cells,)
    light: Singles  # (2, cells, points): what the bands of either class make of an even light

    def band_light(self) -> Singles:
        """(cells, points): the light of each cell under its bands, if it were even without them."""
        return np.asarray(np.where(self.white[:, None], self.light[1], self.light[0]), np.float32)

    def restore_phases(self, bands: Floats) -> Floats:
        """Bands (cells, P) by these waves, as cosine and sine."""
        return rotated(bands, self.phases)


def estimate_bands(samples: CellSamples, frame: Frame, spec: PanelSpec, white: Mask, bands: Floats) -> BandEstimate:
    """The estimate as square waves seen through the exposure.

    The estimated sinusoids are `bands` (P,), in cells of which these are `white` (cells,). Phase and depth of a square
    wave are those of its fundamental. The waves of the estimate are its slopes: by depth, and by phase. So a small
    change of either is measured by the exact waveform, harmonics and all.
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
    return BandEstimate(
        phases=tuple(phases),
        bands=band_shares(white.astype(np.float64), len(bands)) * turned,
        waves=waves,
        white=white,
        light=np.maximum(light, np.float32(DARKEST)),
    )
