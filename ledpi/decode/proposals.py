"""Proposes candidates: rough squares, often wrong, rarely missing. The fit decides which of them are panels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np

from ledpi.core.geometry import corners_apart, quad_side
from ledpi.core.records import CameraInfo, Floats, Frame, PanelSpec, Rejected
from ledpi.decode.cells import MIN_CELL_PX
from ledpi.decode.evidence.waves import band_depth
from ledpi.decode.finding.outlines import Finder
from ledpi.kernels.find import LatticeSearcher

DEEP = 0.5  # depth of bands that cut a panel into pieces
SAME = 0.25  # of a cell: proposals no further apart lead to the same fit
MOST = 256  # proposals of a frame: what has more is texture


class Candidate(NamedTuple):
    """A rough square."""

    corners_px: Floats  # (4, 2), clockwise as seen in the picture
    side_px: float
    dark_rows: int = 0  # of a band that may hide its upper or lower end

    @classmethod
    def from_corners(cls, corners_px: Floats, dark_rows: int = 0) -> Candidate:
        """The candidate with these corners (4, 2)."""
        return cls(corners_px, quad_side(corners_px.tolist()), dark_rows)

    def moved_ends(self) -> list[Candidate]:
        """The same with the upper end, the lower one, or both a third of a dark band further up or down."""
        if not self.dark_rows:
            return []
        x, y = self.corners_px.T
        lower, rows = (y - y.min()) / max(float(np.ptp(y)), 1e-9), self.dark_rows / 3.0
        moves = ((1, 0), (0, 1), (-1, 0), (0, -1), (1, 1), (-1, -1))
        ends = [y + rows * (a * (1.0 - lower) + b * lower) for a, b in moves]
        return [Candidate.from_corners(np.column_stack([x, at])) for at in ends]


class Proposer:
    """Proposes panels of `cells` × `cells` in the frames of one camera. Keeps the pictures that it works on."""

    def __init__(self, camera: CameraInfo, cells: int, specs: Sequence[PanelSpec]) -> None:
        self._cells, self._specs = cells, tuple(specs)
        self._outlines = Finder(camera.width, camera.height, cells * MIN_CELL_PX, cells)
        self._lattices = LatticeSearcher(camera.height, camera.width, cells)

    def propose(self, frame: Frame) -> tuple[list[Candidate], list[Rejected]]:
        """Distinct candidates, the largest first, as a texture's are small; and what was dropped."""
        band_rows = self._band_rows(frame)
        found, dropped = list[Floats](), list[Rejected]()
        for seen in [frame] if band_rows is None else _bridged(frame, band_rows):
            outlines, refused = self._outlines.find(seen)
            found += [*self._lattices.search(self._outlines.pyramid(seen)).copy(), *outlines]
            dropped += refused
        ranked = sorted(found, key=lambda at: -quad_side(at.tolist()))
        return self._distinct(ranked[:MOST], band_rows or 0), dropped

    def _band_rows(self, frame: Frame) -> int | None:
        """Rows of the longest dark band, where bands are so deep that they cut a panel into pieces."""
        if band_depth(frame, self._specs) <= DEEP:
            return None
        slowest = min(hz for spec in self._specs for hz in spec.waves_hz)
        return 1 + math.ceil(0.5e6 / (slowest * abs(frame.row_time_us)))

    def _distinct(self, ranked: list[Floats], dark_rows: int) -> list[Candidate]:
        """The candidates that are large enough, of those that lead to one fit the first."""
        candidates = [Candidate.from_corners(at, dark_rows) for at in ranked]
        candidates = [one for one in candidates if one.side_px >= self._cells * MIN_CELL_PX]
        if not candidates:
            return []
        sides, corners = np.array([one.side_px for one in candidates]), np.stack([one.corners_px for one in candidates])
        near_px = SAME * sides[:, None] / self._cells
        middles = corners.mean(axis=1)
        close = np.abs(sides[:, None] - sides) < 2 * near_px
        close &= np.hypot(*(middles[:, None] - middles).transpose(2, 0, 1)) < near_px
        kept = np.ones(len(candidates), np.bool_)
        for one, other in np.argwhere(np.tril(close, -1)).tolist():
            if kept[one] and kept[other]:
                kept[one] = corners_apart(corners[one].tolist(), corners[other].tolist()) >= near_px[one, 0]
        return [one for one, keep in zip(candidates, kept, strict=True) if keep]


def _bridged(frame: Frame, band_rows: int) -> list[Frame]:
    """How far each pixel's column goes from dark to bright within a band, which shows nothing that is steady; and how
    bright it is at most there.

    Both reach up to a band too far up and down, where a panel ends in a bright one: half of that is taken off.
    """
    column = np.ones((band_rows, 1), np.uint8)
    brightest = cv2.dilate(frame.pixels, column)
    change = cv2.subtract(brightest, cv2.erode(frame.pixels, column))
    half = column[: band_rows // 2]
    return [replace(frame, pixels=cv2.erode(each, half)) for each in (change, brightest)]
