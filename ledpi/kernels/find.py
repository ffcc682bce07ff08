"""Squares in the pictures of a pyramid (find.c), and panels by the lattices of their cells (lattice_squares.c)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

from ledpi.core.records import Floats, Pixels
from ledpi.kernels.library import ffi, lib, pointer

MOST_SQUARES = 4096  # in a frame: more is texture, and would take a second to look at
MOST_LATTICE_SQUARES = 1024

# A picture, the shortest way around things in it, grey levels that what is lit is brighter than, and shares of the
# contrast by which it is, in 256ths.
Level: TypeAlias = tuple[Pixels, int, tuple[int, ...], tuple[int, ...]]


class SquareSearcher:
    """Searches the same pictures again and again, in room that it keeps."""

    def __init__(self, levels: Sequence[Level], smallest_px: float, cells: int, limits: Sequence[float]) -> None:
        """`levels`: pictures are read anew each time, the largest first. `limits`: as in decode/finding/outlines.py."""
        self._kept = tuple(levels)
        self._room = np.empty(lib.ledpi_find_room(*levels[0][0].shape), np.uint8)
        self._squares = np.empty((MOST_SQUARES, lib.LEDPI_SQUARE))
        self._distinct = np.empty(MOST_SQUARES, np.int64)
        self._result = ffi.new("FindResult *", (pointer(self._squares), pointer(self._distinct), MOST_SQUARES))
        self._wanted = ffi.new("FindWanted *", (smallest_px, cells, tuple(limits)))
        self._levels = ffi.new("FindLevel[]", len(levels))
        for number, (picture, shortest, brighter_than, lit_by) in enumerate(levels):
            sizes = (*picture.shape, 2 << number, len(brighter_than), len(lit_by))
            self._levels[number] = (pointer(picture), *sizes, brighter_than, lit_by, shortest)

    def search(self) -> tuple[Floats, tuple[int, int, int]]:
        """Distinct squares (K, LEDPI_SQUARE), the best first; and how many outlines touch the picture's border, show
        no square, or show one that is too small.
        """
        found = self._result
        lib.ledpi_find(self._levels, len(self._kept), self._wanted, pointer(self._room), found)
        squares = self._squares[self._distinct[: found.distinct_count]]
        return squares, (found.at_border, found.not_four_sided, found.too_small)


class LatticeSearcher:
    """Finds lattices of cells in the pictures of a pyramid, in room that it keeps."""

    def __init__(self, height: int, width: int, cells: int) -> None:
        """`height`, `width`: of the largest picture. `cells`: along a panel's side."""
        self._cells, self._room = cells, np.empty(lib.ledpi_lattice_room(height, width), np.uint8)
        self._corners = np.empty((MOST_LATTICE_SQUARES, 4, 2))

    def search(self, pyramid: Sequence[Pixels]) -> Floats:
        """Corners (K, 4, 2) of what may be panels, in the picture that the `pyramid` begins with; until the next.

        Each further picture is half of the one before.
        """
        pictures = [(pointer(picture), *picture.shape) for picture in pyramid]
        count = lib.ledpi_lattice_squares(
            *(ffi.new("PyramidPicture[]", pictures), len(pictures), self._cells),
            *(pointer(self._room), len(self._corners), pointer(self._corners)),
        )
        return self._corners[:count]
