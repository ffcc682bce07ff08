"""`ledpi decode` as its user sees it: a line of JSON a frame, and one clear line for whatever is wrong."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from dataclasses import asdict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from ledpi.camera.recording.picture import with_text
from ledpi.camera.recording.reader import load_recording
from ledpi.camera.recording.writer import RecordingWriter
from ledpi.camera.simulate.scene import SimulatedSensor
from ledpi.camera.simulate.scenes import ov5647_lens, still_scene
from ledpi.camera.simulated import SimulatedCamera
from ledpi.core.records import CameraInfo, Frame, PanelSpec
from tests.builders import ROOT
from tests.builders.command import LEDPI, Run, complaint, in_process
from tests.builders.command import ledpi as own_process

COMMAND = [*LEDPI, "decode"]
SPEC = PanelSpec(side_m=0.16, black_hz=1250.0, white_hz=2450.0)
FRAMES = 4
TIME_OF_LINE_2 = round(1e9 + 504 * 33.67e3)


def write_recording(folder: Path, marker_id: int, *, calibrated: bool = True) -> None:
    """FRAMES frames of one panel 1 m away, turned by 20°."""
    lens = ov5647_lens()
    sensor = SimulatedSensor(intrinsics=lens, exposure_us=9966.32, row_time_us=33.67, frame_length_rows=504)
    scene = still_scene(sensor, {marker_id: SPEC}, "DICT_4X4_50", distance_m=1.0, angle_deg=20.0)
    camera = SimulatedCamera(scene, seed=1, paced=False, frames=FRAMES)
    values = asdict(camera.info) | {"intrinsics": lens if calibrated else None}
    with RecordingWriter(folder, camera=CameraInfo(**values), dictionary="DICT_4X4_50", panel=SPEC) as writer:
        into = np.empty((480, 640), np.uint8)
        while isinstance(frame := camera.read(into), Frame):
            writer.write(frame, camera.truth(frame.seq))


@pytest.fixture(scope="module")
def kept(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two recordings below one folder: shelf/one (7) and shelf/deep/two (23). Only to be read."""
    shelf = tmp_path_factory.mktemp("recordings") / "shelf"
    (shelf / "deep").mkdir(parents=True)
    write_recording(shelf / "one", 7)
    write_recording(shelf / "deep" / "two", 23, calibrated=False)
    return shelf


@pytest.fixture
def take(kept: Path, tmp_path: Path) -> Path:
    """A recording of one's own, to be broken."""
    shutil.copytree(kept / "one", tmp_path / "take")
    return tmp_path / "take"


def lines(text: str) -> list[dict[str, Any]]:
    return [json.loads(line) for line in text.splitlines()]


def process(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return own_process("decode", *arguments)


@pytest.fixture
def ledpi(monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], tmp_path: Path) -> Run:
    """The command within this process, which is quicker: exit status, standard output, standard error."""
    monkeypatch.chdir(tmp_path)  # no config.yaml is there
    return in_process(monkeypatch, capfd, "decode")


# ---- What is printed


@pytest.mark.slow
def test_a_recording_gives_a_line_of_json_a_frame(kept: Path) -> None:
    """As a command of its own: the right ID and place in every frame, nothing on standard error, status 0."""
    done = process(kept / "one")
    assert (done.returncode, done.stderr) == (0, "")
    frames = lines(done.stdout)
    assert [frame["seq"] for frame in frames] == list(range(FRAMES))
    assert [frame["recording"] for frame in frames] == ["one"] * FRAMES
    assert frames[1]["sensor_timestamp_ns"] == TIME_OF_LINE_2
    for frame in frames:
        (marker,) = frame["markers"]
        assert marker["id"] == 7
        np.testing.assert_allclose(marker["position_m"], [0, 0, 1], atol=0.01)
        assert frame["decode_ms"] > 0


def test_a_stream_remembers_and_single_frames_do_not(ledpi: Run, kept: Path) -> None:
    """`frames_used` grows from frame to frame; with --single-frame each frame is alone."""
    _, stream, _ = ledpi(kept / "one")
    _, alone, _ = ledpi("--single-frame", kept / "one")
    assert [frame["markers"][0]["frames_used"] for frame in lines(stream)] == [1, 2, 3, 4]
    assert [frame["markers"][0]["frames_used"] for frame in lines(alone)] == [1, 1, 1, 1]


def test_a_folder_of_recordings_is_decoded_whole(ledpi: Run, kept: Path) -> None:
    """Each is named by its path below the folder; each is a stream of its own."""
    status, output, errors = ledpi(kept)
    assert (status, errors) == (0, "")
    frames = lines(output)
    assert [frame["recording"] for frame in frames] == ["deep/two"] * FRAMES + ["one"] * FRAMES
    assert [frame["markers"][0]["id"] for frame in frames] == [23] * FRAMES + [7] * FRAMES


def test_a_recording_without_calibration_gives_ids_only(ledpi: Run, kept: Path) -> None:
    """And its poses are null."""
    _, output, _ = ledpi(kept / "deep" / "two")
    (marker,) = lines(output)[0]["markers"]
    assert (marker["id"], marker["position_m"], marker["quaternion_wxyz"]) == (23, None, None)


def test_a_recordings_own_values_win(ledpi: Run, kept: Path, tmp_path: Path) -> None:
    """Whatever the configuration's file says of the panel's size and frequencies."""
    config = tmp_path / "mine.yaml"
    config.write_text("panels: {side_m: 5, black_hz: 900}\n")
    _, output, _ = ledpi("--config", config, kept / "one")
    np.testing.assert_allclose(lines(output)[0]["markers"][0]["position_m"], [0, 0, 1], atol=0.01)


@pytest.mark.parametrize("override", ["panels.side_m=0.32", "panels={side_m: 0.32}"])
def test_what_the_command_line_gives_is_stronger_than_a_recording(ledpi: Run, kept: Path, override: str) -> None:
    """A panel that was measured again and is twice as large is twice as far away."""
    _, output, _ = ledpi("--set", override, kept / "one")
    np.testing.assert_allclose(lines(output)[0]["markers"][0]["position_m"], [0, 0, 2], atol=0.02)


def test_another_lens_on_the_command_line_is_used_for_a_recording(ledpi: Run, kept: Path, tmp_path: Path) -> None:
    """Here of twice the focal length, once it is known that nothing moves; and null takes the lens away."""
    write_lens(tmp_path / "tele.yaml", 640, 480, focal=2.0)
    _, output, _ = ledpi("--set", f"camera.intrinsics={tmp_path / 'tele.yaml'}", kept / "one")
    assert lines(output)[1]["markers"][0]["position_m"][2] == pytest.approx(2.0, rel=0.05)
    _, output, _ = ledpi("--set", "camera.intrinsics=null", kept / "one")
    assert lines(output)[0]["markers"][0]["position_m"] is None


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("camera.width=320", "--set camera.width=320: "),
        ("camera.frame_duration_us=20000", "--set camera.frame_duration_us=20000.0: "),
        ("panels.phase=antiphase", "antiphase is for both classes at one frequency"),
    ],
)
def test_what_a_recording_cannot_be_made_to_have_is_refused(
    ledpi: Run, kept: Path, override: str, message: str
) -> None:
    """Its pictures' size and times; frequencies that contradict its own."""
    assert message in complaint(ledpi("--set", override, kept / "one"))


def test_pictures_are_decoded_with_the_configurations_values(ledpi: Run, kept: Path, tmp_path: Path) -> None:
    """Panel, exposure and row time are from config.yaml; the picture's path is its name."""
    config = tmp_path / "pictures.yaml"
    config.write_text("camera: {row_time_us: 33.67, exposure_us: 9966.32}\npanels: {side_m: 0.16}\n")
    pictures = [kept / "one/frames/000000.png", kept / "deep/two/frames/000001.png"]
    status, output, errors = ledpi("--config", config, *pictures)
    assert (status, errors) == (0, "")
    frames = lines(output)
    assert [frame["recording"] for frame in frames] == [str(picture) for picture in pictures]
    assert [frame["markers"][0]["id"] for frame in frames] == [7, 23]
    assert frames[0]["markers"][0]["position_m"] is None


def test_pictures_use_the_configured_lens(ledpi: Run, kept: Path, tmp_path: Path) -> None:
    """A camera.yaml beside the configuration, by a relative path."""
    write_lens(tmp_path / "camera.yaml", 640, 480)
    config = tmp_path / "pictures.yaml"
    config.write_text(
        "camera: {row_time_us: 33.67, exposure_us: 9966.32, intrinsics: camera.yaml}\npanels: {side_m: 0.16}\n"
    )
    _, output, _ = ledpi("--config", config, kept / "one/frames/000000.png")
    np.testing.assert_allclose(lines(output)[0]["markers"][0]["position_m"], [0, 0, 1], atol=0.05)


def test_a_misreported_row_time_is_corrected_and_told(ledpi: Run, take: Path) -> None:
    """The driver says 35.69 µs and 10.56 ms, 6 % too much; the frames' intervals know better."""
    header, frames = take / "recording.yaml", take / "frames.jsonl"
    header.write_text(header.read_text().replace("33.67", "35.69").replace("9966.32", "10564.3"))
    frames.write_text(frames.read_text().replace("9966.32", "10564.3"))
    status, output, said = ledpi("--single-frame", take)
    assert status == 0
    assert [[marker["id"] for marker in frame["markers"]] for frame in lines(output)] == [[7]] * FRAMES
    assert "a row takes 33.67 µs, not 35.69 µs as reported" in said


@pytest.mark.slow
def test_a_broken_picture_is_named_and_the_others_are_decoded(take: Path) -> None:
    """As a command of its own: its line says why there is nothing, standard error names the file, status 2."""
    picture = take / "frames" / "000001.png"
    picture.write_bytes(picture.read_bytes()[:5000])
    done = process(take)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert str(picture) in line
    assert "ends after 5000 bytes" in line
    frames = lines(done.stdout)
    assert [[marker["id"] for marker in frame["markers"]] for frame in frames] == [[7], [], [7], [7]]
    assert frames[1]["rejected"] == {"capture.truncated": 1}


@pytest.mark.slow
def test_progress_is_shown_on_a_terminal_only(kept: Path) -> None:
    """On standard error, where that is a terminal; standard output stays JSON."""
    master, slave = os.openpty()
    try:
        done = own_process("decode", kept / "one", capture_output=False, stdout=subprocess.PIPE, stderr=slave)
        os.set_blocking(master, False)
        shown = os.read(master, 100_000).decode(errors="ignore")  # a long one is cut somewhere
    finally:
        os.close(slave)
        os.close(master)
    assert done.returncode == 0
    assert len(lines(done.stdout)) == FRAMES
    assert "decoding" in shown


@pytest.mark.slow
def test_who_reads_only_the_first_line_sees_no_traceback(kept: Path) -> None:
    """`ledpi decode … | head -1`."""
    with subprocess.Popen(
        [*COMMAND, str(kept), str(kept), str(kept)], cwd=ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    ) as running:
        assert running.stdout is not None
        assert running.stderr is not None
        assert json.loads(running.stdout.readline())["seq"] == 0
        running.stdout.close()
        assert "Traceback" not in running.stderr.read()


# ---- What is wrong


def write_lens(path: Path, width: int, height: int, *, focal: float = 1.0) -> None:
    """`focal`: times that of the camera."""
    lens = ov5647_lens(width, height)
    matrix = ", ".join(str(float(v)) for v in (lens.matrix() * [[focal, 1, 1], [1, focal, 1], [1, 1, 1]]).ravel())
    path.write_text(
        f"image_width: {width}\nimage_height: {height}\ncamera_matrix: {{data: [{matrix}]}}\n"
        f"distortion_coefficients: {{data: {list(lens.distortion)}}}\n"
    )


def test_a_broken_recording_among_whole_ones_is_reported_before_anything_is_printed(
    ledpi: Run, kept: Path, take: Path
) -> None:
    """So that no half of an experiment is taken for the whole."""
    (take / "frames.jsonl").write_text("")
    assert "frames.jsonl: is empty" in complaint(ledpi(kept, take))


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("nowhere", "nowhere: no such file or folder"),
        ("/dev/null", "/dev/null: is a pipe, a device or the like; must be a picture or a folder"),
        ("empty", "empty: holds no recording"),
        ("notes.txt", "notes.txt: is no picture"),
    ],
)
def test_what_is_no_input_is_named(ledpi: Run, tmp_path: Path, name: str, message: str) -> None:
    """A path that leads nowhere, a folder without recordings, a file of another kind."""
    (tmp_path / "empty").mkdir()
    (tmp_path / "notes.txt").write_text("three panels")
    assert message in complaint(ledpi(tmp_path / name))


def test_recordings_of_one_name_are_distinguished_by_their_paths(ledpi: Run, kept: Path, take: Path) -> None:
    """One whose name no other has keeps it."""
    own = take.rename(take.with_name("one"))
    _, output, _ = ledpi(kept / "one", own, kept / "deep" / "two")
    assert {line["recording"] for line in lines(output)} == {str(kept / "one"), str(own), "two"}


def test_recordings_of_one_name_are_not_drawn_over_each_other(ledpi: Run, kept: Path, take: Path) -> None:
    """Each has a folder of its name below --steps; two of one name would share it in silence."""
    take = take.rename(take.with_name("one"))
    assert "--steps: two recordings are called one" in complaint(ledpi(kept / "one", take, "--steps", take / "steps"))
    assert not (take / "steps").exists()


def test_as_live_needs_a_recording_that_was_decoded_live(ledpi: Run, take: Path) -> None:
    """`ledpi simulate` decodes nothing: an empty answer would look like a recording without panels."""
    assert "--as-live: does not say which frames were decoded live" in complaint(ledpi("--as-live", take))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "does not say how large its panels are: --set panels.side_m=METRES"),
        (["--set", "panels.side_m=0.16"], "a picture file has no row time: add --set camera.row_time_us=33.67"),
    ],
)
def test_pictures_need_what_they_do_not_say(ledpi: Run, take: Path, arguments: list[str], message: str) -> None:
    """The panel's size, and the time from row to row."""
    assert message in complaint(ledpi(*arguments, take / "frames/000000.png"))


def broken_pictures(folder: Path, whole: bytes) -> dict[str, str]:
    """Pictures that cannot be used, and what is said of each."""
    (folder / "empty.png").write_bytes(b"")
    (folder / "cut.png").write_bytes(whole[: len(whole) // 2])
    (folder / "text.png").write_text("not a picture")
    cv2.imwrite(str(folder / "small.png"), np.zeros((48, 64), np.uint8))
    return {
        "empty.png": "cannot be read",
        "cut.png": "bytes, inside chunk IDAT",
        "text.png": "cannot be read",
        "small.png": "is 64 × 48; must be 640 × 480",
    }


@pytest.mark.parametrize("name", ["empty.png", "cut.png", "text.png", "small.png"])
def test_a_picture_that_cannot_be_used_is_named_and_the_others_are_decoded(
    ledpi: Run, take: Path, tmp_path: Path, name: str
) -> None:
    """Its line has no markers; never is half a picture taken for a whole one. Status 2."""
    good = take / "frames/000000.png"
    message = broken_pictures(tmp_path, good.read_bytes())[name]
    values = ("--set", "panels.side_m=0.16", "--set", "camera.row_time_us=33.67", "--set", "camera.exposure_us=9966.32")
    status, output, errors = ledpi(*values, tmp_path / name, good)
    assert status == 2
    (line,) = errors.splitlines()
    assert str(tmp_path / name) in line
    assert message in line
    bad, decoded = lines(output)
    assert (bad["markers"], sum(bad["rejected"].values())) == ([], 1)
    assert decoded["markers"][0]["id"] == 7


@pytest.mark.slow
def test_what_opencv_says_of_a_picture_is_not_shown(take: Path, tmp_path: Path) -> None:
    """It has lines of its own for half a bitmap."""
    whole = cv2.imencode(".bmp", cv2.imread(str(take / "frames/000000.png"), cv2.IMREAD_GRAYSCALE))[1].tobytes()
    (tmp_path / "cut.bmp").write_bytes(whole[: len(whole) // 2])
    done = process("--set", "panels.side_m=0.16", "--set", "camera.row_time_us=33.67", tmp_path / "cut.bmp")
    assert done.returncode == 2
    assert done.stderr == f"ledpi: {tmp_path}/cut.bmp: cannot be read as a picture of 8 or 16 bits; must be 640 × 480\n"


@pytest.mark.parametrize(
    ("width", "text", "message"),
    [
        (640, "image_width: 640\n", "camera.yaml: must hold a lens"),
        (640, None, "camera.yaml: cannot be read"),
        (320, "", "camera.yaml: was made for pictures of 320 × 240 pixels"),
    ],
)
def test_a_lens_that_cannot_be_used_is_named(
    ledpi: Run, take: Path, tmp_path: Path, width: int, text: str | None, message: str
) -> None:
    """Broken, missing, or calibrated at another picture size: no pose is better than a wrong one."""
    if text is not None:
        write_lens(tmp_path / "camera.yaml", width, width * 3 // 4)
    if text:
        (tmp_path / "camera.yaml").write_text(text)
    values = ("--set", "panels.side_m=0.16", "--set", "camera.row_time_us=33.67")
    lens = ("--set", f"camera.intrinsics={tmp_path / 'camera.yaml'}")
    assert message in complaint(ledpi(*values, *lens, take / "frames/000000.png"))


def test_antiphase_is_nothing_for_the_papers_method(ledpi: Run, kept: Path, take: Path) -> None:
    """A recording of such panels is named before anything of another is printed."""
    header = (take / "recording.yaml").read_text()
    (take / "recording.yaml").write_text(header.replace("black_hz: 1250.0", "phase: antiphase\n  black_hz: 2450.0"))
    line = complaint(ledpi("--method", "uemura", kept / "one", take))
    assert line.startswith(f"ledpi: {take}: decode.method: uemura distinguishes classes by the height of their bands")
    assert line.endswith("they are alike; must be likelihood")


@pytest.mark.slow
@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_behind_the_output_is_one_line(kept: Path) -> None:
    """`ledpi decode take > file` where nothing more fits, as /dev/full plays it."""
    with open("/dev/full", "w", encoding="utf-8") as full:
        done = subprocess.run([*COMMAND, str(kept / "one")], cwd=ROOT, stdout=full, stderr=subprocess.PIPE, text=True)
    said = "ledpi: standard output: the disk is full; make room on it, or write to another one\n"
    assert (done.returncode, done.stderr) == (1, said)


@pytest.mark.slow
@pytest.mark.skipif(
    sys.version_info >= (3, 13), reason="Python 3.13 itself cannot import numpy in a folder that is gone"
)
def test_a_working_directory_that_is_gone_is_one_line(tmp_path: Path) -> None:
    """As of a shell in a folder that somebody has removed."""
    (tmp_path / "gone").mkdir()
    command = [*COMMAND, ".", "--set", "camera.intrinsics=camera.yaml"]
    gone = [sys.executable, "-c", f"import os; os.rmdir(os.getcwd()); os.execv({command[0]!r}, {command!r})"]
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(gone, cwd=tmp_path / "gone", env=environment, capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (2, "ledpi: the working directory: No such file or directory\n")


def test_a_name_with_a_line_break_is_one_line(ledpi: Run) -> None:
    """The break is shown as it would be typed."""
    assert complaint(ledpi("a\nb")) == "ledpi: a\\nb: no such file or folder"


# ---- Pictures that say what they are


@pytest.fixture
def telling(kept: Path, tmp_path: Path) -> Path:
    """A picture of panel 7, 8 cm and not 16: so it hangs at half the distance; with its own lens and row time."""
    recording = load_recording(kept / "one")
    lens = asdict(recording.camera.intrinsics)
    names = ("width", "height", "row_time_us", "exposure_us", "frame_length_rows", "transfer")
    camera = {name: getattr(recording.camera, name) for name in names} | lens
    told = {"camera": camera, "panels": {"side_m": 0.16, "overrides": {"7": {"side_m": 0.08}}, "ids": [7]}}
    path = tmp_path / "frame.png"
    path.write_bytes(with_text(recording.frames[0].picture.read_bytes(), told))
    return path


def test_a_picture_that_says_so_needs_no_configuration(telling: Path, ledpi: Run) -> None:
    """Row time, exposure, lens and panels are its own."""
    status, output, errors = ledpi(telling)
    assert status == 0, errors
    (marker,) = json.loads(output)["markers"]
    assert marker["id"] == 7
    assert marker["position_m"][2] == pytest.approx(0.5, rel=0.02)


def test_set_overrides_what_a_picture_says(telling: Path, ledpi: Run) -> None:
    """As it does for a recording."""
    _, output, _ = ledpi(telling, "--set", "panels.overrides.7.side_m=0.32")
    (marker,) = json.loads(output)["markers"]
    assert marker["position_m"][2] == pytest.approx(2.0, rel=0.02)


def test_what_a_picture_says_and_cannot_be_is_named(telling: Path, ledpi: Run) -> None:
    """With the file."""
    telling.write_bytes(with_text(telling.read_bytes(), {"camera": {"width": "wide"}}))
    assert f"{telling}: what it says of its camera and panels cannot be used" in complaint(ledpi(telling))
