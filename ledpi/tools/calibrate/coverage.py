"""Which parts of the picture the boards have been seen in, and a drawing of that."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np
from numpy.typing import NDArray

from ledpi.core.records import Floats, Pixels
from ledpi.tools.calibrate.camera import CameraCalibration

GRID = (3, 4)  # rows and columns of parts: what is wanted of a collection
ROWS, COLUMNS = ("upper", "middle", "lower"), ("left", "centre left", "centre right", "right")
ENLARGED = 100.0  # residuals in the drawing: 0.1 px is drawn as 10
WHITE, GREEN, RED, SHADE = (255, 255, 255), (90, 200, 90), (60, 60, 235), (48, 48, 48)


def corner_counts(corners_px: Iterable[Floats], width: int, height: int) -> NDArray[np.int64]:
    """GRID of how many corners lie in each part of the picture."""
    counts = np.zeros(GRID, np.int64)
    for corners in corners_px:
        row = np.clip((corners[:, 1] * GRID[0] / height).astype(int), 0, GRID[0] - 1)
        column = np.clip((corners[:, 0] * GRID[1] / width).astype(int), 0, GRID[1] - 1)
        np.add.at(counts, (row, column), 1)
    return counts


def places_without_corners(counts: NDArray[np.int64]) -> list[str]:
    """The parts of the picture that no corner was in, as in `upper left`."""
    return [f"{ROWS[row]} {COLUMNS[column]}" for row, column in np.argwhere(counts == 0)]


def draw_coverage(result: CameraCalibration) -> Pixels:
    """(H, W, 3) BGR: every corner with its residual a hundredfold; views left out in red; parts without any shaded."""
    lens = result.intrinsics
    picture = np.full((lens.height, lens.width, 3), 24, np.uint8)
    counts = corner_counts([view.corners_px for view in result.used], lens.width, lens.height)
    for row, column in np.argwhere(counts == 0):
        x, y = (column * lens.width // GRID[1], row * lens.height // GRID[0])
        end = ((column + 1) * lens.width // GRID[1], (row + 1) * lens.height // GRID[0])
        cv2.rectangle(picture, (int(x), int(y)), (int(end[0]), int(end[1])), (40, 40, 110), cv2.FILLED)
    for views, colour in ((result.used, GREEN), (result.dropped, RED)):
        for view in views:
            hull = cv2.convexHull(view.corners_px.astype(np.float32)).round().astype(np.int32)
            cv2.polylines(picture, [hull], True, SHADE if colour is GREEN else RED, 1, cv2.LINE_AA)
            for corner, residual in zip(view.corners_px, view.residuals_px, strict=True):
                start, tip = corner.round().astype(int), (corner + ENLARGED * residual).round().astype(int)
                cv2.line(picture, tuple(map(int, start)), tuple(map(int, tip)), colour, 1, cv2.LINE_AA)
                cv2.circle(picture, tuple(map(int, start)), 1, WHITE, cv2.FILLED)
    text = f"{len(result.used)} views, rms {result.rms_px:.3f} px; residuals x {ENLARGED:g}"
    cv2.putText(picture, text, (8, lens.height - 10), cv2.FONT_HERSHEY_SIMPLEX, 0.45, WHITE, 1, cv2.LINE_AA)
    return picture
