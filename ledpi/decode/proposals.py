"""Proposes candidates: rough squares, often wrong, rarely missing. The fit decides which of them are panels."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np

from ledpi.core.records import CameraInfo, Floats, Frame, PanelSpec, Rejected, read_only
from ledpi.decode.evidence.cells import MIN_CELL_PX
from ledpi.decode.evidence.waves import band_depth, dimmest
from ledpi.decode.finding.find import MOST_SQUARES, Glancer, LatticeSearcher
from ledpi.decode.finding.glance import template
from ledpi.decode.finding.outlines import Finder

DEEP = 0.5  # depth of bands that cut a panel into pieces
# A frame's candidates may lead to so many fits of what is none: with evidence of ln(N / WASTED) or more, texture gets
# past in WASTED of N cases at most (Wald 1945).
WASTED = 1.0
# What finding costs, in places of a fit: a place for so many pixels, and so many for each candidate that is kept.
PIXELS_A_PLACE, EACH_CANDIDATE = 15, 300
AT_ONCE = 64  # candidates that a frame of a stream looks at: no dearer than finding them is
GAMMA = 2.2  # of grey levels, where they are not linear in light: then a dark band is darker still


class Candidate(NamedTuple):
    """A rough square."""

    corners_px: Floats  # (4, 2), clockwise as seen in the picture
    side_px: float
    dark_rows: int = 0  # of a band that may hide its upper or lower end
    evidence: float = math.inf  # of a panel at a glance, in nats, beyond what chance gives of so many candidates

    @property
    def likely(self) -> bool:
        """Tells whether it is worth a fit."""
        return self.evidence > 0.0

    def moved_ends(self) -> list[Floats]:
        """Its corners (4, 2) with the upper end, the lower one, or both a third of a dark band further up or down."""
        if not self.dark_rows:
            return []
        x, y = self.corners_px.T
        lower, rows = (y - y.min()) / max(float(np.ptp(y)), 1e-9), self.dark_rows / 3.0
        moves = ((1, 0), (0, 1), (-1, 0), (0, -1), (1, 1), (-1, -1))
        ends = [y + rows * (a * (1.0 - lower) + b * lower) for a, b in moves]
        return [np.column_stack([x, at]) for at in ends]


class Proposer:
    """Proposes panels of `cells` × `cells` in the frames of one camera. Keeps the pictures that it works on."""

    def __init__(self, camera: CameraInfo, cells: int, specs: Sequence[PanelSpec]) -> None:
        smallest_px = cells * MIN_CELL_PX
        self._cells, self._specs = cells, tuple(specs)
        self._outlines = Finder(camera.width, camera.height, smallest_px, cells)
        self._lattices = [LatticeSearcher(camera.height, camera.width, cells) for _ in range(2)]  # one a picture
        self._glancer = Glancer(cells, smallest_px, template(cells))
        self.sampled = 0  # places that all frames so far have cost

    def propose(self, frame: Frame, turn: int | None = None) -> tuple[list[Candidate], list[Rejected]]:
        """Distinct candidates, the largest first, as a texture's are small; and what was dropped.

        A frame of a stream, which has a `turn`, has some of them where there are many; the next frames have the others.

        Where bands are deep a glance sees how far their light changes, not where a panel ends: corners stay as found.
        """
        band_rows = self._band_rows(frame)
        pictures = [frame] if band_rows is None else _bridged(frame, band_rows)
        found, dropped = list[Floats](), list[Rejected]()
        for searcher, seen in reversed([*zip(self._lattices, pictures, strict=False)]):  # the first is looked at last
            outlines, refused = self._outlines.find(seen)
            found += [searcher.search(self._outlines.pyramid(seen)), outlines.copy()]
            dropped += refused
        pyramid, bridged = self._outlines.pyramid(pictures[0]), None if band_rows is None else frame.pixels
        dimmed, at_once = (
            dimmest(frame, self._specs) ** (1.0 / GAMMA),
            MOST_SQUARES if turn is None else AT_ONCE,
        )
        looked = self._glancer.look(pyramid, found, bridged, dimmed, at_once=at_once, turn=turn or 1)
        corners, sides, evidence = (each.copy() for each in looked)
        self.sampled += len(pictures) * frame.pixels.size // PIXELS_A_PLACE + EACH_CANDIDATE * len(sides)
        unlikely = math.log(max(len(sides), 1) / WASTED)
        return [
            Candidate(read_only(at), side, band_rows or 0, nats)
            for at, side, nats in zip(corners, sides.tolist(), (evidence - unlikely).tolist(), strict=True)
        ], dropped

    def _band_rows(self, frame: Frame) -> int | None:
        """Rows of the longest dark band, where bands are so deep that they cut a panel into pieces."""
        if band_depth(frame, self._specs) <= DEEP:
            return None
        slowest = min(hz for spec in self._specs for hz in spec.waves_hz)
        return 1 + math.ceil(0.5e6 / (slowest * abs(frame.row_time_us)))


def _bridged(frame: Frame, band_rows: int) -> list[Frame]:
    """Returns how far each pixel's column goes from dark to bright within a band, and how bright it is there at most.

    Nothing that is steady shows in the first. Both reach up to a band too far up and down, where a panel ends in a
    bright one: half of that is taken off.
    """
    column = np.ones((band_rows, 1), np.uint8)
    brightest = cv2.dilate(frame.pixels, column)
    change = cv2.subtract(brightest, cv2.erode(frame.pixels, column))
    half = column[: band_rows // 2]
    return [replace(frame, pixels=cv2.erode(each, half)) for each in (change, brightest)]
