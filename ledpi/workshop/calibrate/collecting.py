"""Which views of a board are worth keeping, what is still missing, and how bright the board is. Pure."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from ledpi.core.records import Floats, Frame, Pixels
from ledpi.core.tone import linear_light
from ledpi.workshop.calibrate.boards import Board, BoardView
from ledpi.workshop.calibrate.camera import CameraCalibration

STILL_PX = 0.5  # by which a corner may move from one frame to the next: rows are exposed one after another
NEW_PLACE, NEW_SIZE, NEW_TILT_DEG = 0.08, 1.2, 10.0  # of the picture's width; ratio; one of them, to be worth keeping
TILT_DEG = 15.0
VIEWS_A_SIDE = 2  # tilted to each side
ENOUGH_VIEWS = 16
# The white of the board, in linear light: bright enough to be sharp, with room for what is brighter elsewhere on it.
WHITE, DARKEST, BRIGHTEST = 0.5, 0.25, 0.8
MAX_EXPOSURE_US, GAINS = 10_000.0, (1.0, 8.0)  # a hand trembles; the sensor's noise

SIDES = {  # of the picture, by the sign of the board's normal in x and y
    "left": np.array([-1.0, 0.0]),
    "right": np.array([1.0, 0.0]),
    "upper": np.array([0.0, -1.0]),
    "lower": np.array([0.0, 1.0]),
}

GRID = (3, 4)  # rows and columns of parts: what is wanted of a collection
ROWS, COLUMNS = ("upper", "middle", "lower"), ("left", "centre left", "centre right", "right")
ENLARGED = 100.0  # residuals in the drawing: 0.1 px is drawn as 10
BLANK, GREEN, RED, SHADE = (255, 255, 255), (90, 200, 90), (60, 60, 235), (48, 48, 48)


@dataclass(frozen=True, slots=True, kw_only=True)
class Attitude:
    """Roughly how a board is held; the lens is not known yet."""

    centre: Floats  # (2,) in picture widths
    size: float  # side of a square, in picture widths
    normal_deg: Floats  # (2,) towards which its far side lies: x to the right of the picture, y down


@dataclass(slots=True)
class Collection:
    """The views kept so far."""

    board: Board
    width: int
    height: int
    views: list[BoardView] = field(default_factory=list)
    frames: int = 0  # that were looked at
    _attitudes: list[Attitude] = field(default_factory=list)
    _last: BoardView | None = None

    def add(self, view: BoardView) -> bool:
        """Keeps a view that is at rest and unlike the others; whether it did."""
        at_rest = self._last is not None and _moved_px(self._last, view) <= STILL_PX
        self._last = view
        if not at_rest:
            return False
        attitude = attitude_of(view, self.board, self.width)
        if any(_alike(attitude, other) for other in self._attitudes):
            return False
        self.views.append(view)
        self._attitudes.append(attitude)
        return True

    def missing(self) -> str | None:
        """Says what to do next; None where the collection is complete."""
        for side, direction in SIDES.items():
            tilted = sum(float(a.normal_deg @ direction) > TILT_DEG for a in self._attitudes)
            if tilted < VIEWS_A_SIDE:
                return f"tilt the board: its {side} side away from the camera, by 20° to 40°"
        empty = places_without_corners(corner_counts([v.corners_px for v in self.views], self.width, self.height))
        if empty:
            return f"show the board at the {empty[0]} of the picture"
        if len(self.views) < ENOUGH_VIEWS:
            return "show the board elsewhere: nearer, farther, tilted otherwise"
        return None


def attitude_of(view: BoardView, board: Board, width: int) -> Attitude:
    """Place, size and tilt of a board, for a lens that sees about as wide as it is far away (53°)."""
    corners = board.corners()[view.corner_ids]
    lens = np.array([[width, 0, width / 2], [0, width, width * 3 / 8], [0, 0, 1.0]])
    _, turn, shift = cv2.solvePnP(corners, view.corners_px, lens, None, flags=cv2.SOLVEPNP_IPPE)
    normal = np.asarray(cv2.Rodrigues(turn)[0], np.float64)[:, 2]
    normal = normal if normal[2] > 0 else -normal  # away from the camera
    # The side towards which the board's back faces is the nearer one.
    tilt = -np.degrees(np.arctan2(normal[:2], normal[2]))
    return Attitude(centre=view.corners_px.mean(axis=0) / width, size=1.0 / float(np.ravel(shift)[2]), normal_deg=tilt)


def next_exposure(frame: Frame, view: BoardView | None) -> tuple[float, float] | None:
    """(exposure µs, gain) that would picture the board's white at WHITE; None where it is bright enough as it is.

    The white is the 90th percentile within the board; without a board, of the whole picture.
    """
    light = linear_light(frame.transfer, mark_saturated=False)[_area(frame, view)]
    white, gain = float(np.percentile(light, 90)), frame.analogue_gain or 1.0
    if DARKEST <= white <= BRIGHTEST:
        return None
    wanted = frame.exposure_us * gain * WHITE / max(white, 0.01)
    if white > 0.99:
        wanted /= 4  # nobody knows how far above
    exposure_us = min(MAX_EXPOSURE_US, wanted / GAINS[0])
    return exposure_us, float(np.clip(wanted / exposure_us, *GAINS))


def _area(frame: Frame, view: BoardView | None) -> Floats:
    if view is None:
        return np.asarray(frame.pixels)
    low = np.maximum(np.floor(view.corners_px.min(axis=0)).astype(int), 0)
    high = np.ceil(view.corners_px.max(axis=0)).astype(int) + 1
    return np.asarray(frame.pixels[low[1] : high[1], low[0] : high[0]])


def _moved_px(before: BoardView, now: BoardView) -> float:
    shared, i, j = np.intersect1d(before.corner_ids, now.corner_ids, return_indices=True)
    if not len(shared):
        return math.inf
    return float(np.abs(before.corners_px[i] - now.corners_px[j]).max())


def _alike(a: Attitude, b: Attitude) -> bool:
    return (
        float(np.hypot(*(a.centre - b.centre))) < NEW_PLACE
        and abs(math.log(a.size / b.size)) < math.log(NEW_SIZE)
        and float(np.hypot(*(a.normal_deg - b.normal_deg))) < NEW_TILT_DEG
    )


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
                cv2.circle(picture, tuple(map(int, start)), 1, BLANK, cv2.FILLED)
    text = f"{len(result.used)} views, rms {result.rms_px:.3f} px; residuals x {ENLARGED:g}"
    cv2.putText(picture, text, (8, lens.height - 10), cv2.FONT_HERSHEY_SIMPLEX, 0.45, BLANK, 1, cv2.LINE_AA)
    return picture
