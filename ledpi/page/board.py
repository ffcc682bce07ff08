"""A calibration board before the running daemon's camera: coverage, what to do next, and the lens that it gives.

The daemon goes on meanwhile, with its own exposure and gain.
"""

from __future__ import annotations

import os
import threading
import time
from contextlib import suppress
from datetime import date
from typing import Any, get_args

from ledpi.config.camera_yaml import camera_yaml_text
from ledpi.core.errors import CalibrationError
from ledpi.page.pictures import Pictures
from ledpi.workshop.calibrate.boards import SIDES, Board, BoardFinder, Kind
from ledpi.workshop.calibrate.camera import MIN_VIEWS, CameraCalibration, calibrate_camera, quality
from ledpi.workshop.calibrate.collecting import ENOUGH_VIEWS, Collection, corner_counts

LONGEST_S = 900.0  # after which a watch that was forgotten ends
PAUSE_S = 0.1  # between two pictures: a search takes about as long
BLIND = 10  # pictures without the board, until that is said
_LEAST_PRIORITY = 10


def board_of(kind: str, columns: int, rows: int) -> Board:
    """Raises ValueError that says what would be right."""
    if kind not in get_args(Kind):
        raise ValueError(f"kind must be {' or '.join(get_args(Kind))}")
    if columns not in SIDES or rows not in SIDES:
        raise ValueError(f"cols and rows must be {SIDES[0]} to {SIDES[-1]} inner corners")
    return Board(kind="charuco" if kind == "charuco" else "chessboard", columns=columns, rows=rows)


class BoardWatch:
    """Looks for one board in the pictures, in a thread of its own, until it has enough views."""

    def __init__(self, board: Board, pictures: Pictures) -> None:
        self._board, self._pictures = board, pictures
        self._finder = BoardFinder(board)
        self._collection: Collection | None = None
        self._result: CameraCalibration | None = None
        self._said = "show the board to the camera"
        self._lens_said = ""
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._watch, name="board", daemon=True)
        self._thread.start()

    def stop(self) -> None:
        """Ends it; what was found stays."""
        self._ended.set()

    def told(self) -> dict[str, Any]:
        """For the page: how many views, which parts of the picture they cover, what is missing, and the lens."""
        collection, result = self._collection, self._result
        views = [] if collection is None else list(collection.views)
        size = (1, 1) if collection is None else (collection.width, collection.height)
        return {
            "runs": not self._ended.is_set(),
            "board": {"kind": self._board.kind, "cols": self._board.columns, "rows": self._board.rows},
            "says": self._said,
            "views": len(views),
            "enough": ENOUGH_VIEWS,
            "coverage": corner_counts([view.corners_px for view in views], *size).tolist(),
            "rms_px": None if result is None else round(result.rms_px, 3),
            "lens_says": self._lens_said,
        }

    def camera_yaml(self) -> str | None:
        """The lens as `camera.intrinsics` wants it; None as long as there is none."""
        result = self._result
        if result is None:
            return None
        return camera_yaml_text(result.intrinsics, {"calibrated": date.today(), **quality(result)})

    def _watch(self) -> None:
        with suppress(OSError, AttributeError):  # of this thread alone, as Linux does
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _LEAST_PRIORITY)
        until_s, number, blind = time.monotonic() + LONGEST_S, -1, 0
        while not self._ended.wait(PAUSE_S) and time.monotonic() < until_s:
            shown = self._pictures.wait("plain", number, 1.0)
            if shown is None:
                continue
            number = shown.number
            height, width = shown.pixels.shape
            if self._collection is None or (self._collection.width, self._collection.height) != (width, height):
                self._collection = Collection(board=self._board, width=width, height=height)
            view = self._finder.find(f"picture {number}", shown.pixels)
            self._collection.board = self._finder.board
            blind = 0 if view is not None else blind + 1
            if view is not None and self._collection.add(view):
                self._fit(self._collection)
            missing = self._collection.missing()
            if missing is None:
                self._said = "that is enough: save camera.yaml, and set camera.intrinsics to it"
                break
            self._said = "no board is seen: show it, whole and well lit" if blind > BLIND else missing
        self._ended.set()

    def _fit(self, collection: Collection) -> None:
        if len(collection.views) < MIN_VIEWS:
            return
        try:
            self._result = calibrate_camera(collection.views, collection.board, collection.width, collection.height)
            self._lens_said = ""
        except CalibrationError as error:
            self._lens_said = str(error)
