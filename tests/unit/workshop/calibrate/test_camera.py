"""`ledpi calibrate camera`: a known camera is asked back, bad views are named, nonsense is refused."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from datetime import date
from functools import partial
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from ledpi.config.camera_yaml import load_intrinsics
from ledpi.config.settings import load_config
from ledpi.core.errors import CalibrationError
from ledpi.core.lens import undistort
from ledpi.workshop.calibrate.boards import Board, BoardView, Kind, find_board, other_board
from ledpi.workshop.calibrate.camera import calibrate_camera
from ledpi.workshop.calibrate.collecting import draw_coverage
from tests.builders.boards import (
    BOARD,
    CHARUCO,
    LENS,
    POSES,
    Pose,
    charuco_pictures,
    projected,
    rendered,
)
from tests.builders.command import Run

GREY = cv2.IMREAD_GRAYSCALE


def good_views() -> list[BoardView]:
    return [projected(f"{i:02}.png", pose, seed=i) for i, pose in enumerate(POSES)]


def refusal(views: list[BoardView]) -> str:
    with pytest.raises(CalibrationError) as caught:
        calibrate_camera(views, BOARD, 640, 480)
    text = str(caught.value)
    assert "\n" not in text
    return text


@pytest.fixture(scope="module")
def pictures(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a rendered picture for each of POSES, and one without a board."""
    folder = tmp_path_factory.mktemp("pictures")
    noise = np.random.default_rng(4)
    for i, pose in enumerate(POSES):
        cv2.imwrite(str(folder / f"{i:02}.png"), rendered(pose, noise))
    cv2.imwrite(str(folder / "zz_empty.png"), np.full((480, 640), 90, np.uint8))
    return folder


@pytest.fixture
def command(ledpi: Run) -> Run:
    return partial(ledpi, "calibrate", "camera")


def test_a_rendered_camera_is_asked_back(pictures: Path, command: Run) -> None:
    """Focal lengths within 0.3 %, principal point within 1 px, and rays within 1 px everywhere.

    The file also says when it was made and how good it is; an older one is kept; a picture shows the corners; and a
    configuration that names no lens names this one.
    """
    Path("camera.yaml").write_text("precious")
    Path("config.yaml").write_text("panels: {side_m: 0.16}  # lamp\n")
    status, out, err = command(pictures, "--board", "chessboard")
    lens = load_intrinsics(Path("camera.yaml"))
    assert (status, err) == (0, "")
    assert [lens.fx, lens.fy] == pytest.approx([600, 604], rel=0.003)
    assert [lens.cx, lens.cy] == pytest.approx([326, 234], abs=1)
    edge = np.array([[x, y] for x in (40.0, 320, 600) for y in (40.0, 240, 440)])
    difference = (undistort(edge, lens) - undistort(edge, LENS)) * 600
    assert np.abs(difference).max() < 1
    assert "11 pictures, 10 with the board\n" in out
    assert "10 views used, rms 0.0" in out
    assert Path("camera.yaml.bak-1").read_text() == "precious"
    assert "camera.yaml written; the older one is kept as camera.yaml.bak-1" in out
    quality = yaml.safe_load(Path("camera.yaml").read_text())["ledpi"]
    assert (quality["views"], quality["calibrated"]) == (10, date.today())
    assert 0 < quality["rms_px"] < 0.2
    assert list(quality["deviations"]) == ["fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3"]
    assert 0 < quality["deviations"]["fx"] < 3
    assert cv2.imread("camera.png").shape == (480, 640, 3)
    assert load_config(Path("config.yaml")).camera.intrinsics == Path("camera.yaml").absolute()
    assert Path("config.yaml.bak-1").read_text() == "panels: {side_m: 0.16}  # lamp\n"


@pytest.mark.parametrize(
    ("out", "message"),
    [
        ("no/camera.yaml", "no/camera.yaml: cannot be written: No such file or directory"),
        ("folder", "folder: is a folder; must be the file to write"),
        (".", ".: is a folder; must be the file to write"),
        ("camera.png", "camera.png: must not end in .png: a picture of that name is written beside it"),
    ],
)
def test_what_cannot_be_written_is_reported_before_anything_is_measured(
    command: Run, pictures: Path, out: str, message: str
) -> None:
    """Who has held a board for minutes should not lose that."""
    Path("folder").mkdir()
    assert command(pictures, "--out", out) == (2, "", f"ledpi: {message}\n")
    assert not [*Path().glob("*.new"), *Path().glob(".*.new")]


def test_a_bad_view_is_named_and_left_out() -> None:
    """A board that was bent in one picture: it is left out by name, and the camera is as without it."""
    views = good_views()
    from_centre = BOARD.corners()[:, :1] - 2.5
    bent = replace(views[3], name="bent.png", corners_px=views[3].corners_px + [0.0, 0.5] * from_centre**2)
    result = calibrate_camera([*views[:3], bent, *views[4:]], BOARD, 640, 480)
    assert [view.name for view in result.dropped] == ["bent.png"]
    assert result.dropped[0].rms_px > 0.25
    without = calibrate_camera([*views[:3], *views[4:]], BOARD, 640, 480)
    np.testing.assert_allclose(result.intrinsics.matrix(), without.intrinsics.matrix(), rtol=1e-6)


def test_the_picture_shades_what_no_board_has_shown() -> None:
    """All of twelve parts of 160 × 160 px but the upper left one, where one view's corners are."""
    result = calibrate_camera(good_views(), BOARD, 640, 480)
    corners = np.array([[50.0, 50.0], [80.0, 50.0], [60.0, 80.0]])
    view = replace(result.used[0], corners_px=corners, residuals_px=np.zeros((3, 2)))
    picture = draw_coverage(replace(result, used=(view,)))
    parts = picture[155::160, 155::160]  # a pixel of each that nothing else is drawn on
    assert (parts != parts[0, 0]).any(axis=2).tolist() == [[False, True, True, True], [True] * 4, [True] * 4]


def test_k3_is_fitted_only_where_it_shows() -> None:
    """LENS has none, and the noise of ten views is not taken for it; a lens that has it gets it."""
    assert calibrate_camera(good_views(), BOARD, 640, 480).intrinsics.distortion[4] == 0
    lens = replace(LENS, distortion=(-0.25, 0.09, 0.0, 0.0, 0.4))
    views = [projected(f"{i}", pose, seed=i, lens=lens) for i, pose in enumerate(POSES)]
    k3 = calibrate_camera(views, BOARD, 640, 480).intrinsics.distortion[4]
    assert k3 == pytest.approx(0.4, abs=0.2)  # k1, k2 and k3 share most of what they explain


@pytest.mark.slow
def test_views_that_determine_nothing_are_refused() -> None:
    """Frontal ones fit any focal length, one tilted pose many times tells no more; seven are one too few."""
    frontal: list[Pose] = [((0, 0, 10 * i), (0.1 * (i % 3 - 1), 0.05 * (i % 2)), 12 + i % 4) for i in range(12)]
    for poses in (frontal, [POSES[4]] * 12):
        views = [projected(f"{i}", pose, seed=i) for i, pose in enumerate(poses)]
        assert "the views are too much alike" in refusal(views)
    assert refusal(good_views()[:7]).startswith("the board was found in only 7 pictures, at least 8 are needed")


@pytest.mark.slow
def test_views_of_no_board_are_refused() -> None:
    """Points that no flat board can show are refused, whatever the fit makes of them."""
    random = np.random.default_rng(3)
    views = [replace(view, corners_px=random.uniform(20, 460, (30, 2))) for view in good_views()]
    assert "rms is" in refusal(views) or "no camera" in refusal(views)


def test_a_refusal_is_one_line_and_writes_nothing(command: Run) -> None:
    """Exit status 2, one line on standard error, and the older file is as it was."""
    Path("camera.yaml").write_text("precious")
    Path("pictures").mkdir()
    cv2.imwrite("pictures/empty.png", np.full((480, 640), 90, np.uint8))
    status, out, err = command("pictures", "--board", "chessboard", "--cols", 9, "--rows", 7)
    assert (status, out) == (2, "")
    assert "no chessboard with 9 × 7 inner corners in any of 1 pictures" in err
    assert err.count("\n") == 1
    assert sorted(path.name for path in Path().iterdir()) == ["camera.yaml", "pictures"]
    assert Path("camera.yaml").read_text() == "precious"


@pytest.mark.slow
def test_a_size_that_is_not_the_boards_is_reported_at_once(pictures: Path, command: Run) -> None:
    """After three pictures that agree, by the options that would be right."""
    status, _, err = command(pictures, "--board", "chessboard", "--cols", 8, "--rows", 6)
    assert status == 2
    right = "but 3 pictures with another board; must be --board chessboard --cols 6 --rows 5"
    assert err == f"ledpi: {pictures}: no chessboard with 8 × 6 inner corners, {right}\n"


@pytest.mark.slow
def test_a_board_of_the_other_kind_is_reported_too(pictures: Path) -> None:
    """A chessboard where a ChArUco board is asked for, and the reverse."""
    picture = np.asarray(cv2.imread(str(pictures / "00.png"), GREY), dtype=np.uint8)
    assert other_board(picture, CHARUCO) == "--board chessboard --cols 6 --rows 5"
    assert other_board(charuco_pictures()[0], BOARD) == "--board charuco"
    assert other_board(picture, BOARD) is None
    larger = Board(columns=9, rows=7, kind=Kind.CHARUCO)
    assert other_board(charuco_pictures()[0], larger) == "--board charuco --cols 6 --rows 5"


def test_pictures_of_two_sizes_are_refused(command: Run) -> None:
    """The first picture that differs is named, with both sizes."""
    for name, shape in (("a.png", (240, 320)), ("b.png", (480, 640))):
        cv2.imwrite(name, np.zeros(shape, np.uint8))
    status, _, err = command(".")
    assert status == 2
    assert "b.png: is 640 × 480 pixels, a.png is 320 × 240" in err


def test_folders_and_files_that_cannot_be_used_are_named(tmp_path: Path, command: Run) -> None:
    """A missing folder, one without pictures, and a picture that is none: one line each, exit status 2."""
    assert command("missing") == (2, "", "ledpi: missing: cannot be read: No such file or directory\n")
    status, _, err = command(".")
    assert (status, err[:24]) == (2, "ledpi: .: no pictures in")
    for content in (b"", b"no picture"):
        (tmp_path / "a.png").write_bytes(content)
        status, _, err = command(".")
        assert (status, err.count("\n")) == (2, 1)
        assert "a.png: is not a picture that can be decoded" in err


@pytest.mark.slow
def test_real_pictures(shared: Callable[[str], Path], tmp_path: Path, command: Run) -> None:
    """A webcam's: fx within 1 % of OpenCV's on all good views, rms at most 0.16 px."""
    folder = tmp_path / "left"
    folder.mkdir()
    for path in shared("real/chessboard").glob("left*.jpg"):
        (folder / path.name).symlink_to(path)
    Path("config.yaml").write_text("{camera: {width: 1296, height: 972}, panels: {side_m: 0.16}}")
    status, out, _ = command(folder, "--board", "chessboard")
    assert "config.yaml asks for 1296 × 972 pixels, these have 640 × 480: not named there" in out
    written = yaml.safe_load(Path("camera.yaml").read_text())
    assert status == 0
    assert "18 pictures, 18 with the board" in out
    assert load_intrinsics(Path("camera.yaml")).fx == pytest.approx(973, rel=0.01)
    assert written["ledpi"]["rms_px"] <= 0.16


def test_each_kind_of_board_is_found_as_it_is_printed() -> None:
    """None looks like another, and all corners of each are in a clear picture."""
    boards = [Board(columns=6, rows=5, kind=kind) for kind in Kind]
    assert len({board.black().tobytes() for board in boards}) == len(Kind)
    views = [find_board("clear", rendered(POSES[0], np.random.default_rng(1), board), board) for board in boards]
    assert [None if view is None else len(view.corner_ids) for view in views] == [30] * len(Kind)


@pytest.mark.slow
def test_a_charuco_board_may_be_seen_in_part() -> None:
    """Some views lack corners; the camera is asked back all the same, within four of its deviations."""
    views = [view for i, p in enumerate(charuco_pictures()) if (view := find_board(f"{i}", p, CHARUCO)) is not None]
    assert len(views) == len(POSES)
    assert min(len(view.corner_ids) for view in views) < 30
    result = calibrate_camera(views, CHARUCO, 640, 480)
    lens, known = result.intrinsics, result.deviations[:4]
    assert np.all(np.abs(np.array([lens.fx, lens.fy, lens.cx, lens.cy]) - [600, 604, 326, 234]) < 4 * known)
    assert known.max() < 3
    assert result.rms_px < 0.3
