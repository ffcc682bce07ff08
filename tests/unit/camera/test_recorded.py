"""A recording as a camera: pace, order, and what happens to a reader that is too slow."""

from __future__ import annotations

import itertools
import logging
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ledpi.camera.recorded import RecordingCamera, camera_with
from ledpi.camera.recording.reader import load_recording
from ledpi.camera.recording.writer import RecordingWriter
from ledpi.config.settings import load_config
from ledpi.core.records import CameraInfo, Frame, Intrinsics, PanelSpec, Rejected

HEIGHT, WIDTH, ROW_US = 6, 8, 100.0
READOUT_NS = 600_000  # 6 rows
LENS = Intrinsics(width=WIDTH, height=HEIGHT, fx=10.0, fy=11.0, cx=3.5, cy=2.5)
SOURCE = CameraInfo(
    width=WIDTH,
    height=HEIGHT,
    exposure_us=150.0,
    row_time_us=ROW_US,
    transfer="linear",
    frame_length_rows=20,
    intrinsics=LENS,
)
PANEL = PanelSpec(side_m=0.3, black_hz=1262.0, white_hz=2450.0, duty=0.4)


def recorded(folder: Path, times_ms: list[int]) -> Path:
    """A recording whose picture number n is all 10 + n, with seq 10 · n."""
    with RecordingWriter(folder, camera=SOURCE, dictionary="DICT_5X5_50", panel=PANEL) as recorder:
        for number, time_ms in enumerate(times_ms):
            frame = Frame(
                pixels=np.full((HEIGHT, WIDTH), 10 + number, np.uint8),
                seq=10 * number,
                row0_readout_ns=time_ms * 1_000_000,
                exposure_us=149.0 + number,
                row_time_us=ROW_US,
                transfer="linear",
                analogue_gain=1.0 + number,
            )
            recorder.write(frame)
    return folder


def picture() -> np.ndarray:
    return np.zeros((HEIGHT, WIDTH), np.uint8)


def read(camera: RecordingCamera) -> Frame:
    frame = camera.read(picture())
    assert isinstance(frame, Frame)
    return frame


def test_unpaced_delivers_every_frame_at_once(tmp_path: Path) -> None:
    """All frames in order with their own values, an hour of recording in no time."""
    camera = RecordingCamera(load_recording(recorded(tmp_path, [0, 1, 3_600_000])), paced=False)
    start = time.monotonic()
    for number, time_ms in enumerate([0, 1, 3_600_000]):
        frame = read(camera)
        assert (frame.seq, frame.row0_readout_ns) == (10 * number, time_ms * 1_000_000)
        assert (frame.exposure_us, frame.analogue_gain) == (149.0 + number, 1.0 + number)
        assert (frame.row_time_us, frame.transfer) == (ROW_US, "linear")
        assert (frame.pixels == 10 + number).all()
    assert camera.read(picture()) is None
    assert time.monotonic() - start < 60


def test_a_slow_reader_of_a_paced_replay_loses_frames_as_with_a_sensor(tmp_path: Path) -> None:
    """After a pause the reader gets a current frame; what it slept through is counted, not served late."""
    camera = RecordingCamera(load_recording(recorded(tmp_path, [0, 30, 60, 90, 120, 150, 5000])), paced=True)
    first = read(camera)
    time.sleep(0.1)
    second = read(camera)
    late_ns = time.monotonic_ns() - (second.row0_readout_ns + second.host_offset_ns + READOUT_NS)
    assert second.seq >= 30
    assert camera.missed == second.seq // 10 - 1
    assert first.host_offset_ns == second.host_offset_ns
    assert late_ns >= 0
    camera.close()


def test_the_last_frame_is_never_missed(tmp_path: Path) -> None:
    """However late the reader comes, a last frame has no successor that overtakes it."""
    camera = RecordingCamera(load_recording(recorded(tmp_path, [0, 10, 20])), paced=True)
    read(camera)
    time.sleep(0.1)
    assert read(camera).seq == 20
    assert camera.missed == 1
    assert camera.read(picture()) is None


@pytest.mark.parametrize("paced", [True, False])
def test_a_bad_picture_is_rejected_and_the_rest_goes_on(
    tmp_path: Path, paced: bool, caplog: pytest.LogCaptureFixture
) -> None:
    """One truncated and one missing picture among four: two frames, two Rejected; the log names the files."""
    recording = load_recording(recorded(tmp_path, [0, 150, 300, 450]))
    whole = recording.frames[1].picture.read_bytes()
    recording.frames[1].picture.write_bytes(whole[: len(whole) // 2])
    recording.frames[2].picture.unlink()
    camera = RecordingCamera(recording, paced=paced)
    with caplog.at_level(logging.WARNING):
        got = [camera.read(picture()) for _ in range(4)]
    keys = [item.key if isinstance(item, Rejected) else "frame" for item in got]
    assert keys == ["frame", "capture.truncated", "capture.unreadable", "frame"]
    assert "frames/000010.png: ends after" in caplog.text
    assert "frames/000020.png: cannot be read: No such file" in caplog.text
    assert camera.read(picture()) is None


def test_a_loop_goes_on_in_seq_and_time(tmp_path: Path) -> None:
    """Rounds follow each other with seq and time increasing, and with a gap in time that ends every track."""
    camera = RecordingCamera(load_recording(recorded(tmp_path, [5, 6, 8])), paced=False, loop=True)
    frames = [read(camera) for _ in range(9)]
    assert [int(frame.pixels[0, 0]) for frame in frames] == [10, 11, 12] * 3
    assert [frame.seq for frame in frames] == [0, 10, 20, 21, 31, 41, 42, 52, 62]
    steps_ms = [
        (later.row0_readout_ns - earlier.row0_readout_ns) / 1e6 for earlier, later in itertools.pairwise(frames)
    ]
    assert steps_ms == [1, 2, 600, 1, 2, 600, 1, 2]


def test_a_camera_that_was_upside_down_is_taken_for_one_unless_told_otherwise() -> None:
    """The default of a configuration does not matter: `--set` gives it."""
    turned, size = replace(SOURCE, rows_from="below"), ("panels.side_m=0.3",)
    assert camera_with(load_config(None, size), turned).rows_from == "below"
    assert camera_with(load_config(None, (*size, "camera.rows_from=above")), turned).rows_from == "above"
