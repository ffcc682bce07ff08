"""The whole frame, as read: cells, axes and IDs of the panels, outlines and numbers of what was dropped."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np

from ledpi.core.geometry import matrix_from_quaternion
from ledpi.core.records import Floats, MarkerPose
from ledpi.diagnosis.diagnose import Diagnosis
from ledpi.kernels.lens import projected
from ledpi.tools.snapshot.drawing import (
    AXES,
    DROPPED,
    FAINT,
    TEXT,
    Canvas,
    Colour,
    draw_cells,
    line,
    outline,
    text,
    text_size,
)
from ledpi.tools.snapshot.record import Snapshot

DIMMED = 0.7  # the picture, so that the colours stand out
TINT = 0.6  # of a cell's colour over the picture

_Box: TypeAlias = tuple[int, int, int, int]  # left, top, right, bottom


def draw_reading(canvas: Canvas, snapshot: Snapshot, told: list[Diagnosis], scale: float) -> None:
    """Draws over the frame's picture, of which `canvas` holds a copy resized by `scale`.

    Of what was dropped, those that are `told` of have their number, from 1 on.
    """
    canvas[:] = canvas * DIMMED
    taken = [_box_of(scaled(m.detection.corners_px, scale)) for m in snapshot.decoded.markers]
    for dropped in snapshot.dropped:
        corners = scaled(dropped.corners_px, scale)
        outline(canvas, corners, FAINT, 1)
    for number, one in enumerate(told, 1):
        corners = scaled(one.corners_px, scale)
        outline(canvas, corners, DROPPED, 2)
        _label(canvas, corners, str(number), DROPPED, taken, bold=True)
    for marker in snapshot.decoded.markers:
        corners = scaled(marker.detection.corners_px, scale)
        draw_cells(canvas, corners, snapshot.codeword(marker.detection.id), TINT)
        outline(canvas, corners, TEXT, 2)
        _draw_axes(canvas, marker, snapshot, scale)
        _label(canvas, corners, f"ID {marker.detection.id}", TEXT, taken, bold=True)


def scaled(pixels: Floats, scale: float) -> Floats:
    """Where pixels (N, 2), whose centres have whole numbers, lie in the picture resized."""
    resized: Floats = (pixels + 0.5) * scale - 0.5
    return resized


def _draw_axes(canvas: Canvas, marker: MarkerPose, snapshot: Snapshot, scale: float) -> None:
    """The marker's x, y and z, half a side long, as its pose says; nothing where there is no pose."""
    lens = snapshot.intrinsics
    if marker.solution is None or lens is None:
        return
    pose = marker.solution.camera_from_marker
    half_m = snapshot.panels.spec(marker.detection.id).side_m / 2
    ends_m = np.concatenate([np.zeros((1, 3)), half_m * np.eye(3)])
    seen, _ = projected(ends_m @ matrix_from_quaternion(pose.quaternion_wxyz).T + pose.position_m, lens)
    if not np.isfinite(seen).all():
        return
    start, *tips = scaled(seen, scale)
    for tip, colour in zip(tips, AXES, strict=True):
        line(canvas, start, tip, colour)


def _label(
    canvas: Canvas, corners: Floats, words: str, colour: Colour, taken: list[_Box], *, bold: bool = False
) -> None:
    """Above or below a quad. Left out where it would cover a panel or another label."""
    width, height = text_size(words, bold=bold)
    left, top, _, bottom = _box_of(corners)
    x = min(max(left, 4), max(4, canvas.shape[1] - width - 4))
    for y in (top - 7, bottom + height + 7):
        box = (x, y - height, x + width, y)
        inside = box[1] >= 2 and y <= canvas.shape[0] - 4
        if inside and not any(_overlap(box, other) for other in taken):
            text(canvas, words, (x, y), colour=colour, bold=bold)
            taken.append(box)
            return


def _box_of(corners: Floats) -> _Box:
    left, top = np.floor(corners.min(axis=0)).astype(int).tolist()
    right, bottom = np.ceil(corners.max(axis=0)).astype(int).tolist()
    return left, top, right, bottom


def _overlap(a: _Box, b: _Box) -> bool:
    return a[0] < b[2] and b[0] < a[2] and a[1] < b[3] and b[1] < a[3]
