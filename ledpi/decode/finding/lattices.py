"""Panels whose cells are seen one by one: lattices of blobs that are brighter than what is around them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray

from ledpi.core.records import Floats, Pixels
from ledpi.kernels.find import LatticeSearcher

# Pixels along the neighbourhoods that a blob is compared with: one shows cells of a third to all of that. Before a
# bright wall only the smaller one ends within the panel. Pictures are an octave apart.
AROUND = (17, 9)
CONTRAST = 4  # grey levels: twice what read-out noise leaves of a mean over a few pixels
MIN_SEEN = 0.6  # of the cells: others may be dead, hidden, or one with their neighbours
LEDS = (1, 2, 3)  # along a cell: each may be seen by itself
BESIDE = 2  # rows of other spots that may continue a lattice of cells: one on each side


class LatticeFinder:
    """Of panels of `cells` × `cells`."""

    def __init__(self, cells: int) -> None:
        self._cells, self._searcher = cells, LatticeSearcher()

    def find(self, pyramid: Sequence[Pixels]) -> list[Floats]:
        """Corners (4, 2) in the frame, the pyramid's first picture; each further one is half of the one before.

        Cells of 3 to 8 pixels are seen in a picture of twice the size.
        """
        found: list[Floats] = []
        least = int(MIN_SEEN * self._cells * self._cells)
        doubled = cv2.resize(pyramid[0], None, fx=2, fy=2, interpolation=cv2.INTER_LINEAR)
        for (halvings, picture), near in product(enumerate([doubled, *pyramid], -1), AROUND):
            around = cv2.blur(picture, (near, near))
            blobs, lattices = self._searcher.search(picture, around, CONTRAST, 2.0 * near * near, least)
            for lattice in lattices:
                found += [(at + 0.5) * 2.0**halvings - 0.5 for at in self._panels(lattice, blobs[:, 1:3])]
        return found

    def _panels(self, lattice: NDArray[np.int32], middles: Floats) -> Iterator[Floats]:
        """Corners (4, 2) of each panel that a lattice of its cells, or of the LEDs in them, may be.

        Several where rows are not seen, or where something continues them. A larger lattice of LEDs is none: it has so
        many rows that chance continues none of them.
        """
        down, across = np.nonzero(lattice >= 0)
        at = middles[lattice[down, across]]
        for leds in LEDS:
            side = self._cells * leds
            ranges = []
            for nodes in (across, down):
                low, high = int(nodes.min()), int(nodes.max())
                few = high - low < side + (BESIDE if leds == 1 else 0)
                ranges.append(range(min(low, high - side + 1), max(low, high - side + 1) + 1) if few else range(0))
            for left, top in product(*ranges):
                own = (across >= left) & (across < left + side) & (down >= top) & (down < top + side)
                if own.sum() < MIN_SEEN * side * side:
                    continue
                places = np.stack([across[own] - left + 0.5, down[own] - top + 0.5], axis=1) / leds
                corners = _corners(places, at[own], self._cells)
                if corners is not None:
                    yield corners


def _corners(places: Floats, at: Floats, cells: int) -> Floats | None:
    """(4, 2) of the square of `cells` × `cells` whose places (N, 2) are seen at `at` (N, 2)."""
    homography, _ = cv2.findHomography(places, at, 0)
    if homography is None:
        return None
    square = np.array([[[0, 0], [cells, 0], [cells, cells], [0, cells]]], np.float64)
    corners: Floats = cv2.perspectiveTransform(square, homography)[0]
    if not np.isfinite(corners).all():
        return None
    (ax, ay), (bx, by), (cx, cy), (dx, dy) = corners.tolist()
    clockwise = (cx - ax) * (dy - by) - (dx - bx) * (cy - ay) > 0
    return corners if clockwise else corners[::-1].copy()
