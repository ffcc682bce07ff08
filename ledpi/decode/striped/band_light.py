"""What the light around a square says of a lattice of blinking cells there, whose word is not known.

Where exposures are short a cell of class k shows its light times w_k(y), which is known but for one phase: bright in
some rows, dark in others. So a pixel of relative light n is likelier as a lit part of such a cell than as darkness by

    gain_k = e·(2n − e),    e = EVEN·w_k(y)        (n² − (n − e)², of a normal distribution with one variance)

which is positive where it is bright in rows in which the class is, and negative where it is dark there. Around a panel
it is not dark, though: n and e are counted from the usual light there, so that what is not brighter than that gains
nothing. A lattice in some place explains the sum over its cells of what either class gains in each; the walls between
cells shine with whatever share λ of that explains them best: λe·(2n − λe). No border between cells, no rim needs to be
seen for that, and all that are seen add to it.

Which class a cell is of is told by the shape of its bands, not by their level: its gain is its own, and the profile of
cells is what all of them show.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ledpi.decode.corners.sides import Points, areas
from ledpi.decode.striped.lattice import Lattice, lattice_beside, lattice_places, unlike_a_square
from ledpi.decode.striped.light_window import BRIGHT, DARK, Window, class_waves, min_contrast
from ledpi.kernels import band_light as kernel
from ledpi.kernels.library import compiled
from ledpi.records import BandShape, Floats, HiddenSide, Integers, Mask, PanelSpec, Singles

PHASES = 32  # that are tried, of each class
EVEN = 0.85  # of the light of the brightest tenth: what a bright point of a cell has on average
MOST = 1.2  # of the bright level: what is brighter counts no more
LOOKS = 2  # at the phases: by cells that are even, and by the profile that they then have
# How sure it is beforehand that a cell is as bright as the others: as if so many of its points had said so. What points
# differ by, once their profile is known, is about as much as gains differ, a seventh.
SURE_POINTS = 1.0
# What a lattice loses, per pixel of its area, for the square of the share by which its perspective is not a square's:
# so little that only what dark rows leave open is decided by it.
AS_A_SQUARE = 0.5
UNKNOWN = -0.3  # gain of a pixel beyond what is looked at: about what a dark one has on average


@dataclass(frozen=True, slots=True, eq=False)
class Bands:
    """The bands that explain best what a square shows."""

    dark: float  # levels of light
    bright: float
    phases: Floats  # (2,) of either wave in the picture's row 0, in cycles
    white: Mask  # (cells²,) which cells are rather of the white class
    spec: PanelSpec
    explained: float  # share of the square's light, squared, that its cells explain

    @classmethod
    def at(
        cls,
        window: Window,
        corners: Points,
        cells: int,
        specs: Sequence[PanelSpec],
        shape: BandShape | None = None,
        hidden: HiddenSide | None = None,
    ) -> Bands | None:
        """Of the square at `corners` (4,) in the window, but for what is `hidden`; None where nothing there is bright.

        `shape`: what they look like, where that is not what the exposure makes of them.
        """
        specs = tuple(specs)
        contrast = min_contrast(specs, window.frame.exposure_us)
        frame = window.frame
        tables, a_row, antiphase = _waves_of(specs, frame.exposure_us, frame.row_time_us, window.shrink, shape)
        most = MOST / float(tables.max(axis=2).min())  # what is brightest here may be of the class that shows less
        if not (compiled() and min(window.light.shape) >= 2):
            return cls._in_numpy(window, corners, cells, specs, shape, hidden, contrast, most)
        lattice = lattice_beside(cells, hidden)
        found = kernel.bands_at(
            window.light,
            (window.dark, contrast, most),
            (lattice.across, lattice.down, lattice.of_cells),
            tables,
            (a_row * window.shrink, a_row * window.first.imag),
            antiphase,
            corners,
        )
        if found is None:
            return None
        (dark, bright, spec, of_black, of_white, explained, level), white = found[0].tolist(), found[1]
        bright = dark + (bright - dark) * level / EVEN
        return cls(dark, bright, np.array([of_black, of_white]) / PHASES, white, specs[int(spec)], explained)

    @classmethod
    def _in_numpy(
        cls,
        window: Window,
        corners: Points,
        cells: int,
        specs: Sequence[PanelSpec],
        shape: BandShape | None,
        hidden: HiddenSide | None,
        contrast: float,
        most: float,
    ) -> Bands | None:
        lattice = lattice_beside(cells, hidden)
        x, y, _ = lattice_places(corners[None], lattice)
        height, width = window.light.shape
        rows = (y[0] + 0.5).astype(np.int64).clip(0, height - 1)
        light = window.light[rows, (x[0] + 0.5).astype(np.int64).clip(0, width - 1)]
        dark, bright = np.quantile(light, (DARK, BRIGHT)).tolist()
        if not bright > contrast * dark:
            return None
        dark = min(dark, window.dark)
        relative = np.clip((light - dark) / (bright - dark), 0.0, most)
        energy = max(float((lattice.of_cells * relative * relative).sum()), 1e-9)
        every = np.tile(np.arange(PHASES) / PHASES, (2, 1))
        fits = [
            _fitted_phases(relative, lattice.of_cells, rows, window.shown(window.waves_of(spec, shape), every), spec)
            for spec in specs
        ]
        best = max(range(len(specs)), key=lambda i: fits[i].explained)
        fit = fits[best]
        bright = dark + (bright - dark) * fit.level / EVEN
        return cls(dark, bright, np.array(fit.phases) / PHASES, fit.white, specs[best], fit.explained / energy)


@dataclass(frozen=True, slots=True, eq=False)
class BandLight:
    """The light of a window beside what cells of either class show there."""

    cells: int
    focal_px: float  # of the camera, in the window's pixels
    light: Singles  # (rows, columns) relative: 0 as beside the panel, 1 brighter by what is bright over the dark
    shown: Singles  # (2, rows) e of either class, less what is beside the panel

    @classmethod
    def of(cls, window: Window, bands: Bands, cells: int, focal_px: float) -> BandLight:
        """With bands as they are; `focal_px` in the picture's pixels."""
        shown = window.shown(window.waves_of(bands.spec), bands.phases)
        above_dark = window.light - np.float32(bands.dark)
        relative = np.clip(above_dark * np.float32(1 / (bands.bright - bands.dark)), 0, MOST)
        rim = np.concatenate([relative[0], relative[-1], relative[:, 0], relative[:, -1]])
        beside = np.partition(rim, at := len(rim) // 2)[at]
        return cls(cells, focal_px / window.shrink, relative - beside, np.float32(EVEN) * shown - beside)

    def explains(self, corners: Points, lattice: Lattice) -> Floats:
        """(N,) how much a lattice with each of corners (N, 4) explains, in pixels of full light."""
        if compiled():
            places = (lattice.across, lattice.down, lattice.of_cells, lattice.of_walls)
            return kernel.lattices_explain(self.light, self.shown, places, corners, self.focal_px)
        x, y, depth = lattice_places(corners, lattice)
        seen, expected = self._gains(x, y)
        area = np.abs(areas(corners))
        nearer = depth**-3  # of the picture's area: further away, less of it
        nearer *= (area / nearer.mean(axis=(1, 2))).astype(np.float32)[:, None, None]
        of_class = ((seen - expected) * (nearer * lattice.of_cells)).sum(axis=3)  # (2, N, cells²)
        of_walls, of_lit_walls = ((gain * (nearer * lattice.of_walls)).sum(axis=3) for gain in (seen, expected))
        white = of_class[1] > of_class[0]
        explained = of_class.max(axis=0).sum(axis=1).astype(np.float64)
        of_walls, of_lit_walls = (np.where(white, gain[1], gain[0]).sum(axis=1) for gain in (of_walls, of_lit_walls))
        share = (0.5 * of_walls / np.maximum(of_lit_walls, 1e-9)).clip(0, 1)
        explained += share * of_walls - share * share * of_lit_walls
        explained -= AS_A_SQUARE * area * np.square(unlike_a_square(corners, self.focal_px))
        return np.where(np.isfinite(explained), explained, -np.inf)

    def _gains(self, x: Singles, y: Singles) -> tuple[Singles, Singles]:
        """(2, …) each: 2en and e² of either class at points."""
        height, width = self.light.shape
        inside = (x >= 0) & (y >= 0) & (x <= width - 1) & (y <= height - 1)
        x, y = np.where(inside, x, 0), np.where(inside, y, 0)
        column, row = np.minimum(x.astype(np.int64), width - 2), np.minimum(y.astype(np.int64), height - 2)
        right, down = (x - column).astype(np.float32), (y - row).astype(np.float32)
        upper, lower = (
            (1 - right) * self.light[at, column] + right * self.light[at, column + 1] for at in (row, row + 1)
        )
        shown = (1 - down) * self.shown[:, row] + down * self.shown[:, row + 1]
        seen = np.where(inside, 2 * shown * (upper + down * (lower - upper)), np.float32(UNKNOWN))
        return seen, np.where(inside, shown * shown, np.float32(0))


@dataclass(frozen=True, slots=True, eq=False)
class _Phases:
    """The pair of phases in which a lattice explains most."""

    explained: float  # as a share of its area
    phases: tuple[int, int]  # of PHASES
    white: Mask  # (cells²,)
    level: float  # relative light of a cell that is on all the time, on average


def _fitted_phases(
    relative: Singles, share: Singles, rows: Integers, waves: Singles, spec: PanelSpec
) -> _Phases:
    """Of relative light (cells², P) at a lattice's points, each of which has a share of the panel, in these rows.

    First as if cells were even, of the usual brightness; then with the profile that they then have in common.
    """
    profile = np.full(relative.shape[1], EVEN)
    for look in range(LOOKS):
        found, shown = _phases_by(profile, relative, share, rows, waves, spec)
        if look < LOOKS - 1:
            of_light, of_shown = (share * relative * shown).sum(axis=0), (share * shown * shown).sum(axis=0)
            profile = (of_light + EVEN * SURE_POINTS / share.size) / (of_shown + SURE_POINTS / share.size)
    return found


def _phases_by(
    profile: Floats, relative: Singles, share: Singles, rows: Integers, waves: Singles, spec: PanelSpec
) -> tuple[_Phases, Singles]:
    """With a profile (P,) of cells, each of which has a gain of its own; and (cells², P) what their classes show."""
    cells, height = len(relative), waves.shape[2]
    index = (np.arange(cells)[:, None] * height + rows).reshape(-1)
    light = np.bincount(index, (share * relative * profile).reshape(-1), cells * height).reshape(cells, height)
    lit = np.bincount(index, (share * profile * profile).reshape(-1), cells * height).reshape(cells, height)
    sure = SURE_POINTS / share.size
    black, white = (np.square(light @ wave.T + sure) / (lit @ np.square(wave).T + sure) - sure for wave in waves)
    either = np.maximum(black[:, :, None], white[:, None, :]).sum(axis=0)
    if spec.phase == "antiphase":  # white half a cycle after black
        opposite = np.arange(PHASES)
        tied = np.full_like(either, -np.inf)
        tied[opposite, opposite - PHASES // 2] = either[opposite, opposite - PHASES // 2]
        either = tied
    of_black, of_white = divmod(int(either.argmax()), PHASES)
    is_white = white[:, of_white] > black[:, of_black]
    shown = np.where(is_white[:, None], waves[1, of_white][rows], waves[0, of_black][rows])
    return _Phases(float(either.max()), (of_black, of_white), is_white, float(profile.mean())), shown


@lru_cache(maxsize=32)
def _waves_of(
    specs: tuple[PanelSpec, ...], exposure_us: float, row_time_us: float, shrink: int, shape: BandShape | None
) -> tuple[Singles, Floats, Mask]:
    """(specs, 2, WAVE_STEPS) tables, (specs, 2) cycles in a row of the picture, (specs,) which are in antiphase."""
    waves = [class_waves(spec, exposure_us, row_time_us, shrink, shape) for spec in specs]
    antiphase = np.array([spec.phase == "antiphase" for spec in specs])
    return np.array([w.tables for w in waves]), np.array([w.cycles_a_row for w in waves]), antiphase
