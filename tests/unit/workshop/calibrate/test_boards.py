"""ChArUco boards of other makers: recognised by their markers, whatever the dictionary, layout and size of these."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from ledpi.core.records import Floats, Pixels
from ledpi.workshop.calibrate.boards import Board, BoardFinder, other_board, recognise
from tests.builders.boards import charuco_pictures
from tests.builders.command import Run

SQUARE_PX = 60


def printed(squares: tuple[int, int], share: float, dictionary: str, *, legacy: bool) -> tuple[Pixels, Floats]:
    """OpenCV's own print of a board, seen aside, and its inner corners there (N, 2)."""
    words = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary))
    board = cv2.aruco.CharucoBoard(squares, 1.0, share, words)
    board.setLegacyPattern(legacy)
    width, height = squares[0] * SQUARE_PX, squares[1] * SQUARE_PX
    flat = cv2.copyMakeBorder(board.generateImage((width, height)), 60, 60, 60, 60, cv2.BORDER_CONSTANT, value=255)
    corners = np.float32([[0, 0], [width + 120, 0], [width + 120, height + 120], [0, height + 120]])
    seen = np.float32([[40, 30], [920, 70], [880, 640], [70, 690]])
    warp = cv2.getPerspectiveTransform(corners, seen)
    picture = cv2.GaussianBlur(cv2.warpPerspective(flat, warp, (960, 720), borderValue=90), (0, 0), 0.8)
    places = np.asarray(board.getChessboardCorners(), np.float64)[:, :2]
    truth = cv2.perspectiveTransform((places[None] * SQUARE_PX + 59.5), warp)[0]
    return np.asarray(picture, np.uint8), np.asarray(truth, np.float64)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("squares", "dictionary", "legacy", "share"),
    [
        ((11, 8), "DICT_5X5_250", False, 0.75),
        ((11, 8), "DICT_5X5_250", True, 0.5),  # rows even: the other colour at the top left
        ((9, 12), "DICT_4X4_100", True, 0.75),
        ((10, 7), "DICT_ARUCO_ORIGINAL", False, 0.5),
        ((11, 8), "DICT_APRILTAG_36h11", True, 0.75),
    ],
)
def test_a_board_of_any_maker_is_used(squares: tuple[int, int], dictionary: str, legacy: bool, share: float) -> None:
    """Its corners are found at their own places, far better than to half a pixel, though only its size was told."""
    picture, truth = printed(squares, share, dictionary, legacy=legacy)
    asked = Board(columns=squares[0] - 1, rows=squares[1] - 1, kind="charuco")
    finder = BoardFinder(asked)
    view = finder.find("one", picture)
    assert view is not None
    assert len(view.corner_ids) > 0.7 * len(truth)
    assert np.sqrt(np.square(view.corners_px - truth[view.corner_ids]).sum(axis=1).mean()) < 0.15
    assert finder.board.legacy == legacy
    assert finder.board.marker_share == pytest.approx(share, abs=0.06)
    assert (finder.note(asked) is None) == (dictionary == "DICT_5X5_250" and not legacy and share > 0.5)


@pytest.mark.slow
def test_a_board_that_is_held_upright_is_the_same() -> None:
    """Columns and rows may be told the other way round."""
    picture, _ = printed((11, 8), 0.75, "DICT_4X4_100", legacy=False)
    known = recognise(picture, Board(columns=7, rows=10, kind="charuco"))
    assert known is not None
    assert (known.columns, known.rows, known.dictionary) == (10, 7, "DICT_4X4_1000")


@pytest.mark.slow
def test_a_board_of_another_size_is_named() -> None:
    """As the options that would be right."""
    picture, _ = printed((11, 8), 0.75, "DICT_4X4_100", legacy=True)
    asked = Board(columns=8, rows=5, kind="charuco")
    assert recognise(picture, asked) is None
    assert other_board(picture, asked) == "--board charuco --cols 10 --rows 7"


def test_a_picture_without_markers_shows_no_board() -> None:
    """Nor does noise."""
    noise = np.random.default_rng(1).integers(0, 255, (480, 640), np.uint8)
    assert recognise(noise, Board(columns=6, rows=5, kind="charuco")) is None


@pytest.mark.slow
def test_hidden_and_broken_files_are_no_end(ledpi: Run, tmp_path: Path) -> None:
    """Passes over what a Mac leaves beside pictures; a broken picture is named and left out."""
    folder = tmp_path / "views"
    folder.mkdir()
    for number, picture in enumerate(charuco_pictures()):
        cv2.imwrite(str(folder / f"{number:02}.png"), picture)
    (folder / "._00.png").write_bytes(b"\0\5\x16\7")
    (folder / "05b.png").write_bytes((folder / "05.png").read_bytes()[:2000])
    status, out, err = ledpi("calibrate", "camera", "views", "--cols", "6", "--rows", "5")
    assert status == 0, err
    assert "05b.png: is not a picture that can be decoded; it is left out" in err
    assert "._00" not in out + err
    assert Path("camera.yaml").is_file()
