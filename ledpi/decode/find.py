"""Finds lit, four-sided things in a picture: everything that may be a panel, roughly placed.

A panel is brighter than what is next to it (`lit`), what is lit has an outline (`outlines`), and some of these have
four sides (`four_sides`). On a picture shrunk far enough the cells of a panel melt into one, so this is done on a
pyramid.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from ledpi.decode.four_sides import Squares, distinct
from ledpi.decode.lit import Lit
from ledpi.decode.outlines import Outlines
from ledpi.decode.spots import lattices
from ledpi.records import Floats, Frame, Pixels, Rejected

TOO_SMALL = Rejected(stage="find", reason="too_small")
NOT_FOUR_SIDED = Rejected(stage="find", reason="not_four_sided")
AT_BORDER = Rejected(stage="find", reason="at_picture_border")

LEVELS = 3  # halvings; the cells of a panel that fills the picture's height melt together at an eighth
# By level: share of the way from the darkest to the brightest, in 256ths: 0.5 everywhere, 0.7 and 0.6.
THRESHOLDS = ((128,), (128, 179), (154,))
# The same where that has found nothing: beside something darker than the wall (what hides a part of it, ink), half-way
# is darker than the wall, and a panel melts into it. A panel of few pixels would be cut by this alone.
AGAIN = ((166,), (), ())  # 0.65
# Shortest outline by level, in its pixels: of the smallest panel in scope, foreshortened by 60°; then of what the level
# before sees better.
SHORTEST = (10, 24, 24)
NOTHING = np.empty((0, 11))


@dataclass(frozen=True, slots=True)
class Candidate:
    """Where a panel may be."""

    corners: Floats  # (4, 2), clockwise as seen in the picture, first the one nearest the top left
    side_px: float
    misfit: float  # of the outline to the four sides, 0 is perfect
    tolerance_px: float  # how far off the sides may be: 1.5 pixels of the picture that they were found in
    spots: bool = False  # a lattice of bright spots, the grid of whose cells this is

    @property
    def centre_px(self) -> tuple[float, float]:
        """Mean of the corners."""
        x, y = (0.25 * self.corners.sum(axis=0)).tolist()
        return x, y


@dataclass(frozen=True, slots=True, eq=False)
class _Level:
    """Of the pyramid: a picture that is kept, and what works on pictures of its size."""

    picture: Pixels
    lit: Lit
    outlines: Outlines
    squares: Squares
    scale: int  # a pixel's side in the frame's

    @classmethod
    def of(cls, height: int, width: int, halvings: int) -> _Level:
        size = max(1, height >> halvings), max(1, width >> halvings)
        return cls(np.empty(size, np.uint8), Lit(*size), Outlines(*size), Squares(size[0]), 1 << halvings)


class Finder:
    """Keeps the pictures it works on, for frames of one size."""

    def __init__(self, width: int, height: int, smallest_px: float, cells: int = 4) -> None:
        """`smallest_px`: side of the smallest panel that can be read. `cells`: along a side."""
        self._cells = cells
        self._smallest_px = smallest_px
        self._levels = [_Level.of(height, width, halvings) for halvings in range(1, LEVELS + 1)]
        # Finding compares neighbours only; a square root gives dark linear pictures the contrast they need.
        self._brighten = np.round(255 * np.sqrt(np.arange(256) / 255)).astype(np.uint8)

    def find(self, frame: Frame) -> tuple[list[Candidate], list[Rejected]]:
        """Candidates, best outline first, no two of the same thing, lattices of spots last; and what was dropped."""
        self._shrink(frame)
        for level in self._levels:
            level.lit.look(level.picture)
        return self._find(THRESHOLDS)

    def find_again(self) -> tuple[list[Candidate], list[Rejected]]:
        """The same, of the last frame once more, by a higher threshold."""
        return self._find(AGAIN)

    def _find(self, thresholds: tuple[tuple[int, ...], ...]) -> tuple[list[Candidate], list[Rejected]]:
        squares, grids = [NOTHING], [NOTHING]
        dropped: list[Rejected] = []
        for level, shares, shortest in zip(self._levels, thresholds, SHORTEST, strict=True):
            for share in shares:
                # Opened where the closing makes thin bridges to the surroundings.
                found = level.outlines.of(level.lit.by(share, opened=level.scale > 2), shortest)
                here, not_four_sided, too_small = level.squares.among(found, level.scale, self._smallest_px)
                squares.append(here)
                grids += [_grid(corners, level.scale) for corners in lattices(found.spots, self._cells)]
                dropped += [AT_BORDER] * found.at_border + [NOT_FOUR_SIDED] * not_four_sided + [TOO_SMALL] * too_small
        return _candidates(squares) + _candidates(grids, spots=True), dropped

    def _shrink(self, frame: Frame) -> None:
        """Fills the pyramid."""
        above: Pixels = frame.pixels
        for level in self._levels:
            cv2.resize(above, level.picture.shape[::-1], dst=level.picture, interpolation=cv2.INTER_AREA)
            if above is frame.pixels and frame.transfer == "linear":
                cv2.LUT(level.picture, self._brighten, dst=level.picture)
            above = level.picture


def _candidates(squares: list[Floats], *, spots: bool = False) -> list[Candidate]:
    """Of rows as `Squares.among` has them, one of each thing, the best first."""
    found = distinct(np.concatenate(squares))
    corners = found[:, :8].reshape(-1, 4, 2)
    return [
        Candidate(at, side, misfit, tolerance, spots)
        for at, (side, misfit, tolerance) in zip(corners, found[:, 8:].tolist(), strict=True)
    ]


def _grid(corners: Floats, scale: int) -> Floats:
    """(1, 11) as `Squares.among` has it, of a lattice of spots in pixels that are `scale` of the picture's."""
    in_picture = (corners + 0.5) * scale - 0.5
    (x0, y0), (x1, y1), (x2, y2), (x3, y3) = in_picture.tolist()
    side_px = math.sqrt(0.5 * abs((x2 - x0) * (y3 - y1) - (x3 - x1) * (y2 - y0)))
    return np.array([[*in_picture.reshape(-1), side_px, 0.0, 0.5 * scale]])
