"""Reading recordings: what is legal, and what is said of one that is broken."""

from __future__ import annotations

import json
import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest

from ledpi.camera.recording.picture import read_picture
from ledpi.camera.recording.reader import find_recordings, load_recording
from ledpi.core.errors import RecordingError

HEADER = """\
format: 1
note: written by hand
camera: {width: 8, height: 6, row_time_us: 33.67, frame_length_rows: 504,
         exposure_us: 10000.0, transfer: srgb,
         fx: 643.0, fy: 544.0, cx: 3.2, cy: 2.8, distortion: [0.08, -0.18, 0.0008, -0.0006, 0.05]}
panel: {dictionary: DICT_4X4_50, side_m: 0.16, black_hz: 1250.0, white_hz: 2450.0, duty: 0.5}
"""
FRAMES = """\
{"seq": 0, "file": "frames/000000.png", "sensor_timestamp_ns": 1010000000, "exposure_us": 10000.0}
{"seq": 1, "file": "frames/000001.png", "sensor_timestamp_ns": 1026969680, "exposure_us": 9967, \
"analogue_gain": 2.5}
{"seq": 40, "file": "frames/000040.png", "sensor_timestamp_ns": 3000000000, "exposure_us": 10000.0}
"""
TRUTH = """\
{"seq": 1, "markers": [{"id": 7, "corners_px": [[1, 2], [3, 2], [3, 4], [1, 4]], \
"position_m": [0.1, 0.2, 0.6], "quaternion_wxyz": [0, 1, 0, 0], "optional": true}]}
{"seq": 40, "markers": []}
"""
PICTURE = np.arange(48, dtype=np.uint8).reshape(6, 8)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A whole recording of three frames in two takes, its text written by hand."""
    place = tmp_path / "take"
    (place / "frames").mkdir(parents=True)
    (place / "recording.yaml").write_text(HEADER)
    (place / "frames.jsonl").write_text(FRAMES)
    (place / "truth.jsonl").write_text(TRUTH)
    for seq in (0, 1, 40):
        cv2.imwrite(str(place / f"frames/{seq:06d}.png"), PICTURE + seq)
    return place


def replace(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


def complaint(folder: Path) -> str:
    with pytest.raises(RecordingError) as caught:
        load_recording(folder)
    message = str(caught.value)
    assert "\n" not in message
    return message.replace(str(folder), "take")


def test_all_values_are_read(folder: Path) -> None:
    """Camera, lens, panel, frames and truth arrive as they stand in the files."""
    recording = load_recording(folder)
    camera, lens = recording.camera, recording.camera.intrinsics
    assert (camera.width, camera.height, camera.row_time_us, camera.frame_length_rows) == (8, 6, 33.67, 504)
    assert (camera.exposure_us, camera.transfer) == (10000.0, "srgb")
    assert lens is not None
    assert (lens.width, lens.height, lens.fx, lens.fy, lens.cx, lens.cy) == (8, 6, 643.0, 544.0, 3.2, 2.8)
    assert lens.distortion == (0.08, -0.18, 0.0008, -0.0006, 0.05)
    assert recording.dictionary == "DICT_4X4_50"
    assert (recording.panel.side_m, recording.panel.black_hz) == (0.16, 1250.0)
    assert (recording.panel.white_hz, recording.panel.duty) == (2450.0, 0.5)
    second = recording.frames[1]
    assert (second.seq, second.row0_readout_ns, second.exposure_us) == (1, 1026969680, 9967.0)
    assert (second.analogue_gain, second.picture) == (2.5, folder / "frames/000001.png")
    assert recording.frames[0].analogue_gain is None
    assert recording.truth is not None
    (marker,) = recording.truth[1]
    assert (marker.id, marker.optional) == (7, True)
    assert marker.corners_px.tolist() == [[1, 2], [3, 2], [3, 4], [1, 4]]
    assert marker.camera_from_marker.position_m.tolist() == [0.1, 0.2, 0.6]
    assert marker.camera_from_marker.quaternion_wxyz.tolist() == [0, 1, 0, 0]
    assert recording.truth[40] == ()


def test_what_need_not_be_there(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    """The five lens keys, a pose beside true corners, the last line break; a later recorder may say more."""
    start, end = HEADER.index(",\n         fx"), HEADER.index("}\npanel")
    (folder / "recording.yaml").write_text(HEADER[:start] + HEADER[end:])
    lines = [json.loads(line) | {"decoded": True} for line in FRAMES.splitlines()]
    (folder / "frames.jsonl").write_text("\n".join(json.dumps(line) for line in lines))
    replace(folder / "truth.jsonl", '"position_m": [0.1, 0.2, 0.6], "quaternion_wxyz": [0, 1, 0, 0], ', "")
    recording = load_recording(folder)
    assert recording.camera.intrinsics is None
    assert [entry.seq for entry in recording.frames] == [0, 1, 40]  # two takes, two seconds apart
    assert recording.truth is not None
    assert recording.truth[1][0].camera_from_marker is None
    assert recording.truth[1][0].corners_px.tolist() == [[1, 2], [3, 2], [3, 4], [1, 4]]
    assert caplog.messages == []
    (folder / "truth.jsonl").unlink()
    assert load_recording(folder).truth is None


@pytest.mark.parametrize(
    ("name", "old", "new", "message"),
    [
        ("recording.yaml", "format: 1", "format: 2", "take/recording.yaml: format: is 2; this version reads"),
        ("recording.yaml", "format: 1", "f: 1", "take/recording.yaml: format: is missing; must be 1"),
        ("recording.yaml", HEADER, "[1, 2]", "take/recording.yaml: must be a mapping with format"),
        ("recording.yaml", HEADER, "a: [1", "take/recording.yaml: not valid YAML: "),
        ("recording.yaml", "DICT_4X4_50", "DICT_X", "panel.dictionary: unknown dictionary 'DICT_X'; known:"),
        ("recording.yaml", "row_time_us: 33.67, ", "", "camera.row_time_us: is missing; must be given"),
        ("recording.yaml", "33.67", "-1", "camera.row_time_us: must be greater than or equal to 1, not -1"),
        ("recording.yaml", "33.67", "33670", "camera.row_time_us: must be less than or equal to 1000, not 33670"),
        ("recording.yaml", "0.16", "160", "panel.side_m: must be in metres, 10 at most (160 mm are 0.16), not 160"),
        ("recording.yaml", "33.67", ".nan", "camera.row_time_us: must be a finite number, not nan"),
        ("recording.yaml", "srgb", "g", "camera.transfer: must be 'linear' or 'srgb', not 'g'"),
        ("recording.yaml", "fy: 544.0, ", "", "camera.fy: is missing; give all of fx, fy, cx, cy, dist"),
        ("recording.yaml", "[0.08, -0.18, ", "[", "camera.distortion: must be 5 numbers, not [0.0008, -0.0006, 0.05]"),
        ("recording.yaml", "0.05]", ".inf]", "camera.distortion.4: must be a finite number, not inf"),
        ("recording.yaml", "643.0", "0.5", "camera.fx: must be 0.8 to 800 pixels for pictures of 8 × 6, not 0.5"),
        ("recording.yaml", "3.2", "17", "camera.cx: must be -8 to 16 pixels for pictures of 8 × 6, not 17"),
        ("recording.yaml", "2450.0", "1250.0", "recording.yaml: panel: black_hz and white_hz must differ"),
        ("frames.jsonl", FRAMES, "", "take/frames.jsonl: is empty; must hold a line for each frame"),
        ("frames.jsonl", '"seq": 1', '"sq": 1', "take/frames.jsonl: line 2: seq: is missing; must be given"),
        ("frames.jsonl", '"seq": 1', '"seq": 0', "line 2: seq: is 0; must be more than the last frame's 0"),
        (
            "frames.jsonl",
            "1026969680",
            "1009999999",
            "line 2: sensor_timestamp_ns: time runs backward, from 1010000000 to 1009999999; must increase",
        ),
        ("frames.jsonl", "9967", "0", "line 2: exposure_us: must be greater than or equal to 1, not 0"),
        ("frames.jsonl", "2.5}", "2.5", "take/frames.jsonl: line 2: not valid JSON"),
        ("frames.jsonl", "frames/000001.png", "../x.png", "line 2: file: must be a path inside"),
        ("frames.jsonl", FRAMES, "[1]\n", "take/frames.jsonl: line 1: must be a JSON object, not list"),
        ("truth.jsonl", '"seq": 40', '"seq": 41', "truth.jsonl: line 2: seq: is 41; must be that of a frame"),
        ("truth.jsonl", '"seq": 40', '"seq": 1', "take/truth.jsonl: line 2: seq: 1 has a line already"),
        ("truth.jsonl", "[0, 1, 0, 0]", "[0, 0, 0, 0]", "line 1: markers.0.quaternion_wxyz: is no rotation"),
        ("truth.jsonl", '"position_m": [0.1, 0.2, 0.6], ', "", "position_m and quaternion_wxyz come together"),
        ("truth.jsonl", "[3, 2], ", "", "truth.jsonl: line 1: markers.0.corners_px.3: is missing"),
    ],
)
def test_a_broken_description_names_file_key_and_remedy(
    folder: Path, name: str, old: str, new: str, message: str
) -> None:
    """Each mistake is one line: the file, the line or key, what is wrong, and what would be right."""
    replace(folder / name, old, new)
    assert message in complaint(folder)


def test_frames_whose_last_line_is_cut_off_are_read_up_to_it(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    """As after a power cut; wherever it is cut, and where zeros follow. Truth may go on for the frame that is lost."""
    two, last = FRAMES[: FRAMES.index('{"seq": 40')], FRAMES[FRAMES.index('{"seq": 40') :]
    for rest in [*(last[:length] for length in range(1, len(last) - 1)), last[:50] + "\0" * 9, "\0" * 9]:
        caplog.clear()
        (folder / "frames.jsonl").write_text(two + rest)
        recording = load_recording(folder)
        assert [entry.seq for entry in recording.frames] == [0, 1]
        assert recording.truth is not None
        assert list(recording.truth) == [1]
        (said,) = caplog.messages
        assert said == f"{folder}/frames.jsonl: line 3: is cut off; it is left out, what stands before it is read"


def test_truth_whose_last_line_is_cut_off_is_read_up_to_it(folder: Path, caplog: pytest.LogCaptureFixture) -> None:
    """The frames are all there, the last one's truth is not known."""
    (folder / "truth.jsonl").write_text(TRUTH[:-5])
    recording = load_recording(folder)
    assert len(recording.frames) == 3
    assert recording.truth is not None
    assert list(recording.truth) == [1]
    (said,) = caplog.messages
    assert said.startswith(f"{folder}/truth.jsonl: line 2: is cut off; ")


@pytest.mark.parametrize(
    ("text", "line"),
    [(FRAMES[:50], 1), (FRAMES.rstrip("}\n") + "\n", 3), (FRAMES.replace(' "exposure_us": 9967', ""), 2)],
    ids=["no whole line", "a line break after it", "in the middle"],
)
def test_any_other_broken_line_is_refused(folder: Path, text: str, line: int) -> None:
    """It was not cut off, or nothing is left: nobody can tell what else is wrong."""
    (folder / "frames.jsonl").write_text(text)
    assert complaint(folder).startswith(f"take/frames.jsonl: line {line}: not valid JSON")


def test_a_missing_or_damaged_file_is_named(folder: Path, tmp_path: Path) -> None:
    """At which byte it is no longer text; both files that make a recording must be there, and its folder."""
    (folder / "frames.jsonl").write_bytes(FRAMES.encode()[:20] + b"\xff\xfe" + FRAMES.encode()[20:])
    assert complaint(folder) == "take/frames.jsonl: byte 20 is not UTF-8 text"
    for name in ("frames.jsonl", "recording.yaml"):
        (folder / name).unlink()
        said = f"take/{name}: is missing; a recording has recording.yaml, frames.jsonl and its pictures"
        assert complaint(folder) == said
    with pytest.raises(RecordingError, match="nowhere: cannot be read as a folder: No such file"):
        find_recordings(tmp_path / "nowhere")


def test_recordings_are_found_sorted_with_the_broken_ones(folder: Path, tmp_path: Path) -> None:
    """A folder with only one of the two files is a broken recording, not none; a plain folder is none."""
    (tmp_path / "b" / "deep").mkdir(parents=True)
    (tmp_path / "b" / "deep" / "frames.jsonl").write_text("")
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "recording.yaml").write_text("")
    (tmp_path / "photographs").mkdir()
    assert find_recordings(tmp_path) == (tmp_path / "a", tmp_path / "b/deep", folder)
    assert find_recordings(folder) == (folder,)


# ---- Pictures


def chunk(name: bytes, content: bytes) -> bytes:
    return struct.pack(">I", len(content)) + name + content + struct.pack(">I", zlib.crc32(name + content))


def grey_png() -> bytes:
    """PICTURE as a PNG in two IDAT chunks, put together by hand from the PNG specification."""
    rows = zlib.compress(b"".join(b"\0" + row.tobytes() for row in PICTURE))
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", 8, 6, 8, 0, 0, 0, 0))
    parts = chunk(b"IDAT", rows[:20]) + chunk(b"IDAT", rows[20:])
    return b"\x89PNG\r\n\x1a\n" + header + parts + chunk(b"IEND", b"")


def test_a_picture_that_is_cut_or_changed_anywhere_is_noticed(tmp_path: Path) -> None:
    """A whole one arrives in the caller's array; of one that is cut, or has a wrong byte, nothing does."""
    whole, path, into = grey_png(), tmp_path / "p.png", np.full((6, 8), 99, np.uint8)
    cut = [whole[:length] for length in range(len(whole))]
    for damaged in (*cut, *(whole[:at] + bytes([byte ^ 0x10]) + whole[at + 1 :] for at, byte in enumerate(whole))):
        path.write_bytes(damaged)
        bad = read_picture(path, into)
        assert bad is not None, damaged
        assert bad.rejected.stage == "capture"
        assert bad.rejected.reason == "truncated" or damaged not in cut, (damaged, bad.message)
        assert bad.message.startswith(f"{path}: ")
        assert (into == 99).all()
    path.write_bytes(whole)
    assert read_picture(path, into) is None
    assert np.array_equal(into, PICTURE)


NO_ZLIB = chunk(b"IHDR", struct.pack(">IIBBBBB", 8, 6, 8, 0, 0, 0, 0)) + chunk(b"IDAT", b"not zlib")


@pytest.mark.parametrize(
    ("content", "reason", "what"),
    [
        (cv2.imencode(".png", np.zeros((6, 9), np.uint8))[1].tobytes(), "wrong_size", "is 9 × 6 pixels; must be 8 × 6"),
        (cv2.imencode(".png", np.zeros((6, 8, 3)))[1].tobytes(), "unreadable", "is 8-bit colour; must be 8-bit grey"),
        (
            cv2.imencode(".png", np.zeros((6, 8), np.uint16))[1].tobytes(),
            "unreadable",
            "is 16-bit grey; must be 8-bit grey",
        ),
        (None, "unreadable", "cannot be read: No such file or directory"),
        (cv2.imencode(".jpg", PICTURE)[1].tobytes(), "unreadable", "is not a PNG file; must be an 8-bit grey PNG"),
        (b"\x89PNG\r\n\x1a\n" + NO_ZLIB + chunk(b"IEND", b""), "unreadable", ""),  # refused by OpenCV
    ],
    ids=["size", "colour", "16 bits", "missing", "JPEG", "no zlib"],
)
def test_a_picture_that_is_none_is_one_bad_frame(tmp_path: Path, content: bytes | None, reason: str, what: str) -> None:
    """Size and kind are named as they are and as they must be."""
    path = tmp_path / "p.png"
    if content is not None:
        path.write_bytes(content)
    bad = read_picture(path, np.zeros((6, 8), np.uint8))
    assert bad is not None
    assert (bad.rejected.stage, bad.rejected.reason) == ("capture", reason)
    assert bad.message.startswith(f"{path}: {what}")
