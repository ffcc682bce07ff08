"""The boards that a camera is calibrated with: what they look like, and where their corners are in a picture. Pure."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ledpi.core.codewords import Bits
from ledpi.core.errors import StrEnum
from ledpi.core.records import Floats, Pixels

SIDES = range(3, 21)  # inner corners along a side

# A ChArUco board's markers are not of the panels' usual dictionary, so that neither is taken for the other.
CHARUCO_DICTIONARY = "DICT_5X5_250"
MARKER_SHARE = 0.75  # of a square's side
# Of other makes: each begins with the words of the smaller ones of its size.
OTHER_DICTIONARIES = (
    *("DICT_4X4_1000", "DICT_5X5_1000", "DICT_6X6_1000", "DICT_7X7_1000"),
    *("DICT_ARUCO_ORIGINAL", "DICT_APRILTAG_36h11"),
)
TEXELS = 56  # of a drawn square: its marker is 42 of them, 6 a module, with 7 on either side
MIN_CHARUCO_CORNERS = 8
MIN_MARKERS = 4  # by which a ChArUco board is known as one
MIN_LAYOUT_MARKERS = 6  # and its layout: four markers' middles fit any
SAME_LAYOUT = 0.2  # of a square: in another layout markers are whole squares off; a lens bends a board by less
SAME_SHARE = 0.04  # of a square: so well is a marker's side measured


class Kind(StrEnum):
    """Patterns of boards, as options and the page name them."""

    CHESSBOARD = "chessboard"
    CHARUCO = "charuco"


@dataclass(frozen=True, slots=True, kw_only=True)
class Board:
    """A board by its kind and its inner corners. The squares' size does not matter for intrinsics."""

    columns: int  # inner corners along the one side
    rows: int
    kind: Kind = Kind.CHESSBOARD
    dictionary: str = CHARUCO_DICTIONARY
    marker_share: float = MARKER_SHARE
    legacy: bool = False  # as OpenCV before 4.6 and calib.io have it: a marker at the top left where rows are odd

    def corners(self) -> Floats:
        """(columns·rows, 3): row by row, in squares, z = 0."""
        x, y = np.meshgrid(np.arange(self.columns), np.arange(self.rows))
        return np.column_stack([x.ravel(), y.ravel(), np.zeros(x.size)]).astype(np.float64)

    def black(self) -> Bits:
        """((rows + 1)·TEXELS, (columns + 1)·TEXELS) True where the printed board is black."""
        if self.kind == Kind.CHARUCO:
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


class BoardFinder:
    """Looks for one board; of a ChArUco board it finds out by itself which dictionary and layout its maker used."""

    def __init__(self, board: Board) -> None:
        self.board = board
        self._recognised = board.kind != Kind.CHARUCO

    def find(self, name: str, picture: Pixels) -> BoardView | None:
        """The board in a grey picture, or None."""
        if not self._recognised:
            known = recognise(picture, self.board)
            if known is None:
                return None
            self.board, self._recognised = known, True
        return find_board(name, picture, self.board)

    def note(self, asked: Board) -> str | None:
        """Says what is otherwise than the board that was asked for; None where nothing is."""
        if self.board == asked:
            return None
        layout = " in the layout of OpenCV before 4.6 (setLegacyPattern, calib.io)" if self.board.legacy else ""
        return (
            f"the board is of {self.board.dictionary}{layout}, {self.board.columns} × {self.board.rows} inner corners, "
            f"its markers {self.board.marker_share:.2f} of a square"
        )


def recognise(picture: Pixels, board: Board) -> Board | None:
    """The ChArUco board of this size that a grey picture shows, whoever made it; None where it shows none."""
    for dictionary in (CHARUCO_DICTIONARY, *OTHER_DICTIONARIES):
        corners, ids = _markers(picture, dictionary)
        if len(ids) < MIN_MARKERS:
            continue
        sizes = {(board.columns, board.rows), (board.rows, board.columns)}
        layouts = [
            Board(columns=columns, rows=rows, kind=Kind.CHARUCO, dictionary=dictionary, legacy=legacy)
            for columns, rows in sorted(sizes, key=lambda size: size[0] != board.columns)
            for legacy in ((False, True) if rows % 2 else (False,))  # an even number of squares: else both are one
        ]
        fits = [_layout_fit(layout, corners, ids) for layout in layouts]
        best = min(range(len(fits)), key=lambda k: fits[k][0])
        if fits[best][0] < SAME_LAYOUT:
            share = fits[best][1]
            same = abs(share - MARKER_SHARE) < SAME_SHARE
            return replace(layouts[best], marker_share=MARKER_SHARE if same else round(share, 3))
    return None


def _markers(picture: Pixels, dictionary: str) -> tuple[Floats, NDArray[np.int64]]:
    """Corners (N, 4, 2) and IDs (N,) of the markers in a picture."""
    words = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    corners, ids, _ = cv2.aruco.ArucoDetector(words).detectMarkers(picture)
    if ids is None:
        return np.empty((0, 4, 2)), np.empty(0, np.int64)
    return np.asarray(corners, np.float64).reshape(-1, 4, 2), np.asarray(ids, np.int64).ravel()


def _layout_fit(board: Board, corners_px: Floats, ids: NDArray[np.int64]) -> tuple[float, float]:
    """Returns how far off the layout markers are, inf where it has too few; and their side. In squares."""
    places = np.asarray(_charuco(board).getBoard().getObjPoints(), np.float64)[..., :2]
    known = ids < len(places)
    if np.count_nonzero(known) < MIN_LAYOUT_MARKERS:
        return math.inf, math.nan
    wanted, seen = places[ids[known]].mean(axis=1), corners_px[known].mean(axis=1)
    to_board = cv2.findHomography(seen, wanted)[0]  # of all: in the other layout half of the rows agree
    if to_board is None:
        return math.inf, math.nan
    off = cv2.perspectiveTransform(seen[None], to_board)[0] - wanted
    outline = cv2.perspectiveTransform(corners_px[known].reshape(1, -1, 2), to_board).reshape(-1, 4, 2)
    sides = np.linalg.norm(outline - np.roll(outline, 1, axis=1), axis=2)
    return float(np.sqrt((off**2).sum(axis=1).mean())), float(np.median(sides))


def find_board(name: str, picture: Pixels, board: Board) -> BoardView | None:
    """The board in a grey picture, if it is there: a chessboard whole, of a ChArUco board a part is enough."""
    if board.kind == Kind.CHARUCO:
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
    for dictionary in (CHARUCO_DICTIONARY, *OTHER_DICTIONARIES):
        corners, ids = _markers(picture, dictionary)
        if len(ids) >= MIN_MARKERS:
            return "--board charuco" if board.kind != Kind.CHARUCO else _other_charuco(dictionary, corners, ids)
    found, _, squares = cv2.findChessboardCornersSBWithMeta(picture, (3, 3), flags=cv2.CALIB_CB_LARGER)
    size = sorted(squares.shape[:2], reverse=True) if found else []
    if not size or (board.kind == Kind.CHESSBOARD and size == sorted((board.columns, board.rows), reverse=True)):
        return None
    return f"--board chessboard --cols {size[0]} --rows {size[1]}"


def _other_charuco(dictionary: str, corners_px: Floats, ids: NDArray[np.int64]) -> str | None:
    """The options of a ChArUco board of another size, as far down as markers are seen; None where none fits."""
    boards = [
        Board(columns=columns, rows=SIDES[-2], kind=Kind.CHARUCO, dictionary=dictionary, legacy=legacy)
        for columns in SIDES
        for legacy in (False, True)
    ]
    fits = [_layout_fit(board, corners_px, ids)[0] for board in boards]
    best = int(np.argmin(fits))
    if not fits[best] < SAME_LAYOUT:
        return None
    columns = boards[best].columns
    rows = max(SIDES[0], math.ceil(2 * (int(ids.max()) + 1) / (columns + 1)) - 1)
    return f"--board charuco --cols {columns} --rows {rows}"


def _find_charuco(name: str, picture: Pixels, board: Board) -> BoardView | None:
    detector = _charuco(board)
    corners, ids, markers, _ = detector.detectBoard(picture)
    if ids is None or len(ids) < MIN_CHARUCO_CORNERS or detector.getBoard().checkCharucoCornersCollinear(ids):
        return None
    refined = _refined(picture, np.asarray(corners, np.float32), np.asarray(markers, np.float32), board.marker_share)
    return BoardView(name=name, corner_ids=np.asarray(ids, np.int64).ravel(), corners_px=refined)


def _refined(picture: Pixels, corners: Any, markers: Any, marker_share: float) -> Floats:
    """The corners (N, 2), found again in a window that ends before the next marker.

    OpenCV 4.11 leaves them half a pixel aside in both axes; all versions stray where a marker comes near.
    """
    sides = markers.reshape(-1, 4, 2)
    side_px = np.linalg.norm(sides - np.roll(sides, 1, axis=1), axis=2).min()
    half = max(1, int(side_px * (1 - marker_share) / (2 * marker_share)))
    stop = (cv2.TERM_CRITERIA_COUNT + cv2.TERM_CRITERIA_EPS, 40, 1e-3)
    refined = cv2.cornerSubPix(picture, corners.reshape(-1, 1, 2), (half, half), (-1, -1), stop)
    return np.asarray(refined, np.float64).reshape(-1, 2)


@cache
def _charuco(board: Board) -> Any:
    """OpenCV's detector, which holds its layout too."""
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    layout = cv2.aruco.CharucoBoard((board.columns + 1, board.rows + 1), 1.0, board.marker_share, dictionary)
    layout.setLegacyPattern(board.legacy)
    return cv2.aruco.CharucoDetector(layout)
