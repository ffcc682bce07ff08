"""The square of a panel with deep bands, near corners that are about right: by a fit of its whole picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np

from ledpi.decode.corners.edges import checked
from ledpi.decode.corners.sides import Points, areas, as_corners, bends
from ledpi.decode.striped.band_light import Bands
from ledpi.decode.striped.light_window import Window
from ledpi.decode.striped.panel_fit import Fit, fitted, fitted_in_shape
from ledpi.geometry import box, in_square
from ledpi.records import BandShape, Frame, HiddenSide, Intrinsics, PanelSpec, Quad, Rejected, SeenBands, read_only

NO_BANDS = Rejected(stage="edges", reason="no_bands")
MIN_EXPLAINED = 0.6  # share of the light that a lattice's cells must explain
STEADY = 0.5  # of its brightest rows' light: a class whose darkest rows show more is lit all the time
CLASSES = 3  # fits, each in the classes of cells that the last has shown, until they stay
ROUNDS = 6  # of a fit
# Of the light's squares, that a panel's picture explains: 0.94 and more of panels from 0.4 to 4 m, and of those made of
# photographs. And deviation of the corners, as a share of the side: by a lattice they are known to 0.1 % nearby,
# to 0.5 % at 4 m.
MIN_FITTED, MAX_SIGMA = 0.9, 0.007
# Of the light's squares, of a panel that something stands before along a side: 0.85 and more where that is up to 12 %.
MIN_FITTED_PARTLY = 0.8
# Of what a fit of all of it does not explain, a fit of what is seen leaves a tenth and less, where a few percent of the
# side are hidden. Small panels fit a little better without any of their sides.
MOST_LEFT = 1.0 / 3.0
MOST_HIDDEN = 0.15  # of the side; and a fit of what is left is a third of that too far in
MOST_OF_CELL = 0.75  # of the cells along it: the rest tells which class they are
HIDDEN = 1e6  # as light, that nothing is told by: so bright that what is interpolated with it is saturated, too
SHIFT = 4  # bits of a polygon's coordinates, below a pixel
MARGIN, MARGIN_PX = 0.05, 3.0  # of the side, and pixels, around it: by how much it may be off, and be blurred


def square_near(
    frame: Frame, near: Points, cells: int, specs: Sequence[PanelSpec], intrinsics: Intrinsics | None
) -> Quad | Rejected:
    """The square near corners (4,) that are a few percent of the side off, with what is seen of its bands."""
    window = Window.around(frame, near[None], MARGIN * side_of(near) + MARGIN_PX)
    bands = bands_at(window, near, cells, specs)
    for _ in range(CLASSES):
        if isinstance(bands, Rejected):
            return bands
        before, hidden = bands, None
        fit = _whole_fit(window, near, bands, cells, intrinsics)
        if fit is not None and (fit.rim_wall or not _is_one(fit)):
            fit, hidden = _with_a_side_hidden(window, fit, bands, cells, intrinsics)
        if fit is None or not _is_one(fit):
            return NO_BANDS
        near = fit.corners
        bands = bands_at(window, near, cells, (before.spec,), fit.shape, hidden)
        if isinstance(bands, Bands) and (bands.white == before.white).all():
            white = read_only(bands.white)
            told = SeenBands(spec=bands.spec, white=white, phases=fit.phases, shape=fit.shape, hidden=hidden)
            bend = bends(near[None], intrinsics)
            # Cells that are dim along their borders, as rows of LEDs leave them, seem to end further in, too.
            size_sigma_px = math.hypot(fit.size_sigma_px, fit.rim_wall * side_of(near) / math.sqrt(3))
            sigma_px = math.hypot(fit.sigma_px, size_sigma_px)
            quad = checked(frame, near, sigma_px, size_sigma_px, float(np.abs(bend.imag).max()))
            return replace(quad, bands=told, rim_wall=fit.rim_wall) if isinstance(quad, Quad) else quad
    return NO_BANDS


def _whole_fit(
    window: Window,
    near: Points,
    bands: Bands,
    cells: int,
    intrinsics: Intrinsics | None,
    shape: BandShape | None = None,
) -> Fit | None:
    """The panel near corners (4,) in the picture, in these phases and classes; `shape` as of `fitted_in_shape`."""
    # Of steady cells a longer exposure changes all the light: what bands look like is not told by them.
    if window.waves_of(bands.spec).least > STEADY:
        return fitted(window, near, bands, cells, intrinsics, rounds=ROUNDS)
    return fitted_in_shape(window, near, bands, cells, intrinsics, rounds=ROUNDS, is_one=_is_one, shape=shape)


def _is_one(fit: Fit, least: float = MIN_FITTED) -> bool:
    return fit.explained >= least and fit.sigma_px < MAX_SIGMA * side_of(fit.corners)


def _with_a_side_hidden(
    window: Window, fit: Fit, bands: Bands, cells: int, intrinsics: Intrinsics | None
) -> tuple[Fit, HiddenSide | None]:
    """The panel where one of its sides is hidden, and which, if that is why it fits badly; else as it is.

    Its rim seems to lie within its lattice's end, too. Without the light along that side, the others end where the
    lattice does. Those of cells of one size do not.
    """
    if not _is_one(fit, MIN_FITTED_PARTLY):
        return fit, None
    share = min(MOST_HIDDEN, MOST_OF_CELL / cells)
    for side in range(4):
        hidden = HiddenSide(side, share)
        other = _whole_fit(_without(window, fit.corners, hidden), fit.corners, bands, cells, intrinsics, fit.shape)
        if other is None or not _is_one(other) or other.rim_wall or not other.explained > fit.explained:
            continue
        if 1.0 - other.explained < MOST_LEFT * (1.0 - fit.explained):
            return other, hidden
        if _is_one(fit):
            return other, None
    return fit, None


def _without(window: Window, corners: Points, hidden: HiddenSide) -> Window:
    """The window, of which what is hidden of a square with these corners (4,), and what is beside it, tells nothing."""
    square = np.roll(as_corners(window.within(corners)), -hidden.side, axis=0)
    strip, light = in_square(square, box(-0.2, -0.2, 1.2, hidden.share)), window.light.copy()
    cv2.fillConvexPoly(light, np.round(strip * 2**SHIFT).astype(np.int32), HIDDEN, shift=SHIFT)
    return replace(window, light=light)


def bands_at(
    window: Window,
    near: Points,
    cells: int,
    specs: Sequence[PanelSpec],
    shape: BandShape | None = None,
    hidden: HiddenSide | None = None,
) -> Bands | Rejected:
    """The phases and classes that explain most of a panel with corners (4,) in the picture, if they explain enough."""
    bands = Bands.at(window, window.within(near), cells, specs, shape, hidden)
    return NO_BANDS if bands is None or bands.explained < MIN_EXPLAINED else bands


def side_of(corners: Points) -> float:
    """The root of the area of corners (4,)."""
    return math.sqrt(abs(areas(corners)))
