"""Outlines of lit, four-sided things: a panel is brighter than what is next to it, and has four sides.

On a picture shrunk far enough the cells of a panel melt into one, so this is done on a pyramid: what is brighter than
each of some grey levels, or than its neighbourhood (threshold.c), has outlines (outlines.c), some of these four
sides (four_sides.c), and what is found twice is one thing (suppression.c).
"""

from __future__ import annotations

from typing import NamedTuple

from ledpi.core.records import Floats, Frame, Pixels, Rejected
from ledpi.decode.finding.find import Pyramid, SquareSearcher

TOO_SMALL = Rejected(stage="find", reason="too_small")
NOT_FOUR_SIDED = Rejected(stage="find", reason="not_four_sided")
AT_BORDER = Rejected(stage="find", reason="at_picture_border")

# By level of the pyramid: grey levels, of which one lies between a panel and the wall behind it, in a bright room and
# in a dark one.
_FINE, _COARSE = (24, *range(48, 256, 32)), tuple(range(32, 256, 32))
# And shares of the contrast in the neighbourhood, in 256ths, as of a panel before something brighter than it is itself.
_SHARES = ((166,), (154,), ())
# Shortest outline by level, in its pixels: of the smallest panel in scope, foreshortened by 60°; then of what the level
# before sees better.
_SHORTEST = (10, 24, 24)


class Limits(NamedTuple):
    """Limits of an outline; as `Limits` of core.h has them."""

    min_contrast: float = 16  # grey levels from the darkest around: less is noise and texture
    narrowest: float = 3  # pixels, across and down: less is a speck
    min_area: float = 0.25  # over that of the box around; a square's is at least 1/2
    min_lit: float = 0.64  # of the pixels within an outline
    min_solidity: float = 0.8  # area over that of the convex hull
    significant: float = 0.1  # of the root of the area: corners less far from the polygon without them are none
    alike: float = 2 / 3  # of how far the fifth corner is: where the sixth is as significant there is no telling them
    min_side: float = 0.3  # shortest side over the root of the area; that of a panel turned by 80° is 0.4
    max_cut_off: float = 0.05  # of the area: what a dead cell at a corner takes of the outline's hull is half of 1/16
    max_misfit: float = 0.15  # logarithm of the four sides' area over the outline's,
    pixel_misfit: float = 0.6  # and over the side in pixels: steps of whole pixels make small outlines ragged
    tolerance: float = 1.5  # pixels of the picture that the outline is in: how far off the sides may be
    blur_misfit: float = 0.002  # by how much a coarser outline, a pixel less certain, must fit better to be preferred
    near: float = 0.25  # of the side: of squares in one place, what is no further off, larger, or otherwise is the same
    like: float = 0.7
    same_corners: float = 0.25
    least_cell: float = 0.2  # of a panel's pitch: sides of what is seen of its cells, from their middles to all of them
    most_cell: float = 1.2


class Finder:
    """Keeps the pictures it works on, for frames of one size."""

    def __init__(self, width: int, height: int, smallest_px: float, cells: int = 4) -> None:
        """`smallest_px`: side of the smallest panel that can be read. `cells`: along a side."""
        self._pyramid = Pyramid(height, width)
        levels = list(zip(self._pyramid.smaller, _SHORTEST, (_FINE, _COARSE, _COARSE), _SHARES, strict=True))
        self._searcher = SquareSearcher(levels, smallest_px, cells, Limits()._asdict())

    def find(self, frame: Frame) -> tuple[Floats, list[Rejected]]:
        """Corners (N, 4, 2) of distinct things, the best outline first; and what was dropped."""
        self._pyramid.of(frame)
        squares, (at_border, not_four_sided, too_small) = self._searcher.search()
        dropped = [AT_BORDER] * at_border + [NOT_FOUR_SIDED] * not_four_sided + [TOO_SMALL] * too_small
        return squares[:, :8].reshape(-1, 4, 2), dropped

    def pyramid(self, frame: Frame) -> list[Pixels]:
        """The frame that was searched last, and the same in halves, quarters …"""
        return [frame.pixels, *self._pyramid.smaller]
