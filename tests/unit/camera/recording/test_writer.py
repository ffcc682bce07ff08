"""Writing recordings: what was written is read back, and what cannot be written is refused."""

from __future__ import annotations

import dataclasses
import os
import resource
from pathlib import Path

import numpy as np
import pytest
import yaml

from ledpi.camera.recording.picture import read_picture
from ledpi.camera.recording.reader import TruthMarker, load_recording
from ledpi.camera.recording.writer import RecordingWriter
from ledpi.core.errors import RecordingError
from ledpi.core.records import CameraInfo, Frame, Intrinsics, PanelSpec, Pose

LENS = Intrinsics(width=8, height=6, fx=10.5, fy=11.0, cx=3.5, cy=2.5, distortion=(0.1, 0.2, 0.3, 0.4, 0.5))
CAMERA = CameraInfo(
    width=8,
    height=6,
    exposure_us=150.0,
    row_time_us=31.75,
    transfer="linear",
    frame_length_rows=509,
    intrinsics=LENS,
)
PANEL = PanelSpec(side_m=0.3, black_hz=1262.0, white_hz=2450.0, duty=0.4)
PICTURE = np.arange(48, dtype=np.uint8).reshape(6, 8)
MARKER = TruthMarker(
    id=7,
    corners_px=np.array([[1.25, 2], [3, 2], [3, 4], [1, 4]]),
    camera_from_marker=Pose(position_m=np.array([0.1, 0.2, 0.6]), quaternion_wxyz=np.array([0.0, 1, 0, 0])),
    optional=True,
)


def frame(seq: int, time_ns: int, **changes: object) -> Frame:
    values = {"exposure_us": 149.5, "row_time_us": 31.75, "transfer": "linear", "analogue_gain": 2.5}
    values |= changes
    return Frame(pixels=PICTURE + seq, seq=seq, row0_readout_ns=time_ns, **values)  # type: ignore[arg-type]


def writer(folder: Path, camera: CameraInfo = CAMERA) -> RecordingWriter:
    return RecordingWriter(folder, camera=camera, dictionary="DICT_5X5_50", panel=PANEL, note="two\nlines")


@pytest.mark.parametrize(
    "camera",
    [
        CAMERA,
        dataclasses.replace(CAMERA, frame_length_rows=29_700),  # of 33.67 µs, most of them blanking
        CameraInfo(width=8, height=6, exposure_us=150.0, row_time_us=31.75, transfer="linear"),
    ],
    ids=["whole", "a frame a second", "uncalibrated"],
)
def test_what_was_written_is_read_back(tmp_path: Path, camera: CameraInfo) -> None:
    """Camera, panel and pictures; what is not known is not known afterwards. The files' words: below."""
    with writer(tmp_path / "new" / "take", camera) as recorder:
        recorder.write(frame(3, 1_000_000_007))
        recorder.write(frame(9, 2_000_000_009))
    recording = load_recording(tmp_path / "new" / "take")
    assert (recording.camera, recording.dictionary, recording.panel) == (camera, "DICT_5X5_50", PANEL)
    assert recording.truth is None
    assert [(entry.seq, entry.row0_readout_ns) for entry in recording.frames] == [
        (3, 1_000_000_007),
        (9, 2_000_000_009),
    ]
    into = np.zeros((6, 8), np.uint8)
    assert read_picture(recording.frames[1].picture, into) is None
    assert np.array_equal(into, PICTURE + 9)


def test_the_files_hold_the_contract_s_keys(tmp_path: Path) -> None:
    """The files are as the design gives them, to the letter: other programs read them."""
    with writer(tmp_path) as recorder:
        recorder.write(frame(3, 1_000_000_007), [MARKER])
    header = yaml.safe_load((tmp_path / "recording.yaml").read_text())
    lens = {"fx": 10.5, "fy": 11.0, "cx": 3.5, "cy": 2.5, "distortion": [0.1, 0.2, 0.3, 0.4, 0.5]}
    rows = {"row_time_us": 31.75, "exposure_us": 150.0, "transfer": "linear", "frame_length_rows": 509}
    panel = {"dictionary": "DICT_5X5_50", "side_m": 0.3, "black_hz": 1262.0, "white_hz": 2450.0, "duty": 0.4}
    camera = {"width": 8, "height": 6, **rows, **lens}
    assert header == {"format": 1, "note": "two\nlines", "camera": camera, "panel": panel}
    assert (tmp_path / "frames.jsonl").read_text() == (
        '{"seq":3,"file":"frames/000003.png","sensor_timestamp_ns":1000000007,"exposure_us":149.5,'
        '"analogue_gain":2.5}\n'
    )
    assert (tmp_path / "truth.jsonl").read_text() == (
        '{"seq":3,"markers":[{"id":7,"corners_px":[[1.25,2.0],[3.0,2.0],[3.0,4.0],[1.0,4.0]],'
        '"position_m":[0.1,0.2,0.6],"quaternion_wxyz":[0.0,1.0,0.0,0.0],"optional":true}]}\n'
    )


def test_each_frame_is_there_before_the_next(tmp_path: Path) -> None:
    """Leaves a recording at a crash: each line reaches the kernel after its picture."""
    with writer(tmp_path) as recorder:
        for seq in range(3):
            recorder.write(frame(seq, 1000 + seq))
            assert len(load_recording(tmp_path).frames) == seq + 1


def test_a_folder_that_holds_something_or_is_a_file_is_refused(tmp_path: Path) -> None:
    """No recording is ever written over, or into, another."""
    (tmp_path / "note.txt").write_text("mine")
    for place, says in (
        (tmp_path, "is not empty; a recording needs a new or"),
        (tmp_path / "note.txt", "be written: "),
    ):
        with pytest.raises(RecordingError, match=says), writer(place):
            pass
    assert [path.name for path in tmp_path.iterdir()] == ["note.txt"]


@pytest.mark.parametrize(
    ("second", "message"),
    [
        (frame(0, 2000), "frame 0: seq: is 0; must be more than the last frame's 0"),
        (frame(1, 999), "frame 1: sensor_timestamp_ns: time runs backward, from 1000 to 999"),
        (frame(1, 2000, row_time_us=33.0), "transfer are (8, 6, 33.0, 'linear'); must be (8, 6, 31.75"),
        (frame(1, 2000, transfer="srgb"), "transfer are (8, 6, 31.75, 'srgb'); must be (8, 6, 31.75"),
    ],
)
def test_a_frame_that_could_not_be_read_back_is_refused(tmp_path: Path, second: Frame, message: str) -> None:
    """The writer holds to the format itself: what it accepts, the reader accepts."""
    with writer(tmp_path) as recorder:
        recorder.write(frame(0, 1000))
        with pytest.raises(RecordingError) as caught:
            recorder.write(second)
    assert message in str(caught.value)
    assert len(load_recording(tmp_path).frames) == 1


@pytest.mark.parametrize(("most_bytes", "names", "left"), [(165, "frames.jsonl", [0]), (20, "000001.png", None)])
def test_a_full_disk_leaves_whole_frames(tmp_path: Path, most_bytes: int, names: str, left: list[int] | None) -> None:
    """On a full disk (here: a limit on a file's size) the file is named, and the rest stays readable.

    A line and a half fit, of 110 bytes, and every picture does; or not even that: half a picture is taken away.
    """
    with writer(tmp_path) as recorder:
        limit = resource.getrlimit(resource.RLIMIT_FSIZE)
        resource.setrlimit(resource.RLIMIT_FSIZE, (most_bytes, limit[1]))
        try:
            if left is not None:
                recorder.write(frame(0, 1000))
            with pytest.raises(RecordingError, match=rf"{names}: cannot be written: File too large"):
                recorder.write(frame(1, 2000))
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, limit)
    if left is None:
        assert os.listdir(tmp_path / "frames") == []
    else:
        assert [entry.seq for entry in load_recording(tmp_path).frames] == left


def test_writing_outside_the_block_is_a_mistake_of_the_program(tmp_path: Path) -> None:
    """The files are open only inside the `with` block."""
    with pytest.raises(ValueError, match="inside its `with` block"):
        writer(tmp_path).write(frame(0, 0))
