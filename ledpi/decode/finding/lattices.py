"""Panels whose cells are seen one by one: lattices of blobs that are brighter than what is around them."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray

from ledpi.core.records import Floats, Integers, Pixels
from ledpi.kernels.find import LatticeSearcher

# Pixels along the neighbourhoods that a blob is compared with: one shows cells of a third to all of that. Before a
# bright wall only the smaller one ends within the panel. Pictures are an octave apart.
AROUND = (17, 9)
CONTRAST = 4  # grey levels: twice what read-out noise leaves of a mean over a few pixels
MIN_SEEN = 0.6  # of the cells: others may be dead, hidden, or one with their neighbours
LEDS = (1, 2, 3)  # along a cell: each may be seen by itself
RIGHT, LOWER = np.array([0, 1, 1, 0]), np.array([0, 0, 1, 1])  # of a square's corners
PASSES = 3  # in which a homography's weights settle
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
            above = cv2.subtract(picture, around, dst=around)
            _, lit = cv2.threshold(above, CONTRAST, 255, cv2.THRESH_BINARY, dst=above)
            blobs, lattices = self._searcher.search(lit, 2.0 * near * near, least)
            for lattice in lattices:
                found += [(at + 0.5) * 2.0**halvings - 0.5 for at in self._panels(lattice, blobs[:, 1:3])]
        return found

    def _panels(self, lattice: NDArray[np.int32], middles: Floats) -> Floats:
        """Corners (K, 4, 2) of each panel that a lattice of its cells, or of the LEDs in them, may be.

        Several where rows are not seen, or where something continues them. A larger lattice of LEDs is none: it has so
        many rows that chance continues none of them.
        """
        down, across = np.nonzero(lattice >= 0)
        squares, owns = [np.empty((0, 4, 2))], [np.empty((0, len(down)), np.bool_)]
        for side in (self._cells * leds for leds in LEDS if len(down) >= MIN_SEEN * (self._cells * leds) ** 2):
            (left, within), (top, below) = (_windows(nodes, side, self._cells) for nodes in (across, down))
            own = within[:, None] & below
            seen = own.sum(axis=2) >= MIN_SEEN * side * side
            k, n = np.nonzero(seen)
            squares.append(np.stack([left[k, None] + side * RIGHT, top[n, None] + side * LOWER], axis=-1) - 0.5)
            owns.append(own[seen])
        if sum(map(len, owns)) == 0:
            return squares[0]
        nodes = np.stack([across, down], axis=1).astype(float)
        return _seen(np.concatenate(squares), nodes, middles[lattice[down, across]], np.concatenate(owns))


def _windows(nodes: Integers, side: int, cells: int) -> tuple[Integers, NDArray[np.bool_]]:
    """Where `side` rows may begin (W,), and which nodes (N,) are in them (W, N).

    Nodes are seen in no more rows than that, and those BESIDE it.
    """
    low, high = int(nodes.min()), int(nodes.max())
    few = high - low < side + (BESIDE if side == cells else 0)
    one, other = sorted((low, high - side + 1))
    firsts = np.arange(one, other + 1 if few else one)
    return firsts, (nodes >= firsts[:, None]) & (nodes < firsts[:, None] + side)


def _seen(squares: Floats, nodes: Floats, at: Floats, owns: NDArray[np.bool_]) -> Floats:
    """Where squares (K, 4, 2) are seen, clockwise, each by its `owns` (K, N) of the nodes (N, 2), which are seen `at`.

    Those that reach beyond the horizon are left out.
    """
    (middle, spread), (centre, reach) = ((points.mean(axis=0), points.std()) for points in (at, nodes))
    homographies = _homographies((nodes - centre) / reach, (at - middle) / spread, owns)
    corners = np.concatenate([(squares - centre) / reach, np.ones((*squares.shape[:2], 1))], axis=-1)
    x, y, w = np.moveaxis(corners @ homographies.transpose(0, 2, 1), -1, 0)
    whole = np.abs(np.sign(w).sum(axis=1)) == len(RIGHT)
    seen: Floats = middle + spread * np.stack([x, y], axis=-1)[whole] / w[whole, :, None]
    (ax, ay), (bx, by), (cx, cy), (dx, dy) = np.moveaxis(seen, 0, -1)
    clockwise = (cx - ax) * (dy - by) - (dx - bx) * (cy - ay) > 0
    return np.where(clockwise[:, None, None], seen, seen[:, ::-1])


def _homographies(nodes: Floats, at: Floats, owns: NDArray[np.bool_]) -> Floats:
    """(K, 3, 3) of least error in the picture, from nodes (N, 2) to where they are seen `at`, each by those it `owns`.

    All at once, as there are a hundred in a frame. The algebraic error (Hartley and Zisserman, Multiple View Geometry,
    4.1) over a point's depth is the geometric one, and depths are known after a first pass.
    """
    source = np.hstack([nodes, np.ones((len(nodes), 1))])
    rows = np.zeros((2, len(nodes), 9))
    for k in range(2):
        rows[k, :, 3 * k : 3 * k + 3] = source
        rows[k, :, 6:] = -at[:, k, None] * source
    products, weights = rows[..., :, None] * rows[..., None, :], owns.astype(float)
    for _ in range(PASSES):
        normal = np.einsum("kn,anij->kij", weights, products)
        homographies = np.linalg.eigh(normal)[1][:, :, 0].reshape(-1, 3, 3)
        depths = homographies[:, 2] @ source.T
        weights = owns / np.maximum(depths * depths, 1e-12)
    return homographies
