"""Lines, areas, words and cells on a colour picture. Colours are blue, green, red, as OpenCV has them."""

from __future__ import annotations

from typing import TypeAlias

import cv2
import numpy as np

from ledpi.core.geometry import project_to_quad
from ledpi.core.records import Floats, Pixels
from ledpi.markers.codewords import Bits

Canvas: TypeAlias = Pixels  # (H, W, 3)
Colour: TypeAlias = tuple[int, int, int]

BACKGROUND: Colour = (34, 29, 26)
TEXT: Colour = (240, 238, 236)
DIM: Colour = (170, 162, 156)
# Blue and orange: told apart by every kind of colour vision.
BLACK_CLASS: Colour = (235, 140, 60)
WHITE_CLASS: Colour = (50, 175, 250)
DROPPED: Colour = (120, 115, 255)
FAINT: Colour = (95, 90, 160)  # of what most likely is no panel
AXES: tuple[Colour, Colour, Colour] = ((60, 60, 240), (80, 210, 80), (250, 110, 70))  # x, y, z

SIZE = 0.48  # of letters, in OpenCV's unit
CELL_SHARE = 0.92  # of a cell's pitch that is coloured
_SUBPIXEL_BITS = 4
# OpenCV 5 draws any letter. Older ones have ASCII only, and write ? for each byte of another letter.
_SPELLED = {} if cv2.__version__.startswith("5.") else {ord("±"): "+/-", ord("µ"): "u"}


def _fixed(points: Floats) -> Pixels:
    return np.asarray(np.round(points * (1 << _SUBPIXEL_BITS)), np.int32)


def text_size(words: str, *, size: float = SIZE, bold: bool = False) -> tuple[int, int]:
    """Width and height above the baseline."""
    (width, height), _ = cv2.getTextSize(_drawable(words), _font(bold), size, 1)
    return int(width), int(height)


def ascii_of(words: str) -> str:
    """The same in letters that can be drawn."""
    return words.replace("×", "x").replace(" → ", ": ")


def _drawable(words: str) -> str:
    """Each letter as this OpenCV has it.

    A file's name may hold bytes that are no UTF-8; those would end OpenCV 5, and Python with it.
    """
    return words.translate(_SPELLED).encode("utf-8", "replace").decode("utf-8")


def _font(bold: bool) -> int:
    return int(cv2.FONT_HERSHEY_DUPLEX if bold else cv2.FONT_HERSHEY_SIMPLEX)


def text(
    canvas: Canvas,
    words: str,
    at: tuple[int, int],
    *,
    size: float = SIZE,
    colour: Colour = TEXT,
    bold: bool = False,
) -> None:
    """Words whose baseline begins at a pixel (x, y). ASCII, ± and µ are drawn by every OpenCV."""
    cv2.putText(canvas, _drawable(words), at, _font(bold), size, colour, 1, cv2.LINE_AA)


def outline(canvas: Canvas, corners: Floats, colour: Colour, thickness: int) -> None:
    """The four sides of a quad (4, 2)."""
    cv2.polylines(canvas, [_fixed(corners)], True, colour, thickness, cv2.LINE_AA, _SUBPIXEL_BITS)


def fill_quad(canvas: Canvas, corners: Floats, colour: Colour, tint: float) -> None:
    """Covers a quad (4, 2) with a colour, of which `tint` (0 to 1) is opaque."""
    low = np.maximum(np.floor(corners.min(axis=0)).astype(int) - 1, 0)
    high = np.minimum(np.ceil(corners.max(axis=0)).astype(int) + 2, (canvas.shape[1], canvas.shape[0]))
    if not (high > low).all():
        return
    part = canvas[low[1] : high[1], low[0] : high[0]]
    covered = part.copy()
    cv2.fillPoly(covered, [_fixed(corners - low)], colour, cv2.LINE_AA, _SUBPIXEL_BITS)
    part[:] = cv2.addWeighted(covered, tint, part, 1 - tint, 0)


def line(canvas: Canvas, start: Floats, end: Floats, colour: Colour) -> None:
    """A thick line with a dark rim, so that it stands out from any ground."""
    a, b = (tuple(int(v) for v in _fixed(p)) for p in (start, end))
    for ink, thickness in (((20, 20, 20), 5), (colour, 3)):
        cv2.line(canvas, a, b, ink, thickness, cv2.LINE_AA, _SUBPIXEL_BITS)


def draw_cells(canvas: Canvas, corners: Floats, word: Bits, tint: float) -> None:
    """Every cell of an upright word, in the colour of its class, between the marker's corners (4, 2)."""
    n = len(word)
    u, v = np.meshgrid(np.arange(n + 1) / n, np.arange(n + 1) / n)
    grid = project_to_quad(corners, np.column_stack([u.ravel(), v.ravel()])).reshape(n + 1, n + 1, 2)
    for (row, column), bit in np.ndenumerate(word):
        across = slice(column, column + 2)
        quad = np.concatenate([grid[row, across], grid[row + 1, across][::-1]])
        centre = quad.mean(axis=0)
        fill_quad(canvas, centre + CELL_SHARE * (quad - centre), WHITE_CLASS if bit else BLACK_CLASS, tint)
