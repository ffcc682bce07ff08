"""Pictures in rows, and the parts of a frame that they show."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np

from ledpi.core.records import Floats, Pixels
from ledpi.diagnosis.drawing import Canvas
from ledpi.tools.snapshot.page import BORDER, WIDTH

GAP = 16
MARGIN = 0.2  # of what is shown, around it


@dataclass(frozen=True, slots=True, kw_only=True)
class Tile:
    """A picture with the line below it."""

    label: str  # as `drawing.text` can
    picture: Canvas


@dataclass(frozen=True, slots=True, kw_only=True)
class Row:
    """Tiles side by side, under a line."""

    title: str  # as `drawing.text` can
    tiles: tuple[Tile, ...]


def tile_width(tiles: int) -> int:
    """Returns that of so many in a row."""
    return (WIDTH - 2 * BORDER - (tiles - 1) * GAP) // tiles


class View(NamedTuple):
    """A part of the frame, and how large it is shown."""

    left: int
    top: int
    scale: float  # pixels of the tile for each of the frame
    width: int  # of the tile
    height: int

    def crop(self, picture: Pixels) -> Canvas:
        """That part of a grey or coloured picture of the frame's size, enlarged without smoothing."""
        right, bottom = self.left + round(self.width / self.scale), self.top + round(self.height / self.scale)
        part = picture[self.top : bottom, self.left : right]
        smoothly = cv2.INTER_AREA if self.scale < 1 else cv2.INTER_NEAREST
        shown = cv2.resize(part, (self.width, self.height), interpolation=smoothly)
        return np.asarray(shown if shown.ndim == 3 else cv2.cvtColor(shown, cv2.COLOR_GRAY2BGR), np.uint8)

    def place(self, pixels: Floats) -> Floats:
        """Returns where pixels (N, 2) of the frame, whose centres have whole numbers, lie in the tile."""
        placed: Floats = (pixels + 0.5 - (self.left, self.top)) * self.scale - 0.5
        return placed

    def matrix(self) -> Floats:
        """`place` as a (3, 3) homography."""
        shift = (0.5 - np.array([self.left, self.top])) * self.scale - 0.5
        return np.array([[self.scale, 0, shift[0]], [0, self.scale, shift[1]], [0, 0, 1.0]])


def view_of(corners_px: list[Floats], shape: tuple[int, ...], width: int) -> View:
    """The part of a frame of `shape` that holds these quads and a margin of their size; all of it where there are none.

    It has the frame's proportions, and is `width` wide as a tile.
    """
    rows, columns = shape[:2]
    wide, left, top = float(columns), 0.0, 0.0
    if corners_px:
        points = np.concatenate(corners_px)
        low, high = points.min(axis=0), points.max(axis=0)
        size = (high - low) * (1 + 2 * MARGIN)
        wide = min(float(columns), max(32.0, float(size[0]), float(size[1]) * columns / rows))
        centre = (low + high) / 2
        left = min(max(0.0, float(centre[0]) - wide / 2), columns - wide)
        top = min(max(0.0, float(centre[1]) - wide * rows / columns / 2), rows - wide * rows / columns)
    whole = max(1, int(wide))
    return View(int(left), int(top), width / whole, width, round(width * rows / columns))
