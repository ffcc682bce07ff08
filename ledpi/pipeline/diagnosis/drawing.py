"""Lines, areas, words and cells on a colour picture. Colours are blue, green, red, as OpenCV has them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np

from ledpi.core.codewords import Bits
from ledpi.core.geometry import matrix_from_quaternion, project_to_quad
from ledpi.core.lens import projected
from ledpi.core.records import Floats, Intrinsics, Pixels

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
DIMMED = 0.7  # the picture, so that the colours stand out
TINT = 0.6  # of a cell's colour over the picture


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
    """Each letter as this OpenCV has it: a file's name may hold bytes that are no UTF-8, which end OpenCV 5."""
    return words.translate(_SPELLED).encode("utf-8", "replace").decode("utf-8")


def _font(bold: bool) -> int:
    return int(cv2.FONT_HERSHEY_DUPLEX if bold else cv2.FONT_HERSHEY_SIMPLEX)


def text(
    canvas: Canvas, words: str, at: tuple[int, int], *, size: float = SIZE, colour: Colour = TEXT, bold: bool = False
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


Box: TypeAlias = tuple[int, int, int, int]  # left, top, right, bottom


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Placed:
    """A marker that was read, as it is drawn."""

    marker_id: int
    corners_px: Floats  # (4, 2)
    word: Bits
    side_m: float
    position_m: Floats | None  # None without a lens
    quaternion_wxyz: Floats | None


def draw_markers(
    canvas: Canvas, markers: Sequence[Placed], lens: Intrinsics | None, scale: float = 1.0, labels: Sequence[Box] = ()
) -> None:
    """Over a picture that was resized by `scale`. An ID is left out where it would cover a panel or one of `labels`."""
    taken = [*labels, *(box_of(scaled(marker.corners_px, scale)) for marker in markers)]
    for marker in markers:
        corners = scaled(marker.corners_px, scale)
        draw_cells(canvas, corners, marker.word, TINT)
        outline(canvas, corners, TEXT, 2)
        _draw_axes(canvas, marker, lens, scale)
        draw_label(canvas, corners, f"ID {marker.marker_id}", TEXT, taken, bold=True)


def scaled(pixels: Floats, scale: float) -> Floats:
    """Returns where pixels (N, 2), whose centres have whole numbers, lie in the picture resized."""
    resized: Floats = (pixels + 0.5) * scale - 0.5
    return resized


def _draw_axes(canvas: Canvas, marker: Placed, lens: Intrinsics | None, scale: float) -> None:
    """The marker's x, y and z, half a side long, as its pose says; nothing where there is no pose."""
    if marker.position_m is None or marker.quaternion_wxyz is None or lens is None:
        return
    ends_m = np.concatenate([np.zeros((1, 3)), marker.side_m / 2 * np.eye(3)])
    seen, _ = projected(ends_m @ matrix_from_quaternion(marker.quaternion_wxyz).T + marker.position_m, lens)
    if not np.isfinite(seen).all():
        return
    start, *tips = scaled(seen, scale)
    for tip, colour in zip(tips, AXES, strict=True):
        line(canvas, start, tip, colour)


def draw_label(
    canvas: Canvas, corners: Floats, words: str, colour: Colour, taken: list[Box], *, bold: bool = False
) -> None:
    """Above or below a quad. Left out where it would cover a panel or another label."""
    width, height = text_size(words, bold=bold)
    left, top, _, bottom = box_of(corners)
    x = min(max(left, 4), max(4, canvas.shape[1] - width - 4))
    for y in (top - 7, bottom + height + 7):
        box = (x, y - height, x + width, y)
        inside = box[1] >= 2 and y <= canvas.shape[0] - 4
        if inside and not any(_overlap(box, other) for other in taken):
            text(canvas, words, (x, y), colour=colour, bold=bold)
            taken.append(box)
            return


def box_of(corners: Floats) -> Box:
    """The upright box around corners."""
    left, top = np.floor(corners.min(axis=0)).astype(int).tolist()
    right, bottom = np.ceil(corners.max(axis=0)).astype(int).tolist()
    return left, top, right, bottom


def _overlap(a: Box, b: Box) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]
