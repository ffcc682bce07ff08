"""Gives a fit the light of a part of the picture, and what the exposure leaves there of either class's wave."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ledpi.core.geometry import quad_side
from ledpi.core.library import ffi, lib, pointer
from ledpi.core.records import Floats, Frame, PanelSpec, Singles, read_only
from ledpi.core.shutter import linear_light, row_weights

FEWEST_PX = 70  # a square of twice as many pixels along its side is averaged down: its light abounds
FARTHEST = 8  # sizes of the picture: corners further out are none
WAVE_STEPS: int = lib.WAVE_STEPS  # of a period


@dataclass(frozen=True, slots=True, eq=False)
class Window:
    """Linear light of a part of the picture, averaged down by whole pixels."""

    light: Singles  # (rows, columns), 0..1
    first: tuple[float, float]  # x, y of the first one's centre in the picture
    shrink: int  # pixels of the picture, along a side
    picture: tuple[int, int]  # its rows and columns
    dark: float  # levels of what is dark there, and of the square's own light
    bright: float
    dimmed: float  # level of what is dark within the square, as in bands

    @classmethod
    def crop(cls, frame: Frame, corners_px: Floats, reach: float, fewest_px: float = FEWEST_PX) -> Window | None:
        """A square (4, 2) with `reach` of its side, and three pixels, around it; None where it shows no light.

        `fewest_px`: of its side, how many are left where it is averaged down.
        """
        side_px = min(quad_side(corners_px.tolist()), max(frame.pixels.shape))
        window = cls.cut(frame, corners_px, reach, max(1, int(side_px // fewest_px)))
        return window if window is not None and window.bright > window.dark else None

    @classmethod
    def cut(cls, frame: Frame, corners_px: Floats, reach: float, shrink: int) -> Window | None:
        """The same averaged down by so many pixels, whatever it shows; None where too little is in the picture."""
        (height, width), corners = frame.pixels.shape, corners_px.tolist()
        across, down = zip(*corners, strict=True)
        if not all(abs(at) < FARTHEST * max(height, width) for at in across + down):
            return None
        reach_px = reach * quad_side(corners) + 3.0
        x, y = max(0, int(min(across) - reach_px)), max(0, int(min(down) - reach_px))
        columns = (min(width, int(max(across) + reach_px) + 2) - x) // shrink
        rows = (min(height, int(max(down) + reach_px) + 2) - y) // shrink
        if min(columns, rows) < 2:
            return None
        light = np.empty((rows, columns), np.float32)
        linear = linear_light(frame.transfer, mark_saturated=False)
        part = (pointer(frame.pixels), width, x, y, rows, columns, shrink, pointer(linear))
        put = ffi.new("PanelWindow *", (*part, [*itertools.chain(*corners)], pointer(light)))
        if not lib.ledpi_panel_window(put):
            return None
        first = (x + (shrink - 1) / 2, y + (shrink - 1) / 2)
        return cls(light, first, shrink, (height, width), put.dark, put.bright, put.dimmed)


@lru_cache(maxsize=64)
def waves(spec: PanelSpec, exposure_us: float, row_time_us: float, shrink: int) -> Singles:
    """(2, WAVE_STEPS) what a row shows of black's and white's wave over a period, less its mean, over its mean.

    Means of `shrink` rows; the phase is that of the wave where the row's exposure begins.
    """
    out = np.empty((2, WAVE_STEPS), np.float32)
    steps = (np.arange(WAVE_STEPS) + 0.5) / WAVE_STEPS
    for wave, hz in zip(out, (spec.black_hz, spec.white_hz), strict=True):
        rows = np.arange(shrink) - (shrink - 1) / 2 + steps[:, None] / (hz * row_time_us * 1e-6)
        light = row_weights(
            rows, frequency_hz=hz, phase_cycles=0.0, duty=spec.duty, exposure_us=exposure_us, row_time_us=row_time_us
        ).mean(axis=1)
        wave[:] = light / light.mean() - 1.0
    return read_only(out)


@lru_cache(maxsize=64)
def fundamentals(spec: PanelSpec, exposure_us: float, row_time_us: float, shrink: int) -> tuple[complex, ...]:
    """The fundamental of black's `waves`, and of white's: its cosine, and its sine as the imaginary part."""
    of_tables = np.fft.rfft(waves(spec, exposure_us, row_time_us, shrink))[:, 1].conj() * (2.0 / WAVE_STEPS)
    return tuple(of_tables.tolist())


NEAR_BORDER = np.arange(-2.0, 3.0)  # pixels, of the lines about the borders of cells, where light changes most
FINE_PX = 9.0  # width of a cell from which on lines are not evenly spread, one a pixel
COARSE = 5  # lines along a cell, for the coarse fit
INSIDE = (4, 7)  # along the rest of a cell, between borders: fewest, most
MARGIN_PX = 1.5  # further out is what may be beyond a panel's frame


@lru_cache(maxsize=256)
def grid(cells: int, pitch_px: float, *, coarse: bool) -> Floats:
    """(lines,) of a grid over the panel, in cells from its first corner; `pitch_px` a cell's width in the window."""
    if coarse or pitch_px < FINE_PX:
        each = max(3, min(round(pitch_px), COARSE if coarse else int(FINE_PX)))
        beyond = max(1, math.ceil(MARGIN_PX * each / max(pitch_px, 1.0)))
        return read_only((np.arange(-beyond, cells * each + beyond) + 0.5) / each)
    borders = np.arange(cells + 1)[:, None] + NEAR_BORDER / pitch_px
    first = (NEAR_BORDER[-1] + 1.0) / pitch_px
    count = max(INSIDE[0], min(INSIDE[1], int(pitch_px / 4)))
    inside = np.arange(cells)[:, None] + np.linspace(first, 1.0 - first, count)
    lines = np.sort(np.concatenate([borders, inside], axis=None))
    margin = MARGIN_PX / pitch_px
    return read_only(lines[(lines > -margin) & (lines < cells + margin)])
