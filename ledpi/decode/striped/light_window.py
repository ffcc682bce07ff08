"""The light of a part of the picture, and what cells of either class would show in its rows."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from ledpi import shutter
from ledpi.decode.corners.sides import Points, areas
from ledpi.decode.striped.lattice import lattice_places, rough_lattice
from ledpi.records import BandShape, Floats, Frame, Mask, PanelSpec, Singles
from ledpi.tone import linear_light

FEWEST_PX = 70  # the side of a square that is looked at is averaged down to, as long as it has two times as many
WAVE_STEPS = 512  # of a period, in which its light is known
DARK, BRIGHT = 0.05, 0.9  # shares of the points that are darker than what is taken for dark, and for bright
MIN_CONTRAST = 3.0  # of bright to dark; a wall beside a panel's dark frame has less than a panel
INTERPOLATION = 1.0 / 6.0  # smooths by as much, of a row squared: the mean variance of a point between two pixels
LONGER = 0.1  # of the exposure, by which it is tried how bands change with it
SPARSE = 4  # pixels: so far apart those are that tell how dark it is around a panel


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """Linear light of a part of the picture, averaged down by whole pixels."""

    light: Singles  # (rows, columns)
    first: complex  # pixel of the picture in which the first of these has its centre
    shrink: int
    frame: Frame
    dark: float  # level of the darkest of it

    @classmethod
    def around(cls, frame: Frame, corners: Points, reach_px: float) -> Window:
        """What is up to `reach_px` around quads (S, 4)."""
        height, width = frame.pixels.shape
        side_px = min(float(np.sqrt(np.abs(areas(corners)).min())), max(width, height))  # a fit may have gone astray
        shrink = max(1, int(side_px // FEWEST_PX))
        x0, y0 = max(0, int(corners.real.min() - reach_px)), max(0, int(corners.imag.min() - reach_px))
        x1, y1 = min(width, int(corners.real.max() + reach_px) + 2), min(height, int(corners.imag.max() + reach_px) + 2)
        columns, rows = max(1, (x1 - x0) // shrink), max(1, (y1 - y0) // shrink)
        patch = frame.pixels[y0 : y0 + rows * shrink, x0 : x0 + columns * shrink]
        light = cv2.LUT(patch, linear_light(frame.transfer, mark_saturated=False))
        if shrink > 1:
            light = cv2.resize(light, (columns, rows), interpolation=cv2.INTER_AREA)
        some = light[::SPARSE, ::SPARSE].reshape(-1)
        dark = float(np.partition(some, at := int(DARK * len(some)))[at])
        return cls(light, complex(x0, y0) + (shrink - 1) / 2 * (1 + 1j), shrink, frame, dark)

    def within(self, points: Points) -> Points:
        """Pixels of the picture as pixels of this."""
        return np.asarray((points - self.first) / self.shrink)

    def in_picture(self, points: Points) -> Points:
        """The other way."""
        return np.asarray(points * self.shrink + self.first)

    def waves_of(self, spec: PanelSpec, shape: BandShape | None = None) -> ClassWaves:
        """What cells of a panel show in its rows."""
        return class_waves(spec, self.frame.exposure_us, self.frame.row_time_us, self.shrink, shape)

    def shown(self, waves: ClassWaves, phases: Floats) -> Singles:
        """(2, …, rows) share of its light that either class shows in each row, by its phases (2, …) in row 0."""
        rows = self.first.imag + self.shrink * np.arange(len(self.light))
        cycles = phases[..., None] + rows * waves.cycles_a_row.reshape(2, *[1] * phases.ndim)
        steps = (cycles * WAVE_STEPS).astype(np.int64) % WAVE_STEPS
        return np.stack([table[step] for table, step in zip(waves.tables, steps, strict=True)])


@dataclass(frozen=True, slots=True, eq=False)
class ClassWaves:
    """What cells of either class show, over a period."""

    tables: Singles  # (2, WAVE_STEPS) light of a row, over that of an exposure in which the lamp is on
    cycles_a_row: Floats  # (2,) of the picture
    share: float  # of the squares of a panel's light, that its bands bring: 0.38 where they are full
    least: float  # of the light of its brightest rows, that the class with the shallower bands always shows
    shapes: Singles  # (3, 2, WAVE_STEPS) `tables`, and their changes with the exposure's logarithm, and with smoothing


@lru_cache(maxsize=64)
def class_waves(
    spec: PanelSpec, exposure_us: float, row_time_us: float, shrink: int, shape: BandShape | None = None
) -> ClassWaves:
    """Of the means of `shrink` rows. Bands of another `shape` begin where those of the exposure do, in the middle."""
    both_hz = np.array([spec.black_hz, spec.white_hz])
    seen_us, smoothing = exposure_us, 0.0
    if shape is not None:
        seen_us, smoothing = shape.exposure_us, shape.smoothing_rows2 + INTERPOLATION * shrink**2

    def mean_waves(longer: float, smoothing_rows2: float) -> Floats:
        """(2, WAVE_STEPS)"""
        count, apart = shutter.mean_of_rows(shrink, smoothing_rows2)
        waves = np.empty((2, WAVE_STEPS))
        for wave, hz in zip(waves, (both_hz * 1e-6).tolist(), strict=True):
            exposed = seen_us * longer
            start = (np.arange(WAVE_STEPS) + 0.5) / WAVE_STEPS + 0.5 * hz * (exposure_us - exposed)
            around = (np.arange(count) - (count - 1) / 2) * apart * hz * row_time_us
            wave[:] = np.mean([shutter.exposure_weight(start + row, hz * exposed, spec.duty) for row in around], axis=0)
        return waves

    tables = mean_waves(1.0, smoothing)
    by_exposure = (mean_waves(1.0 + LONGER, smoothing) - mean_waves(1.0 - LONGER, smoothing)) / (2.0 * LONGER)
    by_smoothing = mean_waves(1.0, smoothing + 1.0) - tables
    share = float(np.mean([table.var() / np.square(table).mean() for table in tables]))
    brightest = max(table.max() for table in tables)
    least = max(float(table.min() / table.max()) for table in tables)
    shapes = np.array(np.stack([tables, by_exposure, by_smoothing]) / brightest, np.float32)
    return ClassWaves(shapes[0], both_hz * (row_time_us * 1e-6), share, least, shapes)


@lru_cache(maxsize=32)
def min_contrast(specs: tuple[PanelSpec, ...], exposure_us: float, *, anywhere: bool = False) -> float:
    """Of bright to dark light in a panel, at least: MIN_CONTRAST, or a third of what bands have.

    Those of the class whose bands are shallower: nearly all of its cells may be of that one; with what is `anywhere`
    near, those of the other.
    """
    chosen = max if anywhere else min
    return min(_contrast(chosen(_depths(spec, exposure_us))) for spec in specs)


def _depths(spec: PanelSpec, exposure_us: float) -> list[float]:
    return [min(0.5 * shutter.contrast(hz, exposure_us, spec.duty), 0.999) for hz in (spec.black_hz, spec.white_hz)]


def _contrast(depth: float) -> float:
    return min(MIN_CONTRAST, max(1.0, (1 + depth) / (1 - depth) / 3))


def have_contrast(frame: Frame, corners: Points, cells: int, specs: Sequence[PanelSpec]) -> Mask:
    """(N,) which quads (N, 4) in the picture show both bright and dark."""
    x, y, _ = lattice_places(corners, rough_lattice(cells))
    height, width = frame.pixels.shape
    codes = frame.pixels[y.astype(np.int64).clip(0, height - 1), x.astype(np.int64).clip(0, width - 1)]
    light = linear_light(frame.transfer, mark_saturated=False)[codes.reshape(len(corners), -1)]
    dark, bright = np.quantile(light, (DARK, BRIGHT), axis=1)
    contrasty: Mask = bright > min_contrast(tuple(specs), frame.exposure_us, anywhere=True) * dark
    return contrasty
