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
from ledpi.records import BandShape, Floats, Frame, Intrinsics, PanelSpec, Quad, Rejected, SeenBands, read_only

NO_BANDS = Rejected(stage="edges", reason="no_bands")
MIN_EXPLAINED = 0.6  # share of the light that a lattice's cells must explain
STEADY = 0.5  # of its brightest rows' light: a class whose darkest rows show more is lit all the time
CLASSES = 3  # fits, each in the classes of cells that the last has shown, until they stay
ROUNDS = 6  # of a fit
# Of the light's squares, that a panel's picture explains: 0.94 and more of panels from 0.4 to 4 m, and of those made of
# photographs. And deviation of the corners, as a share of the side: by a lattice they are known to 0.1 % nearby,
# to 0.5 % at 4 m.
MIN_FITTED, MAX_SIGMA = 0.9, 0.007
MOST_HIDDEN = 0.15  # of the side; and a fit of what is left is a third of that too far in
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
        fit, before = _whole_fit(window, near, bands, cells, intrinsics), bands
        if isinstance(fit, Rejected):
            return fit
        if fit.rim_wall:
            fit = _with_a_side_hidden(window, fit, bands, cells, intrinsics) or fit
        near = fit.corners
        bands = bands_at(window, near, cells, (before.spec,), fit.shape)
        if isinstance(bands, Bands) and (bands.white == before.white).all():
            seen = SeenBands(spec=bands.spec, white=read_only(bands.white), phases=fit.phases, shape=fit.shape)
            bend = bends(near[None], intrinsics)
            # Cells that are dim along their borders, as rows of LEDs leave them, seem to end further in, too.
            size_sigma_px = math.hypot(fit.size_sigma_px, fit.rim_wall * side_of(near) / math.sqrt(3))
            sigma_px = math.hypot(fit.sigma_px, size_sigma_px)
            quad = checked(frame, near, sigma_px, size_sigma_px, float(np.abs(bend.imag).max()))
            return replace(quad, bands=seen, rim_wall=fit.rim_wall) if isinstance(quad, Quad) else quad
    return NO_BANDS


def _whole_fit(
    window: Window, near: Points, bands: Bands, cells: int, intrinsics: Intrinsics | None
) -> Fit | Rejected:
    """The panel near corners (4,) in the picture, in these phases and classes."""
    # Of steady cells a longer exposure changes all the light: what bands look like is not told by them.
    if window.waves_of(bands.spec).least > STEADY:
        fit = fitted(window, near, bands, cells, intrinsics, rounds=ROUNDS)
    else:
        fit = fitted_in_shape(window, near, bands, cells, intrinsics, rounds=ROUNDS, is_one=_is_one)
    return fit if fit is not None and _is_one(fit) else NO_BANDS


def _is_one(fit: Fit) -> bool:
    return fit.explained >= MIN_FITTED and fit.sigma_px < MAX_SIGMA * side_of(fit.corners)


def _with_a_side_hidden(
    window: Window, fit: Fit, bands: Bands, cells: int, intrinsics: Intrinsics | None
) -> Fit | None:
    """The panel where one of its sides is hidden, if that is why its rim seems to lie within its lattice's end.

    Without the light along that side, the others end where the lattice does. Those of cells of one size do not.
    """
    for side in range(4):
        light = window.light.copy()
        strip = _strip(window.within(fit.corners), side)
        cv2.fillConvexPoly(light, np.round(strip * 2**SHIFT).astype(np.int32), HIDDEN, shift=SHIFT)
        seen = replace(window, light=light)
        other = fitted(seen, fit.corners, bands, cells, intrinsics, rounds=ROUNDS, shape=fit.shape)
        if other is not None and _is_one(other) and not other.rim_wall and other.explained > fit.explained:
            return other
    return None


def _strip(corners: Points, side: int) -> Floats:
    """(4, 2) what may be hidden of a square along one side, and what is beside it, in pixels of its corners (4,)."""
    return in_square(np.roll(as_corners(corners), -side, axis=0), box(-0.2, -0.2, 1.2, MOST_HIDDEN))


def bands_at(
    window: Window, near: Points, cells: int, specs: Sequence[PanelSpec], shape: BandShape | None = None
) -> Bands | Rejected:
    """The phases and classes that explain most of a panel with corners (4,) in the picture, if they explain enough."""
    bands = Bands.at(window, window.within(near), cells, specs, shape)
    return NO_BANDS if bands is None or bands.explained < MIN_EXPLAINED else bands


def side_of(corners: Points) -> float:
    """The root of the area of corners (4,)."""
    return math.sqrt(abs(areas(corners)))
