"""Finds lit, four-sided things in a picture: everything that may be a panel, roughly placed.

A panel is brighter than what is next to it (`lit`), what is lit has an outline (`outlines`), and some of these have
four sides (`four_sides`). On a picture shrunk far enough the cells of a panel melt into one, so this is done on a
pyramid.
"""

from __future__ import annotations

import cv2
import numpy as np

from ledpi.decode.finding import four_sides, lit, outlines, spots
from ledpi.decode.finding.four_sides import distinct, set_aside, square_of, without_cells
from ledpi.decode.finding.lit import brighter, closed, contrasts, lit_by
from ledpi.decode.finding.outlines import outlines_in
from ledpi.decode.finding.spots import group_sizes, groups, spots_in
from ledpi.kernels import find as kernel
from ledpi.kernels.find import Thresholds
from ledpi.kernels.library import compiled
from ledpi.records import Floats, Frame, Pixels, Rejected

TOO_SMALL = Rejected(stage="find", reason="too_small")
NOT_FOUR_SIDED = Rejected(stage="find", reason="not_four_sided")
AT_BORDER = Rejected(stage="find", reason="at_picture_border")

LEVELS = 3  # halvings; the cells of a panel that fills the picture's height melt together at an eighth
# By level of the pyramid: grey levels, of which one lies between a panel and the wall behind it, in a bright room and
# in a dark one; and half of the contrast, by which spots are lit. Of 520 panels in rooms of up to a third of their
# light these find 495; twice as many levels find as many, shares of the contrast (0.5, 0.7 and 0.6) 447.
_FINE, _COARSE = (24, *range(48, 256, 32)), tuple(range(32, 256, 32))
THRESHOLDS: Thresholds = ((_FINE, (), 128), (_COARSE, (), 128), (_COARSE, (), 128))
# Where that leads to nothing: shares of the contrast in the neighbourhood, as of a panel before something brighter than
# it is itself.
AGAIN: Thresholds = (((), (166,), 0), ((), (154,), 0), ((), (), 0))
# Shortest outline by level, in its pixels: of the smallest panel in scope, foreshortened by 60°; then of what the level
# before sees better.
SHORTEST = (10, 24, 24)
# As `Limits` of kernels/find.h has them.
LIMITS = (
    *(lit.MIN_CONTRAST, outlines.NARROWEST),
    *(outlines.MIN_AREA, outlines.MIN_LIT),
    *(four_sides.MIN_SOLIDITY, four_sides.SIGNIFICANT, four_sides.ALIKE, four_sides.MIN_SIDE),
    *(four_sides.MAX_CUT_OFF, four_sides.MAX_MISFIT, four_sides.PIXEL_MISFIT, four_sides.SLENDER),
    *(four_sides.TOLERANCE, four_sides.BLUR_MISFIT, four_sides.NEAR, four_sides.LIKE, four_sides.SAME_CORNERS),
    *four_sides.CELL,
    *(spots.MAX_AROUND, spots.LINK, spots.LIKE),
)
assert (kernel.REACH, kernel.MOST_SPOTS, kernel.AROUND) == (lit.WINDOW // 2, spots.MAX_SPOTS, spots.AROUND_PX)
assert kernel.MOST_COMPARED == four_sides.MOST_COMPARED

Spotted = list[tuple[int, Floats]]  # groups of spots, with a pixel's scale
Counts = tuple[int, int, int]  # of outlines at the picture's border, not four-sided, too small


class Finder:
    """Keeps the pictures it works on, for frames of one size."""

    def __init__(self, width: int, height: int, smallest_px: float, cells: int = 4) -> None:
        """`smallest_px`: side of the smallest panel that can be read. `cells`: along a side."""
        self._cells, self._smallest_px, self._group_sizes = cells, smallest_px, group_sizes(cells)
        self._levels = [
            np.empty((max(1, height >> halvings), max(1, width >> halvings)), np.uint8)
            for halvings in range(1, LEVELS + 1)
        ]
        self._things = self._squares = np.empty((0, 11))  # of the last frame: distinct ones, and all that was found
        # Finding compares neighbours only; a square root gives dark linear pictures the contrast they need.
        self._brighten = np.round(255 * np.sqrt(np.arange(256) / 255)).astype(np.uint8)
        arguments = self._levels, SHORTEST, smallest_px, cells, self._group_sizes, LIMITS
        self._searcher = kernel.Searcher(*arguments) if compiled() else None

    def find(self, frame: Frame) -> tuple[list[Floats], list[Rejected]]:
        """Corners (4, 2) of candidates, best outline first, no two of the same thing; and what was dropped."""
        self._shrink(frame)
        self._things, self._squares, spotted, counts = self._by(THRESHOLDS)
        return _corners(self._things), _dropped(counts)

    def find_again(self) -> tuple[list[Floats], list[Rejected]]:
        """The same, of the last frame once more, by the contrast in each neighbourhood; and what was set aside."""
        things, _, spotted, counts = self._by(AGAIN)
        aside = set_aside(self._squares, np.concatenate([self._things, things]))
        return _corners(np.concatenate([things, aside])), _dropped(counts)

    def pyramid(self, frame: Frame) -> list[Pixels]:
        """The frame that was searched last, and the same in halves, quarters …"""
        return [frame.pixels, *self._levels]

    def _by(self, thresholds: Thresholds) -> tuple[Floats, Floats, Spotted, Counts]:
        return (self._search if self._searcher is None else self._searcher.search)(thresholds)

    def _search(self, thresholds: Thresholds) -> tuple[Floats, Floats, Spotted, Counts]:
        """Distinct squares (K, 11) as `square_of` has them, all squares, groups of spots, and what was refused.

        How many outlines touch the picture's border, show no square, or show one too small. The reference of
        kernels/find.c.
        """
        squares, spotted = [], []
        all_at_border = not_four_sided = too_small = 0
        for level, (picture, shortest, (brighter_than, shares, spots_by)) in enumerate(
            zip(self._levels, SHORTEST, thresholds, strict=True)
        ):
            scale = 2 << level
            seen = contrasts(picture)
            if spots_by:
                spotted += [(scale, own) for own in groups(spots_in(picture, *seen, spots_by), self._group_sizes)]
            melted = closed(picture)
            # Opened where the closing makes thin bridges to the surroundings.
            for lit_there in [brighter(each, melted) for each in brighter_than] + [
                lit_by(share, *seen, opened=level > 0) for share in shares
            ]:
                found_outlines, at_border = outlines_in(lit_there, shortest)
                found = [square_of(outline, scale) for outline in found_outlines]
                large = [square for square in found if square is not None and square[8] >= self._smallest_px]
                squares += large
                all_at_border += at_border
                not_four_sided += found.count(None)
                too_small += len(found) - found.count(None) - len(large)
        found_squares = np.array(squares).reshape(-1, 11)
        things = without_cells(distinct(found_squares), self._cells)
        return things, found_squares, spotted, (all_at_border, not_four_sided, too_small)

    def _shrink(self, frame: Frame) -> None:
        """Fills the pyramid."""
        above: Pixels = frame.pixels
        for picture in self._levels:
            cv2.resize(above, picture.shape[::-1], dst=picture, interpolation=cv2.INTER_AREA)
            if above is frame.pixels and frame.transfer == "linear":
                cv2.LUT(picture, self._brighten, dst=picture)
            above = picture


def _dropped(counts: Counts) -> list[Rejected]:
    at_border, not_four_sided, too_small = counts
    return [AT_BORDER] * at_border + [NOT_FOUR_SIDED] * not_four_sided + [TOO_SMALL] * too_small


def _corners(squares: Floats) -> list[Floats]:
    """Of squares (K, 11)."""
    return list(squares[:, :8].reshape(-1, 4, 2))
