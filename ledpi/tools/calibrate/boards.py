"""The boards that a camera is calibrated with: what they look like, and where their corners are in a picture. Pure."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from typing import Any, Literal

import cv2
import numpy as np
from numpy.typing import NDArray

from ledpi.core.records import Floats, Pixels
from ledpi.markers.codewords import Bits

Kind = Literal["chessboard", "charuco"]

# A ChArUco board's markers are not of the panels' usual dictionary, so that neither is taken for the other.
CHARUCO_DICTIONARY = cv2.aruco.DICT_5X5_250
MARKER_SHARE = 0.75  # of a square's side
TEXELS = 56  # of a drawn square: its marker is 42 of them, 6 a module, with 7 on either side
MIN_CHARUCO_CORNERS = 8
MIN_MARKERS = 4  # by which a ChArUco board is known as one


@dataclass(frozen=True, slots=True, kw_only=True)
class Board:
    """A board by its kind and its inner corners. The squares' size does not matter for intrinsics."""

    columns: int  # inner corners along the one side
    rows: int
    kind: Kind = "chessboard"

    def corners(self) -> Floats:
        """(columns·rows, 3): row by row, in squares, z = 0."""
        x, y = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]).astype(np.float64)

    def black(self) -> Bits:
        """((rows + 1)·TEXELS, (columns + 1)·TEXELS) True where the printed board is black."""
        if self.kind == "charuco":
            size = ((self.columns + 1) * TEXELS, (self.rows + 1) * TEXELS)
            return np.asarray(_charuco(self).getBoard().generateImage(size, marginSize=0, borderBits=1) < 128)
        y, x = np.mgrid[: self.rows + 1, : self.columns + 1]
        return np.kron((x + y) % 2 == 0, np.ones((TEXELS, TEXELS), bool))


@dataclass(frozen=True, slots=True, kw_only=True)
class BoardView:
    """A board, or a part of one, that was found in a picture."""

    name: str
    corner_ids: NDArray[np.int64]  # (N,) which of Board.corners
    corners_px: Floats  # (N, 2)


def find_board(name: str, picture: Pixels, board: Board) -> BoardView | None:
    """The board in a grey picture, or None.

    A chessboard must be seen whole; of a ChArUco board a part is enough, as its markers tell the corners apart.
    """
    if board.kind == "charuco":
        return _find_charuco(name, picture, board)
    # OpenCV's sector-based detector: on 36 webcam photographs it leaves 0.11 px of rms where the classic one with
    # cornerSubPix leaves 0.15 px, and it does not run away to a neighbouring corner.
    flags = cv2.CALIB_CB_EXHAUSTIVE | cv2.CALIB_CB_ACCURACY
    found, corners = cv2.findChessboardCornersSB(picture, (board.columns, board.rows), flags=flags)
    if not found:
        return None
    places = np.asarray(corners, np.float64).reshape(-1, 2)
    return BoardView(name=name, corner_ids=np.arange(len(places)), corners_px=places)


def other_board(picture: Pixels, board: Board) -> str | None:
    """The options of another board that is seen instead, as `--board chessboard --cols 9 --rows 6`; None for none.

    Of a chessboard that is seen in part it is the part's size: of several pictures believe what they agree in.
    """
    markers = cv2.aruco.ArucoDetector(cv2.aruco.getPredefinedDictionary(CHARUCO_DICTIONARY)).detectMarkers(picture)[1]
    if markers is not None and len(markers) >= MIN_MARKERS:
        return "--board charuco" if board.kind != "charuco" else None
    found, _, squares = cv2.findChessboardCornersSBWithMeta(picture, (3, 3), flags=cv2.CALIB_CB_LARGER)
    size = sorted(squares.shape[:2], reverse=True) if found else []
    if not size or (board.kind == "chessboard" and size == sorted((board.columns, board.rows), reverse=True)):
        return None
    return f"--board chessboard --cols {size[0]} --rows {size[1]}"


def _find_charuco(name: str, picture: Pixels, board: Board) -> BoardView | None:
    detector = _charuco(board)
    corners, ids, _, _ = detector.detectBoard(picture)
    if ids is None or len(ids) < MIN_CHARUCO_CORNERS or detector.getBoard().checkCharucoCornersCollinear(ids):
        return None
    return BoardView(
        name=name,
        corner_ids=np.asarray(ids, np.int64).ravel(),
        corners_px=np.asarray(corners, np.float64).reshape(-1, 2),
    )


@cache
def _charuco(board: Board) -> Any:
    """OpenCV's detector, which holds its layout too."""
    dictionary = cv2.aruco.getPredefinedDictionary(CHARUCO_DICTIONARY)
    return cv2.aruco.CharucoDetector(
        cv2.aruco.CharucoBoard((board.columns + 1, board.rows + 1), 1.0, MARKER_SHARE, dictionary)
    )
