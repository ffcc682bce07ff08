"""`ledpi calibrate camera` with a live camera: what it asks for, what it takes, and how it sets the exposure."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
import yaml

from ledpi.camera.recording.reader import load_recording
from ledpi.config.camera_yaml import load_intrinsics
from ledpi.core.records import CameraInfo, Frame, Pixels
from ledpi.workshop.calibrate.camera import calibrate_camera
from ledpi.workshop.calibrate.collecting import ENOUGH_VIEWS, Collection, attitude_of, next_exposure
from ledpi.workshop.calibrate.taking import OpenAt, collect_views
from tests.builders.boards import BOARD, CHARUCO, POSES, Pose, charuco_pictures, projected, rendered
from tests.builders.command import Run

EMPTY = np.full((480, 640), 90, np.uint8)
INFO = CameraInfo(width=640, height=480, exposure_us=10_000.0, row_time_us=33.67, transfer="linear")


def frame_of(pixels: Pixels, seq: int = 0, exposure_us: float = 10_000.0, gain: float = 1.0) -> Frame:
    return Frame(
        pixels=pixels,
        seq=seq,
        row0_readout_ns=10**9 + seq * 17_000_000,
        exposure_us=exposure_us,
        row_time_us=33.67,
        transfer="linear",
        analogue_gain=gain,
    )


@dataclass
class BoardCamera:
    """Photographs the pictures one after another, as bright as exposure and gain make them: as drawn at 10 ms and 4."""

    pictures: Iterator[Pixels]
    exposure_us: float
    gain: float
    closed: bool = field(default=False, init=False)
    seq: int = field(default=0, init=False)

    info = INFO
    panel = None

    def read(self, into: Pixels) -> Frame | None:
        assert not self.closed
        picture = next(self.pictures, None)
        if picture is None:
            return None
        into[:] = np.minimum(picture * (self.exposure_us * self.gain / 40_000.0), 255)
        self.seq += 1
        return frame_of(into, self.seq, self.exposure_us, self.gain)

    def close(self) -> None:
        self.closed = True


def shown(times: int) -> Iterator[Pixels]:
    """An empty picture, then every pose as often as is said."""
    return (picture for drawn in (EMPTY, *charuco_pictures()) for picture in [drawn] * times)


def opener(pictures: Iterator[Pixels], exposure_us: float) -> tuple[OpenAt, list[BoardCamera]]:
    opened: list[BoardCamera] = []

    def open_at(exposure: tuple[float, float] | None) -> BoardCamera:
        opened.append(BoardCamera(pictures, *(exposure or (exposure_us, 1.0))))
        return opened[-1]

    return open_at, opened


@pytest.mark.slow
def test_the_exposure_is_set_by_the_board() -> None:
    """A camera that starts too dark is opened anew until the board's white is right; then every view counts."""
    open_at, opened = opener(shown(4), 3_000.0)
    said: list[str] = []
    collection, info = collect_views(open_at, CHARUCO, said.append, metered=True)
    assert len(opened) > 1
    assert all(camera.closed for camera in opened)
    assert 0.2 < opened[-1].exposure_us * opened[-1].gain / 40_000.0 * 210 / 255 < 0.85
    assert opened[-1].exposure_us <= 10_000
    assert [text for text in said if text.startswith("exposure ")] != []
    assert len(collection.views) >= 8  # the first pose's frames went into the exposure
    assert calibrate_camera(collection.views, CHARUCO, info.width, info.height).rms_px < 0.3


@pytest.mark.slow
def test_another_board_than_the_one_asked_for_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whoever shows a chessboard where a ChArUco board is expected hears which options are its own."""
    monkeypatch.setattr("ledpi.workshop.calibrate.taking.BLIND_FRAMES", 2)
    chessboard = rendered(POSES[0], np.random.default_rng(0))
    open_at, _ = opener(iter([chessboard] * 3), 40_000.0)
    said: list[str] = []
    collect_views(open_at, CHARUCO, said.append, metered=False)
    assert "--board chessboard --cols 6 --rows 5 is seen" in said[-1]


@pytest.mark.slow
def test_a_board_that_moves_is_not_taken() -> None:
    """Rows are exposed one after another: a view counts only where the frame before shows the same."""
    open_at, _ = opener(shown(1), 40_000.0)
    collection, _ = collect_views(open_at, CHARUCO, lambda text: None, metered=False)
    assert collection.frames == 1 + len(POSES)
    assert collection.views == []


def test_the_same_view_is_not_taken_twice() -> None:
    """A board that stays where it is gives one view."""
    collection = Collection(board=BOARD, width=640, height=480)
    view = projected("", POSES[0], seed=0)
    assert [collection.add(view) for _ in range(4)] == [False, True, False, False]


@pytest.mark.parametrize(
    ("turns", "away"),
    [((0, 30, 0), "left"), ((0, -30, 0), "right"), ((-30, 0, 0), "upper"), ((30, 0, 0), "lower")],
)
def test_it_asks_for_the_tilt_that_is_missing(turns: tuple[int, int, int], away: str) -> None:
    """Turned about y by +30° the board's left side is the farther one, as z = −x·sin 30°; and so on."""
    collection = Collection(board=BOARD, width=640, height=480)
    for side_turns in ((0, 30, 0), (0, -30, 0), (-30, 0, 0), (30, 0, 0)):
        for place in ((0.0, 0.0), (0.15, 0.1)):
            if side_turns != turns:
                view = projected("", (side_turns, place, 11), seed=0)
                collection.add(view)
                assert collection.add(view)
    text = collection.missing()
    assert text is not None
    assert f"its {away} side away from the camera" in text
    tilt = attitude_of(projected("", (turns, (0.0, 0.0), 11), seed=0), BOARD, 640).normal_deg
    assert np.abs(tilt).max() == pytest.approx(30, abs=4)


def test_it_asks_for_places_and_then_is_content() -> None:
    """With every side tilted it names a part of the picture without corners; it ends with enough views everywhere."""
    collection = Collection(board=BOARD, width=640, height=480)
    poses: list[Pose] = [
        (turns, (across, down), 9)
        for across in (-0.2, 0.2)
        for down in (-0.12, 0.12)
        for turns in ((0, 30, 0), (0, -30, 0), (-30, 0, 0), (30, 0, 0), (0, 0, 0))
    ]
    wanted = []
    for pose in poses:
        view = projected("", pose, seed=0)
        collection.add(view)
        collection.add(view)
        wanted.append(collection.missing())
    assert any(text is not None and text.startswith("show the board at the ") for text in wanted)
    assert wanted[-1] is None
    assert len(collection.views) >= ENOUGH_VIEWS


@pytest.mark.parametrize(
    ("white", "exposure_us", "gain", "expected"),
    [
        (128, 10_000.0, 1.0, None),
        (32, 10_000.0, 1.0, (10_000.0, 4.0)),  # no longer, as a hand trembles
        (32, 2_000.0, 1.0, (8_000.0, 1.0)),  # longer before noisier
        (2, 10_000.0, 1.0, (10_000.0, 8.0)),  # and no noisier than 8
        (255, 10_000.0, 8.0, (10_000.0, 1.0)),  # four times too bright at least
    ],
)
def test_exposure_and_gain(white: int, exposure_us: float, gain: float, expected: tuple[float, float] | None) -> None:
    """White is to be at half of full scale (within 0.25 to 0.8 it may stay): longer first, then amplified."""
    found = next_exposure(frame_of(np.full((480, 640), white, np.uint8), 0, exposure_us, gain), None)
    assert found == (pytest.approx(expected, rel=0.02) if expected is not None else None)


@pytest.mark.slow
def test_a_simulated_board_gives_the_simulated_lens(ledpi: Run) -> None:
    """The whole chain, a rolling shutter included: within four deviations of the lens that the recording tells of."""
    # Three frames at each of ten places, two of them at rest.
    ledpi("simulate", "take", "--scene", "board", "--frames", "30", "--set", "camera.frame_duration_us=166667")
    Path("config.yaml").write_text("panels: {side_m: 0.16}\n")
    status, output, errors = ledpi("calibrate", "camera", "take")
    assert status == 0
    assert "no config.yaml was changed; to use it: camera.intrinsics: camera.yaml" in output
    assert Path("config.yaml").read_text() == "panels: {side_m: 0.16}\n"  # a recording's lens may be any camera's
    assert "0 views; tilt the board: its left side away" in errors
    assert "30 pictures, 10 with the board" in output
    deviations = yaml.safe_load(Path("camera.yaml").read_text())["ledpi"]["deviations"]
    lens, truth = load_intrinsics(Path("camera.yaml")), load_recording(Path("take")).camera.intrinsics
    assert truth is not None
    for name in ("fx", "fy", "cx", "cy"):
        assert abs(getattr(lens, name) - getattr(truth, name)) < 4 * deviations[name]
    assert deviations["fx"] < 0.002 * lens.fx
