"""What the light around a square says of a lattice of blinking cells there, whose word is not known.

Where exposures are short a cell of class k shows its light times w_k(y), which is known but for one phase: bright in
some rows, dark in others. So a pixel of relative light n is likelier as a lit part of such a cell than as darkness by

    gain_k = e·(2n − e),    e = EVEN·w_k(y)        (n² − (n − e)², of a normal distribution with one variance)

which is positive where it is bright in rows in which the class is, negative where it is dark there, and nothing in rows
in which the class is dark: those tell nothing of where the panel is. A lattice in some place explains the sum over its
cells of what either class gains in each; the walls between cells shine with whatever share λ of that explains them
best: λe·(2n − λe). No border between cells, no rim needs to be seen for that, and all that are seen add to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from ledpi import shutter
from ledpi.decode.sides import Points, Singles, areas
from ledpi.kernels import band_light as kernel
from ledpi.kernels.library import compiled
from ledpi.records import Floats, Frame, PanelSpec
from ledpi.tone import linear_light

FEWEST_PX = 70  # the side of a square that is looked at is averaged down to, as long as it has two times as many
PHASES = 32  # that are tried, of each class
WAVE_STEPS = 512  # of a period, in which its light is known
EVEN = 0.85  # of the light of the brightest tenth: what a bright point of a cell has on average
DARK, BRIGHT = 0.05, 0.9  # shares of the points that are darker than what is taken for dark, and for bright
MOST = 1.2  # of the bright level: what is brighter counts no more
MIN_CONTRAST = 3.0  # of bright to dark; a wall beside a panel's dark frame has less than a panel
# What a lattice loses, per pixel of its area, for the square of the share by which its perspective is not a square's:
# so little that only what dark rows leave open is decided by it.
AS_A_SQUARE = 0.5
SPARSE = 4  # pixels: so far apart those are that tell how dark it is around a panel
UNKNOWN = -0.3  # gain of a pixel beyond what is looked at: about what a dark one has on average


@dataclass(frozen=True, slots=True, eq=False)
class Lattice:
    """Points in the cells of a panel, cell by cell, each standing for as much of it.

    In a cell they are a Fibonacci lattice: no two in one row, so that no bands fall between its rows.
    """

    across: Singles  # (cells², P) 0..1
    down: Singles
    of_cells: Singles  # (cells², P) share of the panel, in the open part of cells
    of_walls: Singles  # (cells², P) and between them

    @classmethod
    def of(cls, cells: int, points: int, step: int, wall: float) -> Lattice:
        """With so many points in a cell; the next in a lower row is `step` of them further, around the cell.

        `wall`: what may be dark on either side of a border between cells, as a share of the cell.
        """
        order = np.arange(points)
        down, across = (order + 0.5) / points, (order * step % points + 0.5) / points
        number = np.arange(cells)
        u = np.broadcast_to((number[None, :, None] + across) / cells, (cells, cells, points)).reshape(-1, points)
        v = np.broadcast_to((number[:, None, None] + down) / cells, (cells, cells, points)).reshape(-1, points)
        border = [np.abs(w * cells - np.clip(np.round(w * cells), 1, cells - 1)) < wall for w in (u, v)]
        walls = (border[0] | border[1]) / u.size
        return cls(*(np.asarray(part, np.float32) for part in (u, v, 1 / u.size - walls, walls)))


@cache
def rough_lattice(cells: int) -> Lattice:
    """Few points, for a first look."""
    return Lattice.of(cells, 8, 5, 0.0)


@cache
def fine_lattice(cells: int) -> Lattice:
    """Points enough to see walls: what is dark there is not the cell's."""
    return Lattice.of(cells, 55, 34, 0.04)


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
        shrink = max(1, int(np.sqrt(np.abs(areas(corners)).min()) // FEWEST_PX))
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

    def waves_of(self, spec: PanelSpec) -> ClassWaves:
        """What cells of a panel show in its rows."""
        return class_waves(spec, self.frame.exposure_us, self.frame.row_time_us, self.shrink)

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


@lru_cache(maxsize=64)
def class_waves(spec: PanelSpec, exposure_us: float, row_time_us: float, shrink: int) -> ClassWaves:
    """Of the means of `shrink` rows."""
    both_hz = np.array([spec.black_hz, spec.white_hz])
    cycles = (np.arange(WAVE_STEPS) + 0.5) / WAVE_STEPS
    tables = []
    for hz in both_hz.tolist():
        around = (np.arange(shrink) - (shrink - 1) / 2) * hz * row_time_us * 1e-6
        each = [shutter.exposure_weight(cycles + row, hz * exposure_us * 1e-6, spec.duty) for row in around]
        mean = np.mean(each, axis=0)
        tables.append(mean / mean.max())
    share = float(np.mean([table.var() / np.square(table).mean() for table in tables]))
    return ClassWaves(np.array(tables, np.float32), both_hz * (row_time_us * 1e-6), share)


@lru_cache(maxsize=32)
def _waves_of(
    specs: tuple[PanelSpec, ...], exposure_us: float, row_time_us: float, shrink: int
) -> tuple[Singles, Floats, NDArray[np.bool_]]:
    """(specs, 2, WAVE_STEPS) tables, (specs, 2) cycles in a row of the picture, (specs,) which are in antiphase."""
    waves = [class_waves(spec, exposure_us, row_time_us, shrink) for spec in specs]
    antiphase = np.array([spec.phase == "antiphase" for spec in specs])
    return np.array([w.tables for w in waves]), np.array([w.cycles_a_row for w in waves]), antiphase


@lru_cache(maxsize=32)
def min_contrast(specs: tuple[PanelSpec, ...], exposure_us: float) -> float:
    """Of bright to dark light in a panel, at least: MIN_CONTRAST, or a third of what the deepest bands have."""
    depths = [0.5 * shutter.contrast(hz, exposure_us, s.duty) for s in specs for hz in (s.black_hz, s.white_hz)]
    deepest = min(max(depths), 0.999)
    return min(MIN_CONTRAST, max(1.0, (1 + deepest) / (1 - deepest) / 3))


@dataclass(frozen=True, slots=True, eq=False)
class Bands:
    """The bands that explain best what a square shows."""

    dark: float  # levels of light
    bright: float
    phases: Floats  # (2,) of either wave in the picture's row 0, in cycles
    white: NDArray[np.bool_]  # (cells²,) which cells are rather of the white class
    spec: PanelSpec
    explained: float  # share of the square's light, squared, that its cells explain

    @classmethod
    def at(cls, window: Window, corners: Points, cells: int, specs: Sequence[PanelSpec]) -> Bands | None:
        """Of the square at `corners` (4,) in the window; None where nothing there is bright."""
        specs = tuple(specs)
        contrast = min_contrast(specs, window.frame.exposure_us)
        if not (compiled() and min(window.light.shape) >= 2):
            return cls._in_numpy(window, corners, cells, specs, contrast)
        lattice = fine_lattice(cells)
        tables, a_row, antiphase = _waves_of(specs, window.frame.exposure_us, window.frame.row_time_us, window.shrink)
        found = kernel.bands_at(
            window.light,
            window.dark,
            contrast,
            (lattice.across, lattice.down, lattice.of_cells),
            tables,
            (a_row * window.shrink, a_row * window.first.imag),
            antiphase,
            corners,
        )
        if found is None:
            return None
        (dark, bright, spec, of_black, of_white, explained), white = found[0].tolist(), found[1]
        return cls(dark, bright, np.array([of_black, of_white]) / PHASES, white, specs[int(spec)], explained)

    @classmethod
    def _in_numpy(
        cls, window: Window, corners: Points, cells: int, specs: Sequence[PanelSpec], contrast: float
    ) -> Bands | None:
        lattice = fine_lattice(cells)
        x, y, _ = lattice_places(corners[None], lattice)
        height, width = window.light.shape
        rows = (y[0] + 0.5).astype(np.int64).clip(0, height - 1)
        light = window.light[rows, (x[0] + 0.5).astype(np.int64).clip(0, width - 1)]
        dark, bright = np.quantile(light, (DARK, BRIGHT)).tolist()
        if not bright > contrast * dark:
            return None
        dark = min(dark, window.dark)
        relative = np.clip((light - dark) / (bright - dark), 0.0, MOST)
        energy = max(float((lattice.of_cells * relative * relative).sum()), 1e-9)
        every = np.tile(np.arange(PHASES) / PHASES, (2, 1))
        fits = [
            _fitted_phases(relative, lattice.of_cells, rows, window.shown(window.waves_of(spec), every), spec)
            for spec in specs
        ]
        best = max(range(len(specs)), key=lambda i: fits[i].explained)
        fit = fits[best]
        return cls(dark, bright, np.array(fit.phases) / PHASES, fit.white, specs[best], fit.explained / energy)


@dataclass(frozen=True, slots=True, eq=False)
class BandLight:
    """The light of a window beside what cells of either class show there."""

    cells: int
    focal_px: float  # of the camera, in the window's pixels
    light: Singles  # (rows, columns) relative: 0 dark, 1 bright
    shown: Singles  # (2, rows) e of either class

    @classmethod
    def of(cls, window: Window, bands: Bands, cells: int, focal_px: float) -> BandLight:
        """With bands as they are; `focal_px` in the picture's pixels."""
        shown = window.shown(window.waves_of(bands.spec), bands.phases)
        above_dark = window.light - np.float32(bands.dark)
        relative = np.clip(above_dark * np.float32(1 / (bands.bright - bands.dark)), 0, MOST)
        return cls(cells, focal_px / window.shrink, relative, np.float32(EVEN) * shown)

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


def have_contrast(frame: Frame, corners: Points, cells: int, specs: Sequence[PanelSpec]) -> NDArray[np.bool_]:
    """(N,) which quads (N, 4) in the picture show both bright and dark."""
    x, y, _ = lattice_places(corners, rough_lattice(cells))
    height, width = frame.pixels.shape
    codes = frame.pixels[y.astype(np.int64).clip(0, height - 1), x.astype(np.int64).clip(0, width - 1)]
    light = linear_light(frame.transfer, mark_saturated=False)[codes.reshape(len(corners), -1)]
    dark, bright = np.quantile(light, (DARK, BRIGHT), axis=1)
    contrasty: NDArray[np.bool_] = bright > min_contrast(tuple(specs), frame.exposure_us) * dark
    return contrasty


@dataclass(frozen=True, slots=True, eq=False)
class _Phases:
    """The pair of phases in which a lattice explains most."""

    explained: float  # as a share of its area
    phases: tuple[int, int]  # of PHASES
    white: NDArray[np.bool_]  # (cells²,)


def _fitted_phases(
    relative: Singles, share: Singles, rows: NDArray[np.int64], waves: Singles, spec: PanelSpec
) -> _Phases:
    """Of relative light (cells², P) at a lattice's points, each of which has a share of the panel, in these rows."""
    cells, height = len(relative), waves.shape[2]
    index = (np.arange(cells)[:, None] * height + rows).reshape(-1)
    light = np.bincount(index, (share * relative).reshape(-1), cells * height).reshape(cells, height)
    count = np.bincount(index, share.reshape(-1), cells * height).reshape(cells, height)
    black, white = (EVEN * (2 * light @ wave.T - EVEN * count @ np.square(wave).T) for wave in waves)
    either = np.maximum(black[:, :, None], white[:, None, :]).sum(axis=0)
    if spec.phase == "antiphase":  # white half a cycle after black
        opposite = np.arange(PHASES)
        tied = np.full_like(either, -np.inf)
        tied[opposite, opposite - PHASES // 2] = either[opposite, opposite - PHASES // 2]
        either = tied
    of_black, of_white = divmod(int(either.argmax()), PHASES)
    return _Phases(float(either.max()), (of_black, of_white), white[:, of_white] > black[:, of_black])


def unlike_a_square(corners: Points, focal_px: float) -> Floats:
    """(N,) how much depth across quads (N, 4) differs from that of a square that is foreshortened as they are.

    A square turned by τ from the line of sight is shorter by cos τ across the axis that it is turned about, and over
    its height its relative depth changes by sin τ times its side over its distance, which is its longer side over the
    focal length. It may be nearer at either end.
    """
    c0, c1, c2, c3 = corners.T
    across, down = 0.5 * (c1 + c2 - c0 - c3), 0.5 * (c3 + c2 - c0 - c1)
    g, h = _perspective(corners)
    depth = (g + 1j * h) / (1 + 0.5 * (g + h))  # change of relative depth, across and down
    u, v, both = np.square(np.abs(across)), np.square(np.abs(down)), (across.conj() * down).real
    root = np.hypot(u - v, 2 * both)
    expected = np.sqrt(root) / focal_px  # longer side² less shorter side²
    shortened = 1j * np.exp(0.5j * np.arctan2(2 * both, u - v))  # the way, in the square, in which it is shorter
    off: Floats = np.minimum(np.abs(depth - expected * shortened), np.abs(depth + expected * shortened))
    return off


def _perspective(corners: Points) -> tuple[Floats, Floats]:
    """(N,) each: by how much relative depth changes across and down the unit square that is seen at corners (N, 4)."""
    c0, c1, c2, c3 = corners.T
    far, near, all_four = c1 - c2, c3 - c2, c0 - c1 + c2 - c3
    det = (far.conj() * near).imag
    return (all_four.conj() * near).imag / det, (far.conj() * all_four).imag / det


def lattice_places(corners: Points, lattice: Lattice) -> tuple[Singles, Singles, Singles]:
    """(N, cells², P) each: x, y, and relative depth of a lattice's points in quads (N, 4).

    Of the homography from the unit square, as `cells.unit_square_to`, for many at once.
    """
    c0, c1, _, c3 = corners.T
    g, h = _perspective(corners)
    across, down = c1 - c0 + g * c1, c3 - c0 + h * c3
    values = np.stack([g, h, across.real, down.real, c0.real, across.imag, down.imag, c0.imag]).astype(np.float32)
    g_, h_, xu, xv, x0, yu, yv, y0 = values[:, :, None, None]
    u, v = lattice.across, lattice.down
    depth = g_ * u + h_ * v + np.float32(1)
    return (xu * u + xv * v + x0) / depth, (yu * u + yv * v + y0) / depth, depth
