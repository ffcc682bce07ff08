"""Markers drawn over a picture of any size: cells, outline, axes and ID."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from ledpi.core.geometry import matrix_from_quaternion
from ledpi.core.records import Floats, Intrinsics
from ledpi.diagnosis.drawing import AXES, TEXT, Canvas, Colour, draw_cells, line, outline, text, text_size
from ledpi.kernels.lens import projected
from ledpi.markers.codewords import Bits

DIMMED = 0.7  # the picture, so that the colours stand out
TINT = 0.6  # of a cell's colour over the picture

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
