"""Squares in the pictures of a pyramid (find.c), and lattices of blobs (blobs.c, lattices.c)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from ledpi.core.records import Floats, Pixels
from ledpi.kernels.library import ffi, lib, pointer

MOST_SQUARES = 4096  # in a frame: more is texture, and would take a second to look at
MOST_RUNS, MOST_BLOBS, MOST_LATTICES = 40_000, 1_500, 12  # of a picture: what has more is texture

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
    """Finds lattices of bright blobs, in room that it keeps."""

    def __init__(self) -> None:
        span = lib.LEDPI_LATTICE_SPAN
        self._runs = np.empty((MOST_RUNS, lib.LEDPI_BLOB_RUN), np.int32)
        self._sums = np.empty((MOST_RUNS, lib.LEDPI_BLOB))
        self._blobs, self._used = np.empty((MOST_BLOBS, lib.LEDPI_BLOB)), np.empty(MOST_BLOBS, np.uint8)
        self._lattices = np.empty((MOST_LATTICES, span, span), np.int32)

    def search(self, lit: Pixels, most_area: float, least: int) -> tuple[Floats, NDArray[np.int32]]:
        """Blobs (B, 6), x and y second and third; and lattices (L, span, span) of at least `least`, by number or −1.

        Of what is `lit` (H, W), 0 or 255. Both are the searcher's own.
        """
        count = lib.ledpi_blobs(
            *(pointer(lit), *lit.shape, most_area),
            *(MOST_RUNS, pointer(self._runs), pointer(self._sums), MOST_BLOBS, pointer(self._blobs)),
        )
        found = lib.ledpi_lattices(
            *(pointer(self._blobs), count, least, pointer(self._used), MOST_LATTICES, pointer(self._lattices))
        )
        return self._blobs[:count], self._lattices[:found]
