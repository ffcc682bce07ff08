"""Where panels may be: rough squares, wrong often, missing rarely. What is one is for the fit to say."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np

from ledpi.decode.cells import MIN_CELL_PX
from ledpi.decode.finding.find import Finder
from ledpi.decode.finding.lattices import LatticeFinder
from ledpi.geometry import corners_apart, quad_side
from ledpi.records import CameraInfo, Floats, Frame, PanelSpec, Rejected
from ledpi.shutter import contrast

DEEP = 0.5  # depth of bands that cut a panel into pieces
SAME = 0.25  # of a cell: proposals no further apart lead to the same fit
MOST = 256  # proposals of a frame: what has more is texture


class Candidate(NamedTuple):
    """A rough square."""

    corners_px: Floats  # (4, 2), clockwise as seen in the picture
    side_px: float

    @classmethod
    def of(cls, corners_px: Floats) -> Candidate:
        """The candidate with these corners (4, 2)."""
        return cls(corners_px, quad_side(corners_px.tolist()))


class Proposer:
    """Proposes panels of `cells` × `cells` in the frames of one camera. Keeps the pictures that it works on."""

    def __init__(self, camera: CameraInfo, cells: int, specs: Sequence[PanelSpec]) -> None:
        self._cells, self._specs = cells, tuple(specs)
        self._outlines = Finder(camera.width, camera.height, cells * MIN_CELL_PX, cells)
        self._lattices = LatticeFinder(cells)

    def propose(self, frame: Frame) -> tuple[list[Candidate], list[Rejected]]:
        """Distinct candidates, best first; and what was dropped.

        Lattices of cells come first, as nothing but cells makes them. Then outlines by grey levels, and by contrast.
        """
        bridged = self._bridged(frame)
        outlines, dropped = self._outlines.find(bridged)
        again, dropped_too = self._outlines.find_again()
        lattices = self._lattices.find(self._outlines.pyramid(bridged))
        every = [Candidate.of(at) for at in (*lattices, *outlines, *again)]
        return self._distinct(every[:MOST]), dropped + dropped_too

    def _bridged(self, frame: Frame) -> Frame:
        """The frame without its dark bands, where these are deep: each pixel as bright as any within half a band."""
        depths = [contrast(hz, frame.exposure_us, spec.duty) / 2.0 for spec in self._specs for hz in spec.waves_hz]
        if max(depths) < DEEP:
            return frame
        slowest = min(hz for spec in self._specs for hz in spec.waves_hz)
        rows = 1 + math.ceil(0.5e6 / (slowest * frame.row_time_us))
        return replace(frame, pixels=cv2.dilate(frame.pixels, np.ones((rows, 1), np.uint8)))

    def _distinct(self, candidates: list[Candidate]) -> list[Candidate]:
        kept: list[Candidate] = []
        for one in candidates:
            near_px = SAME * one.side_px / self._cells
            corners = one.corners_px.tolist()
            if one.side_px >= self._cells * MIN_CELL_PX and not any(
                abs(one.side_px - other.side_px) < 2 * near_px
                and corners_apart(corners, other.corners_px.tolist()) < near_px
                for other in kept
            ):
                kept.append(one)
        return kept
