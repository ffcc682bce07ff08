"""`ledpi calibrate board`: what comes out of the printer has the size that it should, and is found again."""

from __future__ import annotations

import resource
import shutil
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest

from ledpi.core.records import Pixels
from ledpi.workshop.calibrate.board_sheet import PAPERS_MM, rectangles
from ledpi.workshop.calibrate.boards import Board, find_board
from tests.builders.command import Run, complaint

PX_PER_MM = 10


def printed(path: Path) -> Pixels:
    """The page at 10 pixels a millimetre."""
    if shutil.which("pdftoppm") is None:
        pytest.skip("pdftoppm (Debian: poppler-utils) is not here")
    command = ["pdftoppm", "-gray", "-singlefile", "-r", str(PX_PER_MM * 25.4), str(path), str(path.with_suffix(""))]
    subprocess.run(command, check=True)
    return np.asarray(cv2.imread(str(path.with_suffix(".pgm")), cv2.IMREAD_GRAYSCALE), np.uint8)


@pytest.mark.slow
@pytest.mark.parametrize(("kind", "paper"), [("chessboard", "a4"), ("charuco", "letter")])
def test_the_board_is_true_to_scale(ledpi: Run, tmp_path: Path, kind: str, paper: str) -> None:
    """The page has the paper's size, inner corners are 28 mm apart, and the ruler measures 100 mm."""
    pdf = tmp_path / "board.pdf"
    assert ledpi("calibrate", "board", pdf, "--kind", kind, "--paper", paper, "--square-mm", "28")[0] == 0
    page = printed(pdf)
    width_mm, height_mm = PAPERS_MM[paper]
    assert page.shape == pytest.approx((height_mm * PX_PER_MM, width_mm * PX_PER_MM), abs=1)
    half = np.asarray(cv2.resize(page, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA), np.uint8)
    view = find_board("print", half, Board(columns=6, rows=5, kind="charuco" if kind == "charuco" else "chessboard"))
    assert view is not None
    corners_mm = 2 * view.corners_px.reshape(5, 6, 2) / PX_PER_MM
    across, down = corners_mm[:, -1] - corners_mm[:, 0], corners_mm[-1] - corners_mm[0]
    np.testing.assert_allclose(np.abs(across), np.broadcast_to([5 * 28.0, 0.0], across.shape), atol=0.2)
    np.testing.assert_allclose(np.abs(down), np.broadcast_to([0.0, 4 * 28.0], down.shape), atol=0.2)
    foot = page[-round(8 * PX_PER_MM) : -round(4 * PX_PER_MM)]  # the ruler's line and its marks
    line = foot[np.argmin(foot.mean(axis=1))] < 128
    first = int(np.argmax(line))
    assert int(np.argmin(line[first:])) == pytest.approx(100 * PX_PER_MM, abs=2)


@pytest.mark.slow
def test_the_printed_board_is_the_one_that_is_looked_for(ledpi: Run, tmp_path: Path) -> None:
    """Needs no more to be told to either command: a picture of the print is a view of the board."""
    assert ledpi("calibrate", "board")[0] == 0
    (tmp_path / "pictures").mkdir()
    cv2.imwrite("pictures/print.png", cv2.resize(printed(tmp_path / "board.pdf"), (1188, 840)))
    assert "the board was found in only 1 pictures" in ledpi("calibrate", "camera", "pictures")[2]


def test_an_older_file_is_kept(ledpi: Run, tmp_path: Path) -> None:
    """As with every calibration; a board that does not fit touches none, and the largest square that fits is told."""
    out = tmp_path / "board.pdf"
    out.write_text("precious")
    said = complaint(ledpi("calibrate", "board", out, "--cols", "9", "--rows", "6"))
    assert "do not fit on a4: squares must be at most 27.1 mm" in said
    assert [path.name for path in tmp_path.iterdir()] == ["board.pdf"]
    assert ledpi("calibrate", "board", out)[0] == 0
    assert (tmp_path / "board.pdf.bak-1").read_text() == "precious"
    assert out.read_bytes().startswith(b"%PDF")


def test_a_full_disk_is_one_line(ledpi: Run, tmp_path: Path) -> None:
    """And not what matplotlib makes of it, which was an error of zlib's. Here a limit on a file's size is the disk."""
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20, limit[1]))
    try:
        run = ledpi("calibrate", "board")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    assert complaint(run) == "ledpi: board.pdf: cannot be written: File too large"
    assert list(tmp_path.iterdir()) == []


def test_rectangles_cover_what_is_black() -> None:
    """Each black texel once, and no white one."""
    black = np.array([[1, 1, 0, 1], [1, 1, 0, 0], [0, 1, 1, 1]], bool)
    covered = np.zeros(black.shape, int)
    for x, y, width, height in rectangles(black):
        covered[y : y + height, x : x + width] += 1
    np.testing.assert_array_equal(covered, black)
