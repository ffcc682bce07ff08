"""`ledpi snapshot`: the picture shows what was read, where it is, and what was dropped and why."""

from __future__ import annotations

import os
import re
import resource
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest

from ledpi.camera.simulate.render import Renderer
from ledpi.camera.simulate.scene import Light, Panel, PanelAppearance, Scene
from ledpi.cli.snapshot import reasons
from ledpi.config.panels import PanelSettings
from ledpi.core.records import CameraInfo, Floats, Frame, Pixels
from ledpi.pipeline.diagnosis.drawing import AXES, text
from ledpi.pipeline.diagnosis.why_not import Why
from ledpi.pipeline.pipeline import Pipeline
from ledpi.workshop.snapshot.page import BLOCKS_GAP, COLUMN, GAP, LEFT, PICTURES_TOP, RIGHT, TILE, TITLE, WIDTH, draw
from ledpi.workshop.snapshot.sources import Snapshot, explain, take
from tests.builders import DEADLINE_S, ROOT
from tests.builders.command import LEDPI, Run, complaint
from tests.builders.faults import FAULTS, camera_of, config_of
from tests.builders.simulate import LENS, SPEC, WORD_7, opencv_pixels, panel, sensor, standing

PANELS = PanelSettings(side_m=SPEC.side_m)
PLACE = standing(x_m=-0.05, y_m=0.02, z_m=0.7, yaw_deg=8.0, roll_deg=90.0)  # the marker's top is on the right
LAMP = standing(x_m=0.15, y_m=0.0, z_m=0.8)
LAMP_SIZE_M = 0.09


def snapshot_of(*others: Panel, calibrated: bool = True) -> Snapshot:
    """Panel 7, lying on its side, and a square lamp that does not blink; or something else in its place."""
    camera = sensor()
    lamp = Light(shape="rectangle", width_m=LAMP_SIZE_M, height_m=LAMP_SIZE_M, motion=LAMP, level=0.4)
    panels = (panel(PLACE, appearance=PanelAppearance()), *others)
    scene = Scene(sensor=camera, panels=panels, lights=() if others else (lamp,))
    pixels = np.empty((LENS.height, LENS.width), np.uint8)
    Renderer(scene, seed=1).render(0, pixels)
    values = {"exposure_us": camera.exposure_us, "row_time_us": camera.row_time_us}
    frame = Frame(pixels=pixels, seq=0, row0_readout_ns=0, transfer=camera.transfer, **values)
    info = CameraInfo(width=LENS.width, height=LENS.height, transfer=camera.transfer, **values)
    lens = LENS if calibrated else None
    return take("a panel and a lamp", frame, Pipeline(info, PANELS, intrinsics=lens, stream=False), lens)


@pytest.fixture(scope="module")
def snapshot() -> Snapshot:
    return snapshot_of()


@pytest.fixture(scope="module")
def drawn(snapshot: Snapshot) -> Pixels:
    return draw(snapshot, explain(snapshot))


def cell_centres_px() -> Floats:
    """(4, 4, 2) where OpenCV's own projection puts the cells of PLACE, row 0 at the top of the marker."""
    along = SPEC.side_m * (np.arange(4) + 0.5 - 2) / 4
    x, y = np.meshgrid(along, -along)
    points = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    return opencv_pixels(points, PLACE.pose, LENS).reshape(4, 4, 2)


def on_page(pixels: Floats) -> Floats:
    """Returns where the frame's pixels (…, 2) lie on the right of the picture."""
    return (pixels + 0.5) * COLUMN / LENS.width - 0.5 + (RIGHT, PICTURES_TOP)


def looks_white_class(colour: Floats) -> bool:
    """Orange or blue; asserts that it is one of them (pictures are blue, green, red)."""
    blue, red = float(colour[0]), float(colour[2])
    assert abs(red - blue) > 40
    return red > blue


@pytest.mark.slow
def test_the_frame_is_shown_as_it_is(snapshot: Snapshot, drawn: Pixels) -> None:
    """On the left nothing is drawn over it: it is the frame, resized to the column."""
    height = round(LENS.height * COLUMN / LENS.width)
    seen = cv2.resize(snapshot.frame.pixels, (COLUMN, height), interpolation=cv2.INTER_AREA)
    assert drawn.shape[1:] == (WIDTH, 3)
    shown = drawn[PICTURES_TOP : PICTURES_TOP + height, LEFT : LEFT + COLUMN]
    assert (shown == seen[..., None]).all()


@pytest.mark.slow
def test_cells_are_coloured_by_class_where_they_are(drawn: Pixels) -> None:
    """On the right each cell of ID 7 has its class's colour at its own place, although the panel lies on its side."""
    places = np.round(on_page(cell_centres_px())).astype(int)
    assert [[looks_white_class(drawn[y, x]) for x, y in row] for row in places] == WORD_7.tolist()


@pytest.mark.slow
def test_the_enlarged_cells_stand_upright(drawn: Pixels) -> None:
    """The tile shows the word of ID 7 as the dictionary has it, whichever way the panel lies in the picture."""
    top = PICTURES_TOP + round(LENS.height * COLUMN / LENS.width) + BLOCKS_GAP + TITLE
    left = LEFT + 2 * (TILE + GAP)
    tile = drawn[top : top + TILE, left : left + TILE]
    quarters = tile[TILE // 16 :: TILE // 4, TILE // 16 :: TILE // 4]  # beside the digits
    assert [[looks_white_class(colour) for colour in row] for row in quarters] == WORD_7.tolist()


def test_what_was_dropped_is_outlined(snapshot: Snapshot, drawn: Pixels) -> None:
    """The lamp has no bands; its outline lies on its sides. What has corners is in the trace once, in their order."""
    from_find = [why for why in snapshot.decoded.rejected if why.stage == "find"]
    assert from_find + [dropped.why for dropped in snapshot.trace.dropped] == list(snapshot.decoded.rejected)
    half = LAMP_SIZE_M / 2
    corners = np.array([[-half, half, 0], [half, half, 0], [half, -half, 0], [-half, -half, 0.0]])
    true = opencv_pixels(corners, LAMP.pose, LENS)
    lamp = min(snapshot.trace.dropped, key=lambda dropped: float(np.abs(dropped.corners_px - true).max()))
    assert lamp.why.reason in {"no_bands", "steady"}  # by the first fit, or once all cells are known
    assert lamp.corners_px == pytest.approx(true, abs=2.5)
    middle = (lamp.corners_px[0] + lamp.corners_px[1]) / 2
    x, y = np.round(on_page(middle)).astype(int)
    nearby = drawn[y - 2 : y + 3, x].astype(int)
    assert (nearby[:, 2] - nearby[:, 1]).max() > 40  # red stands out from the grey picture


@pytest.mark.slow
def test_axes_are_drawn_only_with_a_pose(drawn: Pixels) -> None:
    """Without intrinsics the panel is read and there is no pose, hence no axes."""
    uncalibrated = snapshot_of(calibrated=False)
    assert [(m.detection.id, m.solution) for m in uncalibrated.decoded.markers] == [(7, None)]
    green = AXES[1]
    assert (drawn == green).all(axis=2).any()
    assert not (draw(uncalibrated, explain(uncalibrated)) == green).all(axis=2).any()


def test_what_is_wrong_with_a_panel_is_said_and_drawn() -> None:
    """In words, with what helps, after what was read; on the picture stands its number."""
    config = config_of(FAULTS["swapped"])
    camera = camera_of(FAULTS["swapped"], config, paced=False)
    frame = camera.read(np.empty((480, 640), np.uint8))
    assert isinstance(frame, Frame)
    lens = camera.info.intrinsics
    seen = take("swapped", frame, Pipeline(camera.info, config.panels, intrinsics=lens, stream=False), lens)
    why = explain(seen)
    (says, helps), *_ = reasons(why)
    assert re.fullmatch(r"panel at \d+, \d+ is not read: looks like ID 11 with its two frequencies swapped", says)
    assert helps.startswith("exchange")
    named, unnamed = draw(seen, why), draw(seen, Why([], why.notes))
    above = slice(PICTURES_TOP + 120, PICTURES_TOP + 165), slice(RIGHT + 290, RIGHT + 400)
    assert (named[above] != unnamed[above]).any()
    assert len(named) > len(unnamed)  # its enlarged cells, and the words below


def test_plus_minus_and_micro_are_drawn_without_a_stray_tail() -> None:
    """A µ is one piece, and a ± stands on the baseline; an OpenCV with ASCII only spells them."""
    micro, plus = (np.zeros((60, 80), np.uint8) for _ in range(2))
    text(micro, "µ", (15, 30), size=1.0)
    text(plus, "±", (15, 30), size=1.0)
    assert cv2.connectedComponents((micro > 60).astype(np.uint8))[0] == 2  # with the ground
    assert plus.any()
    if cv2.__version__.startswith("5."):
        assert micro[33:].any()
        assert not plus[32:].any()


# ---- the command


@pytest.fixture
def take_folder(ledpi: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A recording of panel 7, made by the simulator, in a working directory without a configuration."""
    monkeypatch.setattr("ledpi.cli.snapshot.RUN_FRAMES", 1)  # fewer than the recording has
    assert ledpi("simulate", "take", "--frames", "2", "--distance", "0.8")[0] == 0
    return tmp_path / "take"


PICTURE = ("take/frames/000000.png", "--set", "panels.side_m=0.16")


@pytest.mark.usefixtures("take_folder")
@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("take", "--frame", "1"), "take, frame 1: ID 7 at "),
        (("take",), "take, frame 0: ID 7 at "),
        (("--set", "panels.side_m=0.16", "--set", "camera.source=simulated", "--frame", "2"), "simulated, frame 2: "),
        (("--set", "camera.source=simulated"), "simulated, frame [01]: ID 7 at "),  # which is read hangs on OpenCV
        (("--set", "panels.side_m=0.16", "--set", "camera.source=recording:take"), "take, frame 0: ID 7 at "),
        ((*PICTURE, "--set", "camera.row_time_us=33.67"), "000000.png: ID 7 without a pose, margin "),
    ],
    ids=["frame of a recording", "first of a recording", "simulator", "a panel", "recording as camera", "picture"],
)
def test_one_picture_and_what_was_read(ledpi: Run, arguments: tuple[str, ...], says: str) -> None:
    """The picture is where --out says; the first line says what was read, and only those of reasons may follow."""
    status, output, _ = ledpi("snapshot", *arguments, "--out", "out.png")
    assert status == 0
    assert re.match(rf"out\.png: {says}", output)
    assert all(line.startswith("  ") for line in output.splitlines()[1:])
    picture = cv2.imread("out.png")
    assert picture is not None
    assert picture.shape[1] == WIDTH


@pytest.mark.usefixtures("take_folder")
@pytest.mark.parametrize("path", [("take",), ("--set", "camera.source=recording:take")])
def test_a_side_that_was_measured_again_is_stronger_than_the_recordings(ledpi: Run, path: tuple[str, ...]) -> None:
    """A panel of 0.16 m at 0.8 m, said to be of 0.32, is at 1.6 m: as a recording, and as a camera."""
    depth_m = re.search(r"ID 7 at \S+ \S+ (\S+) m", ledpi("snapshot", *path, "--set", "panels.side_m=0.32")[1])
    assert depth_m is not None
    assert float(depth_m[1]) == pytest.approx(1.6, rel=0.02)


@pytest.mark.slow
@pytest.mark.usefixtures("take_folder")
def test_the_way_to_a_late_frame_is_shown(tmp_path: Path) -> None:
    """Shows a camera's, on a terminal: it may take a while."""
    master, slave = os.openpty()
    given = ["--set", "camera.source=recording:take", "--frame", "1"]
    command = [*LEDPI, "snapshot", *given]
    done = subprocess.run(command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=slave, timeout=DEADLINE_S)
    os.set_blocking(master, False)
    shown = os.read(master, 100_000).decode(errors="ignore")
    os.close(slave)
    os.close(master)
    assert done.returncode == 0
    assert "waiting for the frame" in shown


def spoil(take_folder: Path) -> None:
    """Cuts frame 1's picture off, and puts beside the recording what is no picture."""
    picture = take_folder / "frames" / "000001.png"
    picture.write_bytes(picture.read_bytes()[:1000])
    (take_folder.parent / "no.png").write_text("no picture\n")
    (take_folder.parent / "empty.png").write_bytes(b"")
    cv2.imwrite(str(take_folder.parent / "small.png"), np.zeros((10, 20), np.uint8))


ROW_TIME = ("--set", "panels.side_m=0.16", "--set", "camera.row_time_us=33.67")


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (("nowhere",), "nowhere: no such file or folder"),
        (("take", "--frame", "2"), "take: has no frame 2; has 2, 0 to 1"),
        (("take", "--frame", "1"), "take/frames/000001.png: ends after 1000 bytes"),
        (("take/frames",), "take/frames/recording.yaml: is missing"),
        (("take", "--out", "out.gif"), "--out out.gif: must end in .png or .jpg"),
        (("take", "--out", "nowhere/out.png"), "--out nowhere/out.png: cannot be written: No such file or directory"),
        (("take", "--set", "camera.sauce=1"), "configuration: camera.sauce"),
        (("no.png",), "no configuration: --config FILE"),
        (PICTURE, "a picture file has no row time: add --set camera.row_time_us=33.67"),
        (("no.png", *ROW_TIME), "no.png: cannot be read as a picture of 8 or 16 bits; must be 640 × 480"),
        (("empty.png", *ROW_TIME), "empty.png: cannot be read as a picture of 8 or 16 bits; must be 640 × 480"),
        (("small.png", *ROW_TIME), "small.png: is 20 × 10; must be 640 × 480"),
        (("take", "--out", "take/frames/000000.png"), "--out take/frames: holds the pictures that are read"),
        ((*PICTURE, "--out", "take/../take/frames/000000.png"), "--out take/../take/frames/000000.png: is the picture"),
        ((*PICTURE, "--frame", "3"), "--frame 3: take/frames/000000.png is a picture"),
        (
            ("--set", "panels.side_m=0.16", "--set", "camera.source=recording:take", "--frame", "9"),
            "camera.source: recording:",
        ),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_what_cannot_be_used_is_one_line_and_status_2(
    ledpi: Run, arguments: tuple[str, ...], error: str, take_folder: Path
) -> None:
    """It names what is wrong, and writes no picture; none is lost."""
    spoil(take_folder)
    sound = {path: path.read_bytes() for path in (take_folder / "frames").iterdir()}
    assert complaint(ledpi("snapshot", *arguments)).startswith(f"ledpi: {error}")
    assert list(take_folder.parent.glob("*out*")) + list(take_folder.parent.glob("snapshot.*")) == []
    assert {path: path.read_bytes() for path in (take_folder / "frames").iterdir()} == sound


@pytest.mark.slow
def test_a_folder_whose_name_is_no_utf_8_is_drawn(take_folder: Path) -> None:
    """In a process of its own: OpenCV 5 would end it."""
    odd = Path(os.fsdecode(b"take\xff"))
    take_folder.rename(odd)
    command = [*LEDPI, "snapshot", odd, "--out", "out.png"]
    done = subprocess.run(command, env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True, timeout=DEADLINE_S)
    assert done.returncode == 0
    assert cv2.imread("out.png") is not None


@pytest.mark.usefixtures("take_folder")
def test_a_full_disk_leaves_the_older_picture(ledpi: Run, tmp_path: Path) -> None:
    """Half of the new one is not left either."""
    (tmp_path / "out.png").write_bytes(b"older")
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limit[1]))  # in the place of a full disk
    try:
        run = ledpi("snapshot", "take", "--out", "out.png")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    assert complaint(run) == "ledpi: --out out.png: cannot be written: File too large"
    assert (tmp_path / "out.png").read_bytes() == b"older"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["out.png", "take"]
