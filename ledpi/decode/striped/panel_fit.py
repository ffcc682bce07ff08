"""Corners, phases and gains of a panel at once: its whole picture fitted to the light, by least squares.

Where bands are deep a rim may be dark all along a side, and no edge is where light changes most. But of a panel whose
cells' classes are known all is known but a few numbers. At a place (u, v) of it, in cells from its first corner,

    light = d + Σ_c g_c · w_k(c)(y) · a_c(u) · a_c(v) · (1 + Σ_s b_s·exp(−((u − u_c)² + (v − v_c)²)/2s²))

with the darkness d; each cell's gain g; what its class shows in that row of the picture, known but for one phase for
each class (`shutter`), and for how steep and how smooth it is, as a tone curve or a scaler makes it; its open part a
between walls, as the lens blurs it; and the light that all cells have in common, brighter at their middles u_c, v_c,
in spots of width s, which the lens blurs, too. (Those of bare LEDs are four times as bright.)
Cells are even about these, so that the lattice, its walls, rim and spots, all tell where the corners are, in whichever
rows they shine. Of cells of one size the rim lies within the lattice's end, by half a wall; how far is another unknown,
and where it is too little to be told, none is taken. Light is sampled on a grid that goes with the corners, so that a
step of Gauss and Newton's, in all unknowns together, needs no slopes of the picture.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np

from ledpi.decode.corners.sides import Points
from ledpi.decode.striped import numpy_panel_fit
from ledpi.decode.striped.band_light import Bands
from ledpi.decode.striped.light_window import Window
from ledpi.kernels import panel_fit as kernel
from ledpi.kernels.library import compiled
from ledpi.records import BandShape, Floats, Intrinsics

# Where in the unknowns; last is the darkness.
BLUR, GAP, LONGER, SMOOTHER, PHASE, SPOT, BESIDE, RIM, GAIN = 8, 9, 10, 11, 12, 14, 16, 20, 21
MARGIN_PX = 1.5  # of the grid around the panel: further out is what may be beyond its frame
NEAR_BORDER_PX = np.arange(-2.0, 3.0)  # of the grid, about the borders of cells
INSIDE = 4  # points along a cell, between these
LEAST_PITCH_PX = 9.0  # of cells that are so large
# Points along a cell, for a first look. Further apart than in a cell of so many pixels, none may see where cells end:
# the long side of a panel that is turned away by 70° was not found.
ROUGHLY, MOST_ROUGH_PX = 6, 36.0
# What the unknowns are, and their deviations: blur of lens and pixel (logarithm), half of the gap at either side as a
# share of the cell, spots, light beside the panel, gains over what is bright, darkness.
BLUR_PX, BLUR_DEVIATION = 0.8, 0.4
GAP_USUAL, GAP_DEVIATION = 0.05, 0.04
# Of the cell: how far within the lattice's end the panel's rim is, which cells of one size have no half wall at.
RIM_DEVIATION = 0.03
# Logarithm of the exposure that makes bands as steep as they are seen, over the exposure (on photographs of a lamp 0.6
# of it does); and by how many rows, squared, they are smoothed beside that.
LONGER_DEVIATION, SMOOTHER_DEVIATION = 0.3, 1.0
SPOT_DEVIATION, BESIDE_DEVIATION, GAIN_DEVIATION, DARK_DEVIATION = 1.0, 0.2, 0.5, 0.1
# How often bands are given another shape, as long as it differs by more than that: in the exposure's logarithm, and in
# rows squared.
SHAPES, ALIKE_LONGER, ALIKE_SMOOTHER = 3, 0.1, 0.3
SATURATED = 0.999  # of full scale: such pixels say nothing


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """A panel as it fits best."""

    corners: Points  # (4,) in the picture
    sigma_px: float  # deviation of their coordinates, by what is left unexplained, if the rim is where it seems
    size_sigma_px: float  # and of how far all sides may be off outward alike, or inward
    rim_wall: float  # of the side: how far beyond it the lattice ends
    explained: float  # share of the light's squares
    phases: tuple[float, float]  # of either class's wave in the picture's row 0, in cycles
    shape: BandShape | None = None  # of its bands


def fitted(
    window: Window,
    corners: Points,
    bands: Bands,
    cells: int,
    intrinsics: Intrinsics | None,
    *,
    rounds: int,
    roughly: bool = False,
    shape: BandShape | None = None,
) -> Fit | None:
    """From corners (4,) in the picture that are off by a few percent of the side; None where it comes to nothing.

    `bands`: of about the panel's phases and classes. `shape`: what they look like, to begin with;
    without, it is what the exposure makes of them.
    """
    lens = intrinsics if intrinsics is not None and any(intrinsics.distortion) else None
    at = corners.copy()
    pitch_px = pitches(corners, cells) / window.shrink
    waves = window.waves_of(bands.spec, shape)
    unknown, prior = _beforehand(cells)
    unknown = unknown.copy()
    unknown[PHASE : PHASE + 2] = bands.phases
    fit = (kernel.fit_panel if compiled() else numpy_panel_fit.fit_panel)(
        window.light,
        window.first,
        window.shrink,
        lens,
        cells,
        bands.white,
        waves.tables if shape is None else waves.shapes,
        waves.cycles_a_row,
        (bands.dark, bands.bright, SATURATED),
        _grid(cells, round(float(pitch_px.min()), 1), roughly and float(pitch_px.max()) < MOST_ROUGH_PX),
        pitch_px,
        rounds,
        prior,
        at,
        unknown,
    )
    if fit is None or not np.isfinite(at).all():
        return None
    explained, sigma_px, size_sigma_px = fit
    rim = float(unknown[RIM])
    longer, smoother, of_black, of_white = unknown[LONGER:SPOT].tolist()
    seen = None if shape is None else _reshaped(shape, longer, smoother)
    return Fit(at, sigma_px, size_sigma_px, rim / (cells - 2 * rim), explained, (of_black, of_white), seen)


def fitted_in_shape(
    window: Window,
    corners: Points,
    bands: Bands,
    cells: int,
    intrinsics: Intrinsics | None,
    *,
    rounds: int,
    is_one: Callable[[Fit], bool],
    shape: BandShape | None = None,
) -> Fit | None:
    """The same, with the shape that bands have: one that is not the exposure's is begun with anew, as it is not linear.

    `is_one`: whether it is worth that. `shape`: what they look like, if that is known.
    """
    shape = shape or BandShape(exposure_us=window.frame.exposure_us, smoothing_rows2=0.0)
    for _ in range(SHAPES):
        fit = fitted(window, corners, bands, cells, intrinsics, rounds=rounds, shape=shape)
        if fit is None or fit.shape is None or not is_one(fit) or _are_alike(shape, fit.shape):
            break
        corners, shape = fit.corners, fit.shape
    return fit


def _are_alike(a: BandShape, b: BandShape) -> bool:
    longer = math.log(a.exposure_us / b.exposure_us)
    return abs(longer) < ALIKE_LONGER and abs(a.smoothing_rows2 - b.smoothing_rows2) < ALIKE_SMOOTHER


def _reshaped(shape: BandShape, longer: float, smoother: float) -> BandShape:
    return BandShape(
        exposure_us=shape.exposure_us * math.exp(longer), smoothing_rows2=max(0.0, shape.smoothing_rows2 + smoother)
    )


def pitches(corners: Points, cells: int) -> Floats:
    """(2,) width and height of a cell amid corners (4,), in pixels."""
    c0, c1, c2, c3 = corners.tolist()
    return np.array([abs(c1 + c2 - c0 - c3), abs(c3 + c2 - c0 - c1)]) / (2 * cells)


@lru_cache(maxsize=256)
def _grid(cells: int, pitch_px: float, roughly: bool) -> Floats:
    """(places,) along a side, in cells from its first corner: densest where light changes, at the borders of cells."""
    if roughly or pitch_px < LEAST_PITCH_PX:
        each = max(3, min(round(pitch_px), ROUGHLY if roughly else 9))
        margin = max(1, math.ceil(MARGIN_PX * each / max(pitch_px, 1.0)))
        margin = min(margin, (kernel.MOST_ALONG - cells * each) // 2)
        return (np.arange(-margin, cells * each + margin) + 0.5) / each
    borders = np.arange(cells + 1)[:, None] + NEAR_BORDER_PX / pitch_px
    first = (NEAR_BORDER_PX[-1] + 1) / pitch_px
    inside = np.arange(cells)[:, None] + np.linspace(first, 1 - first, INSIDE)
    grid = np.sort(np.concatenate([borders, inside], axis=None))
    return grid[(grid > -MARGIN_PX / pitch_px) & (grid < cells + MARGIN_PX / pitch_px)]


@cache
def _beforehand(cells: int) -> tuple[Floats, Floats]:
    """(unknowns,) to begin with, and (2, unknowns): what is expected, and one over its variance; 0: nothing is."""
    mean, deviation = np.zeros((2, GAIN + cells * cells + 1))
    deviation[:] = math.inf
    mean[BLUR], deviation[BLUR] = math.log(BLUR_PX), BLUR_DEVIATION
    mean[GAP], deviation[GAP] = GAP_USUAL, GAP_DEVIATION
    deviation[LONGER], deviation[SMOOTHER] = LONGER_DEVIATION, SMOOTHER_DEVIATION
    deviation[SPOT:BESIDE], deviation[BESIDE:RIM] = SPOT_DEVIATION, BESIDE_DEVIATION
    deviation[RIM] = RIM_DEVIATION
    mean[GAIN:-1], deviation[GAIN:-1] = 1.0, GAIN_DEVIATION
    deviation[-1] = DARK_DEVIATION
    return mean, np.stack([mean, deviation**-2])
