"""The panels that a picture may show: proposed anywhere in it, or near where they are expected, then fitted."""

from __future__ import annotations

import math
from collections.abc import Sequence

import cv2
import numpy as np

from ledpi.decode.cells import MIN_CELL_PX
from ledpi.decode.finding.find import Candidate, Finder
from ledpi.decode.finding.lattices import LatticeFinder
from ledpi.decode.model.fit import Effort, Fitted, Fitter
from ledpi.decode.model.light import Window
from ledpi.geometry import quad_side
from ledpi.kernels import pose as kernel
from ledpi.records import CameraInfo, Floats, Frame, Intrinsics, PanelSpec, Quad, Rejected
from ledpi.shutter import contrast

NO_LIGHT = Rejected(stage="fit", reason="no_light")
DIVERGED = Rejected(stage="fit", reason="diverged")
MISFIT = Rejected(stage="fit", reason="misfit")
UNCERTAIN = Rejected(stage="fit", reason="uncertain")
DUPLICATE = Rejected(stage="fit", reason="duplicate")

REACH = 0.1  # of the side, around what is proposed
FIRST, LAST = Effort(rounds=8, roughly=True), Effort(rounds=10, reweightings=2)
MIN_EXPLAINED = 0.5  # of the light's squares: what explains less than it leaves is no model of it
MAX_SIGMA = 1.0 / 8.0  # of a cell: further off, slopes no longer tell what a shift does to a cell's light
SAME = 0.5  # of a cell: squares whose corners are no further apart show the same cells
# Bands that are so deep cut a panel into pieces: they are bridged before it is sought.
DEEP = 0.5


class Squares:
    """Of panels of `cells` × `cells` in the frames of one camera. Keeps the pictures that it works on."""

    def __init__(
        self, camera: CameraInfo, cells: int, specs: tuple[PanelSpec, ...], intrinsics: Intrinsics | None
    ) -> None:
        self._cells, self._specs, self._intrinsics = cells, specs, intrinsics
        self._finder = Finder(camera.width, camera.height, cells * MIN_CELL_PX, cells)
        self._lattices = LatticeFinder(cells)
        self._fitter = Fitter(cells, intrinsics)

    def near(self, frame: Frame, expected: Sequence[Floats]) -> list[Quad | Rejected]:
        """The panel near each of these corners (4, 2), or why there is none."""
        return [self._quad(self._fitted(frame, at, LAST)) for at in expected]

    def candidates(self, frame: Frame) -> tuple[list[Candidate], list[Rejected]]:
        """What may be a panel, and what was dropped."""
        bridged = self._bridged(frame)
        found, dropped = self._finder.find(bridged)
        again, dropped_too = self._finder.find_again()
        lattices = [_candidate(at) for at in self._lattices.find(self._finder.pyramid(bridged))]
        return lattices + found + again, dropped + dropped_too

    def _bridged(self, frame: Frame) -> Frame:
        """The frame without its dark bands, where these are deep: each pixel as bright as any within a dark band."""
        depths = [contrast(hz, frame.exposure_us, s.duty) / 2.0 for s in self._specs for hz in s.waves_hz]
        if max(depths) < DEEP:
            return frame
        slowest = min(min(s.waves_hz) for s in self._specs)
        rows = 1 + math.ceil(0.5e6 / (slowest * frame.row_time_us))
        return _with_pixels(frame, cv2.dilate(frame.pixels, np.ones((rows, 1), np.uint8)))

    def of(self, frame: Frame, candidates: list[Candidate]) -> list[tuple[Floats, Quad | Rejected]]:
        """The panel of each candidate, or why there is none, beside the corners (4, 2) where it was sought."""
        fits: list[Fitted] = []
        results = [(candidate.corners, self._distinct(frame, candidate.corners, fits)) for candidate in candidates]
        order = sorted(results, key=lambda each: -each[1].power if isinstance(each[1], Fitted) else 0.0)
        return [(at, self._quad(fit)) for at, fit in order]

    def _distinct(self, frame: Frame, at: Floats, fits: list[Fitted]) -> Fitted | Rejected:
        """The panel near corners (4, 2), if it is none of `fits`, to which it is added."""
        for effort in (FIRST, LAST):
            if any(self._are_same(at, other.lattice_px) for other in fits):
                return DUPLICATE
            fit = self._fitted(frame, at, effort)
            if isinstance(fit, Rejected):
                return fit
            at = fit.lattice_px
        if any(self._are_same(at, other.lattice_px) for other in fits):
            return DUPLICATE
        fits.append(fit)
        return fit

    def _are_same(self, corners: Floats, others: Floats) -> bool:
        """Whether squares (4, 2), in whichever order of their corners, are of the same cells."""
        return min(
            float(np.abs(np.roll(corners, turn, axis=0) - others).max()) for turn in range(4)
        ) < SAME * quad_side(others.tolist()) / self._cells

    def _fitted(self, frame: Frame, at: Floats, effort: Effort) -> Fitted | Rejected:
        if not quad_side(at.tolist()) >= self._cells * MIN_CELL_PX:
            return UNCERTAIN
        window = Window.around(frame, at, REACH)
        if window is None:
            return NO_LIGHT
        fits = [self._fitter.fit(frame, window, at, spec, effort) for spec in self._specs]
        best = max((fit for fit in fits if fit is not None), key=lambda fit: fit.explained, default=None)
        if best is None:
            return DIVERGED
        if best.explained < MIN_EXPLAINED:
            return MISFIT
        side_px = quad_side(best.corners_px.tolist())
        sigma_px = math.sqrt(float(np.trace(best.covariance_px2)) / 8.0)
        if not (side_px >= self._cells * MIN_CELL_PX and sigma_px < MAX_SIGMA * side_px / self._cells):
            return UNCERTAIN
        return best

    def _quad(self, fit: Fitted | Rejected) -> Quad | Rejected:
        if isinstance(fit, Rejected):
            return fit
        first = int(np.argmin(fit.corners_px.sum(axis=1)))
        turned = (np.arange(4) + first) % 4
        corners, lattice = fit.corners_px[turned], fit.lattice_px[turned]
        covariance = fit.covariance_px2.reshape(4, 2, 4, 2)[turned][:, :, turned].reshape(8, 8)
        return Quad(
            corners_px=corners,
            lattice_px=lattice,
            corner_sigma_px=math.sqrt(float(np.trace(covariance)) / 8.0),
            bend_px=0.0 if self._intrinsics is None else _bend_px(corners, self._intrinsics),
        )


def _candidate(corners: Floats) -> Candidate:
    side_px = quad_side(corners.tolist())
    return Candidate(corners, side_px, 0.1 * side_px)


def _with_pixels(frame: Frame, pixels: np.ndarray) -> Frame:
    from dataclasses import replace

    return replace(frame, pixels=pixels)


def _bend_px(corners: Floats, lens: Intrinsics) -> float:
    """How far the lens bends the square's sides off the straight line, at most."""
    if not any(lens.distortion):
        return 0.0
    return float(np.abs(kernel.bends(corners.view(np.complex128).reshape(1, 4).copy(), lens).imag).max())
