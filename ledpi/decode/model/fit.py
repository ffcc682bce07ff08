"""Fits the whole picture of a panel to light, from corners that are about right.

docs/algorithm.md has the equation and its unknowns, panel_light.c its terms, panel_fit.c the step.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from statistics import median
from typing import Any

import numpy as np

from ledpi.core.geometry import quad_side
from ledpi.core.lens import bending_lens_of
from ledpi.core.library import NONE, ffi, lib
from ledpi.core.records import Floats, Frame, Intrinsics, PanelSpec, Rejected, read_only
from ledpi.decode.model.light import Window, grid, waves
from ledpi.decode.model.panel import MOST_LINES, Solver
from ledpi.decode.model.prior import BLUR, GAP, RIM, SMEAR, prior

DIVERGED = Rejected(stage="fit", reason="diverged")
NO_BANDS = Rejected(stage="fit", reason="no_bands")
MISFIT = Rejected(stage="fit", reason="misfit")
UNCERTAIN = Rejected(stage="fit", reason="uncertain")
WHY = {lib.LEDPI_WITHOUT_BANDS: NO_BANDS, lib.LEDPI_MISFIT: MISFIT, lib.LEDPI_UNCERTAIN: UNCERTAIN}

EACH_FIT = 4000  # places that a fit costs beside those that it looks at: its window, the arguments, the covariance
SATURATED = 0.999  # of full scale: such light says nothing
# Fields of `FitOptions`: what the solver itself goes by.
SOLVED_BY = ("rounds", "reweightings", "banded", "phasing", "must_blink", "tolerance", "most_left")
RIMS = np.array([RIM + 2, RIM + 1, RIM + 3, RIM])  # of the sides from one corner to the next: above, right, below, left
# In cells, at either end of a side that something hides: its edge may lie aslant, which draws the lattice there.
ASLANT = 0.06
SIDES = np.arange(4)  # each from the corner of its number to the next
BEFORE, NEXT, AFTER_NEXT = (SIDES + 3) % 4, (SIDES + 1) % 4, (SIDES + 2) % 4
UNEVEN = 1.0 / math.sqrt(3.0)  # of a strip's width, at its ends: as anything between none and twice as much at one


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FitOptions:
    """Rounds, tolerances and grid of one fit."""

    rounds: int  # of Gauss and Newton, at most
    tolerance: float = 0.002  # of half the side: the last step moves corners by less
    most_left: float = math.inf  # share of the light's squares: where more is foreseen to be left, the fit ends
    most_sigma: float = math.inf  # of a cell: so, too, where corners are foreseen to be less certain
    reweightings: int = 0  # how often what does not fit is given less weight
    coarse: bool = False  # on a coarse grid
    faint: bool = False  # bands are, so their phases stay near what the grid finds
    even: bool = False  # cells are seen even about their middles: nothing but corners moves the lattice
    banded: bool = True  # cells show bands
    phasing: bool = True  # seeks the bands' phases first, on a grid
    must_blink: bool = False  # and gives up what surely shows none


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fitted:
    """A panel's picture as it fits best. Pixels are the picture's."""

    lattice_px: Floats  # (4, 2) corners of the lattice of cells
    corners_px: Floats  # (4, 2) and of what is lit
    hidden: Floats  # (4,) how much something hides along each side, from one corner to the next, in cells
    covariance_px2: Floats  # (8, 8) of the corners: x and y of each
    rim_variance: Floats  # (4,) of the rims along each side, in cells²
    jackknife_px2: Floats  # (8, 8) that of the corners, by how far they would move without any one of the cells
    blur_px: Floats  # (2,) deviation of the picture's blur along rows and along columns
    settled: bool  # the last step hardly moved anything
    explained: float  # share of the light's squares about their mean
    residual: float  # mean square of what is not, over the noise that so much light has
    unknown: Floats  # as `prior` has them
    spec: PanelSpec


class Fitter:
    """Fits panels of `cells` × `cells`, in room that it keeps."""

    def __init__(self, cells: int, intrinsics: Intrinsics | None) -> None:
        self._cells = cells
        self._intrinsics = intrinsics
        self._lens = bending_lens_of(intrinsics)
        self.solver = Solver()
        self.sampled = 0  # places that all fits so far have cost

    def fit(
        self,
        frame: Frame,
        window: Window,
        corners_px: Floats,
        spec: PanelSpec,
        options: FitOptions,
        known: Floats | None = None,
    ) -> Fitted | Rejected:
        """From corners (4, 2) of the lattice, or why it comes to nothing. `known`: unknowns to begin with."""
        cells = self._cells
        pitch_px = pitch_px_of(corners_px, cells * window.shrink)
        lines = grid(cells, round(min(pitch_px), 1), coarse=options.coarse)
        if len(lines) > MOST_LINES:
            return DIVERGED
        each = len(lines) / cells  # no finer than the grid is what is seen of a cell
        across, down = (round(max(1.0, min(each, of)), 1) for of in pitch_px)
        given = prior(cells, (across, down), frame.exposure_us, even=options.even, faint=options.faint)
        unknown = (given[0] if known is None else known).copy()
        tables = waves(spec, frame.exposure_us, frame.row_time_us, window.shrink)
        per_row = frame.row_time_us * 1e-6
        outcome, fit = self.solver.fit(
            **self.view(window),
            cells=cells,
            waves=tables,
            cycles_a_row=(spec.black_hz * per_row, spec.white_hz * per_row),
            lines=len(lines),
            along=lines,
            prior=given,
            **{name: getattr(options, name) for name in SOLVED_BY},
            most_sigma=options.most_sigma * quad_side(corners_px.tolist()) / cells,
            corners=corners_px.reshape(-1).tolist(),
            unknown=unknown,
        )
        self.sampled += EACH_FIT + fit.sampled
        if outcome != lib.LEDPI_FITTED:
            return WHY.get(outcome, DIVERGED)
        return _fitted(fit, unknown, window, spec)

    def view(self, window: Window) -> dict[str, Any]:
        """The arguments that tell the solver of the light, and of the lens."""
        return solver_view(window, self._intrinsics, self._lens)


def solver_view(window: Window, intrinsics: Intrinsics | None, lens: Floats | None) -> dict[str, Any]:
    """Fields of a solver's view of the light, and of the lens: a guess where that is not known."""
    height, width = window.picture
    return {
        "light": window.light,
        "rows": window.light.shape[0],
        "columns": window.light.shape[1],
        "first_x": window.first[0],
        "first_y": window.first[1],
        "shrink": window.shrink,
        "saturated": SATURATED,
        "scale": 1.0 / (window.bright - window.dark),
        "dark": window.dark,
        "lens": NONE if lens is None else lens,
        "focal": (width, width) if intrinsics is None else (intrinsics.fx, intrinsics.fy),
        "centre": (width / 2, height / 2) if intrinsics is None else (intrinsics.cx, intrinsics.cy),
    }


def _fitted(fit: Any, unknown: Floats, window: Window, spec: PanelSpec) -> Fitted | Rejected:
    lattice, lit = _copied(fit.corners).reshape(4, 2), _copied(fit.lit).reshape(4, 2)
    if not math.isfinite(sum(fit.corners) + sum(fit.lit)):
        return DIVERGED
    blur, smear = unknown[BLUR], unknown[SMEAR]
    return Fitted(
        lattice_px=read_only(lattice),
        corners_px=read_only(lit),
        hidden=_by_side(fit.hidden),
        covariance_px2=read_only(_copied(fit.covariance).reshape(8, 8)),
        rim_variance=_by_side(fit.rim_variance),
        jackknife_px2=read_only(_copied(fit.jackknife).reshape(8, 8)),
        blur_px=read_only(np.array([window.shrink * math.exp(of) for of in (blur + smear, blur - smear)])),
        settled=fit.settled,
        explained=fit.explained,
        residual=fit.variance * (window.bright - window.dark),
        unknown=read_only(unknown),
        spec=spec,
    )


def _copied(numbers: Any) -> Floats:
    return np.frombuffer(ffi.buffer(numbers)).copy()


def _by_side(numbers: Any) -> Floats:
    """(4,) those of left, right, above and below, from one corner to the next."""
    left, right, above, below = numbers
    return read_only(np.array([above, right, below, left]))


def pitch_px_of(corners_px: Floats, cells: int) -> tuple[float, float]:
    """A cell's mean width and height."""
    a, b, c, d = (complex(x, y) for x, y in corners_px.tolist())
    return abs(b + c - a - d) / (2 * cells), abs(c + d - a - b) / (2 * cells)


def side_covariance(lattice_px: Floats, unknown: Floats, rim_variance: Floats, hidden: Floats, cells: int) -> Floats:
    """(8, 8) px² of what sides may be off beside what the fit says, by its corners (4, 2), rims and `hidden` (4,).

    A panel is built alike on all sides: light ends with the lattice, or half a wall before. Where the fit has it end
    elsewhere, by more than the noise of a rim, the fit may be wrong by as much, of each side, at each end, and of all
    sides together.
    """
    rims, is_hidden = unknown[RIMS], hidden > 0.0
    usual = median(rims[~is_hidden].tolist())
    built = min((0.0, 0.5 * float(unknown[GAP])), key=lambda rim: abs(usual - rim))
    beyond = np.sqrt(np.maximum((rims - built) ** 2 - rim_variance, 0.0))
    apart = np.where(is_hidden, 0.0, np.copysign(beyond, rims - built))
    aslant = np.where(is_hidden, ASLANT, UNEVEN * apart)
    ends = np.zeros((2, 4, 4, 2))  # by a cell inwards at either end of a side: how its corners move
    ends[0, SIDES, SIDES] = (lattice_px[BEFORE] - lattice_px) / cells
    ends[1, SIDES, NEXT] = (lattice_px[AFTER_NEXT] - lattice_px[NEXT]) / cells
    each = ends.reshape(2, 4, 8)
    sides = apart[:, None] * each.sum(axis=0)
    moved = np.vstack([sides, sides.sum(axis=0), *(aslant[:, None] * each)])
    return np.asarray(moved.T @ moved)
