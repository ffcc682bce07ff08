"""The waves of a panel's classes as an exposure leaves them: how deep bands may be, and what each is in every sample.

Bands are given by a cosine and a sine of each wave (`classes` says which cells show it): of sinusoids, or of the
fundamentals of square waves.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from ledpi.core import shutter
from ledpi.core.records import Floats, Frame, PanelSpec

MAX_ROOM_LIGHT = 2.0  # of a panel's own in the mean of its bands: a brighter room hides the deepest
LEAST_DEPTH = 1e-6  # that is counted with: whole cycles in an exposure leave none
# Bands that are deeper, or one of whose harmonics is more than this share of the fundamental, are no sinusoids. (The
# third is a tenth of it at 10 ms, and a third where the fundamental nearly vanishes, as it does at 800 µs.)
FAINT_DEPTH, MOST_HARMONIC = 0.1, 0.2


def band_depth(frame: Frame, specs: Sequence[PanelSpec]) -> float:
    """Returns that of the deepest bands that this exposure leaves of any of these panels, over the mean light."""
    return max(shutter.contrast(hz, frame.exposure_us, spec.duty) for spec in specs for hz in spec.waves_hz) / 2.0


def dimmest(frame: Frame, specs: Sequence[PanelSpec]) -> float:
    """Light where the deepest of these bands are darkest over that where they are brightest, in the brightest room."""
    lit, depth = 1.0 + MAX_ROOM_LIGHT, band_depth(frame, specs)
    return (lit - depth) / (lit + depth)


def band_prior(frame: Frame, spec: PanelSpec) -> Floats:
    """(P,) variance of each wave's cosine and sine: a depth whose mean square is the expected one, in any phase."""
    return _prior_of(frame.exposure_us, spec.waves_hz, spec.duty).copy()


@lru_cache(maxsize=64)  # exposures, of an automatic one too, are whole rows
def _prior_of(exposure_us: float, waves_hz: tuple[float, ...], duty: float) -> Floats:
    amplitude = [shutter.harmonic_amplitude(1, hz, exposure_us, duty) for hz in waves_hz]
    return np.repeat(np.square(np.maximum(amplitude, LEAST_DEPTH)), 2) / 2


@lru_cache(maxsize=64)
def are_sinusoids(exposure_us: float, spec: PanelSpec) -> bool:
    """Tells whether the exposure leaves so little else that all that a model by sinusoids leaves open is noise."""
    first, *further = (
        max(shutter.harmonic_amplitude(order, hz, exposure_us, spec.duty) for hz in spec.waves_hz)
        for order in (1, 2, 3)
    )
    return first <= FAINT_DEPTH and max(further) <= MOST_HARMONIC * first


def rotated(bands: Floats, angles: Sequence[float]) -> Floats:
    """Bands (cells, P), cosine and sine of each wave, once that is shifted by its angle."""
    out = np.empty_like(bands)
    for k, angle in enumerate(angles):
        c, s = math.cos(angle), math.sin(angle)
        out[:, 2 * k : 2 * k + 2] = bands[:, 2 * k : 2 * k + 2] @ np.array([[c, s], [-s, c]])
    return out


def turned(bands: Floats, waves_hz: tuple[float, ...], earlier_s: float) -> Floats:
    """Bands (cells, P) as counted from a moment that is so much earlier."""
    return rotated(bands, [2 * math.pi * ((hz * earlier_s) % 1.0) for hz in waves_hz])
