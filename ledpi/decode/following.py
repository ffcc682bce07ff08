"""Follows a panel by its own picture, at the price of a glance: nothing is fitted anew but where it is.

Bands are faint and its ID is known, so are the cells that show each wave. A fit is asked again where the picture no
longer explains the light as well, or something may hide a side.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ledpi.core.records import Floats, Frame, PanelSpec, Quad, read_only
from ledpi.decode.evidence.evidence import RARE_Z
from ledpi.decode.model.fit import EACH_FIT, Fitter
from ledpi.decode.model.light import Window
from ledpi.decode.model.panel import Followed
from ledpi.decode.model.picture import PanelPicture, mean_of

REACH = 0.1  # of the side, around a panel: how far off a proposal may be
# Fits that a picture is the mean of, before the first frame that is followed and later: what one is off, and does not
# say, all frames to come would be.
FEWEST_FITS, MOST_FITS = 4, 8
# Frames; then a fit makes the mean better, and sees what hides a side or what else has changed. It costs as much as
# following the panel in ten frames.
FOLLOWED = 16
# Of a side's length. An edge as wide as its blur is, in cells, then is off by 0.001 of the light beyond what its slope
# by the blur says: a quarter of a grey level.
MOST_CHANGE = 1.07
# Of the light's squares: what a panel's picture leaves has a deviation of less than a third of the light's own.
MIN_EXPLAINED_FINELY = 0.9


def shares_of(cell_bands: Floats) -> Floats:
    """(cells, waves) of each wave in what cells show, by the bands (cells, P) that they were read by: −1, 0 or 1."""
    pairs = cell_bands.reshape(len(cell_bands), -1, 2)
    most = np.square(pairs).sum(axis=2).argmax(axis=0)
    usual = pairs[most, np.arange(pairs.shape[1])]
    return np.asarray(np.rint((pairs * usual).sum(axis=2) / np.maximum(np.square(usual).sum(axis=1), 1e-12)))


class Follower:
    """Follows the panels of one camera."""

    def __init__(self, fitter: Fitter) -> None:
        self._fitter = fitter

    def begin(
        self, frame: Frame, quad: Quad, fits: Sequence[Floats], spec: PanelSpec, cell_bands: Floats
    ) -> PanelPicture | None:
        """The picture of a panel that was fitted in this frame, and read by these bands; None where it has none yet.

        `fits`: the unknowns of its last fits, with this one.
        """
        if len(fits) < FEWEST_FITS or quad.lattice_px is None or quad.hidden is not None:
            return None
        window = Window.crop(frame, quad.lattice_px, REACH)
        if window is None:
            return None
        taken = PanelPicture.taken(self._fitter, frame, window, quad, spec, shares_of(cell_bands), mean_of(fits))
        found = None if taken is None else self._look(frame, window, quad.lattice_px, taken)
        if taken is None or found is None or not found.variance > 0.0:
            return None
        return replace(taken, variance=found.variance)  # that it leaves of the very light

    def follow(self, frame: Frame, corners_px: Floats, picture: PanelPicture) -> tuple[Quad, PanelPicture] | None:
        """The panel whose lattice is near these corners (4, 2), and the picture with this frame; None: ask a fit."""
        if picture.frames >= FOLLOWED or not _is_alike(corners_px, picture.lattice_px):
            return None
        window = Window.cut(frame, corners_px, REACH, picture.window.shrink)
        found = None if window is None else self._look(frame, window, corners_px, picture)
        if found is None or not found.settled or not found.explained >= MIN_EXPLAINED_FINELY or any(found.hidden):
            return None
        ratio = found.variance / picture.variance
        at_chance = ratio < 1.0 + RARE_Z * math.sqrt(4.0 / picture.independent)
        if not (at_chance and math.isfinite(found.lit.sum() + found.covariance.sum())):
            return None
        quad = Quad(
            corners_px=read_only(found.lit),
            lattice_px=read_only(found.lattice),
            covariance_px2=read_only(max(1.0, ratio) * found.covariance),
            unknown=picture.unknown,
            residual=ratio * picture.residual,
        )
        return quad, replace(picture, frames=picture.frames + 1)

    def _look(self, frame: Frame, window: Window, corners_px: Floats, picture: PanelPicture) -> Followed | None:
        window = replace(window, dark=picture.window.dark, bright=picture.window.bright)
        spec = picture.spec
        found = self._fitter.solver.follow(
            picture.picture,
            **self._fitter.view(window),
            cells=math.isqrt(len(picture.shares)),
            cycles_a_row=tuple(hz * frame.row_time_us * 1e-6 for hz in (spec.black_hz, spec.white_hz)),
            corners=corners_px.reshape(-1).tolist(),
            unknown=picture.unknown,
        )
        self._fitter.sampled += EACH_FIT + (0 if found is None else found.sampled)
        return found


def _is_alike(corners_px: Floats, others_px: Floats) -> bool:
    """Tells whether the sides of two squares (4, 2) are about as long."""
    sides = zip(*(_sides(at.tolist()) for at in (corners_px, others_px)), strict=True)
    return all(1.0 / MOST_CHANGE < one / other < MOST_CHANGE for one, other in sides)


def _sides(corners: list[list[float]]) -> list[float]:
    return [math.dist(at, corners[k - 1]) for k, at in enumerate(corners)]
