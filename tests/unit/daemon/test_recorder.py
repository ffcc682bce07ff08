"""`ledpi record`: what is kept of a camera's frames, and that a replay gives what was decoded live."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ledpi.camera.base import Camera
from ledpi.camera.recording.reader import load_recording
from ledpi.camera.recording.writer import RecordingWriter
from ledpi.camera.recovering import LOST
from ledpi.cli.record import summary
from ledpi.config.settings import load_config
from ledpi.core.errors import RecordingError
from ledpi.core.records import CameraInfo, Decoded, Frame, PanelSpec, Pixels, Rejected
from ledpi.daemon.recorder import BEHIND, WAITING, Recorder
from ledpi.daemon.takes import LIVE_FILE, TakeWriter
from ledpi.pipeline.pipeline import Pipeline
from tests.builders import ROOT
from tests.builders.command import LEDPI, ledpi
from tests.builders.daemon import SIMULATED as SETTINGS
from tests.builders.waiting import limit_s, wait_until

INFO = CameraInfo(width=64, height=48, exposure_us=1e4, row_time_us=31.75, transfer="linear", frame_length_rows=504)
SPEC = PanelSpec(side_m=0.16, black_hz=1250.0, white_hz=2450.0)
SIMULATED = tuple(part for setting in SETTINGS for part in ("--set", setting))


class Steps:
    """A camera that gives what it is told, without a pace; a frame's pixels are its seq."""

    def __init__(self, *results: int | Rejected) -> None:
        self.info, self.panel = INFO, None
        self._results = iter(results)

    def read(self, into: Pixels) -> Frame | Rejected | None:
        result = next(self._results, None)
        if not isinstance(result, int):
            return result
        into[:] = result % 256
        values: dict[str, Any] = {"exposure_us": 1e4, "row_time_us": 31.75, "transfer": "linear"}
        return Frame(pixels=into.view(), seq=result, row0_readout_ns=result * 16_002_000, **values)

    def close(self) -> None:
        pass


class Slow(Pipeline):
    """A decoder that takes until it is let go on."""

    gate = threading.Event()

    def decode(self, frame: Frame, trace: object = None) -> Decoded:
        self.gate.wait(limit_s())
        return super().decode(frame)


@pytest.fixture
def gate() -> Iterator[threading.Event]:
    """The event that `Slow` waits for."""
    Slow.gate.clear()
    yield Slow.gate
    Slow.gate.set()


def recorder(folder: Path, camera: Camera, pipeline: type[Pipeline] = Pipeline) -> Recorder:
    panels = load_config(None, ("panels.side_m=0.16",)).panels
    writer = TakeWriter(folder, camera=INFO, dictionary="DICT_4X4_50", panel=SPEC)
    return Recorder(camera, writer, pipeline(INFO, panels, intrinsics=None))


def record(*arguments: str) -> subprocess.CompletedProcess[str]:
    return ledpi("record", *arguments)


def test_every_frame_is_kept_in_order(tmp_path: Path) -> None:
    """Each picture with its own line, however many encoders there are."""
    recorder(tmp_path / "take", Steps(*range(60))).run()
    recording = load_recording(tmp_path / "take")
    assert [entry.seq for entry in recording.frames] == list(range(60))
    import cv2

    assert [int(cv2.imread(str(entry.picture), 0)[0, 0]) for entry in recording.frames] == list(range(60))


def test_each_line_says_whether_the_frame_was_decoded(tmp_path: Path, gate: threading.Event) -> None:
    """The decoder has the first frame in hand while the others come: they are kept, and not decoded."""
    one = recorder(tmp_path / "take", Steps(*range(10)), Slow)
    threading.Timer(0.3, gate.set).start()
    one.run()
    decoded = [entry.decoded for entry in load_recording(tmp_path / "take").frames]
    assert decoded[0] is True
    assert decoded.count(True) == one.done.decoded
    live = [json.loads(line)["seq"] for line in (tmp_path / "take" / LIVE_FILE).read_text().splitlines()]
    assert live == [seq for seq, was in enumerate(decoded) if was]


def test_what_is_lost_is_counted(tmp_path: Path) -> None:
    """Frames that nobody fetched in time, and those that the camera found unfit, each by its name."""
    unfit = Rejected(stage="capture", reason="exposure")
    one = recorder(tmp_path / "take", Steps(0, 1, 5, unfit, 7))
    one.run()
    assert (one.done.written, one.done.missed, one.done.unfit, one.done.dropped) == (4, 3, 1, 0)
    assert summary(one.done).endswith("3 missed, as this machine was busy, 1 unfit")


def test_a_slow_disk_never_holds_the_camera_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Drops and counts what has no room; what has is written in order."""
    waiting, write = threading.Event(), RecordingWriter.write

    def slow(self: RecordingWriter, *arguments: Any, **options: Any) -> int:
        waiting.wait(limit_s())
        return write(self, *arguments, **options)

    class Ending(Steps):
        """Lets the disk go on when the last frame is captured."""

        def read(self, into: Pixels) -> Frame | Rejected | None:
            result = super().read(into)
            if result is None:
                waiting.set()
            return result

    monkeypatch.setattr(RecordingWriter, "write", slow)
    one = recorder(tmp_path / "take", Ending(*range(WAITING + 50)))
    one.run()
    assert one.done.dropped > 0
    assert one.done.written + one.done.dropped == WAITING + 50
    assert len(load_recording(tmp_path / "take").frames) == one.done.written


def test_where_frames_pile_up_none_is_decoded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The decoder leaves the processor to those that keep frames, and goes on when they have caught up."""
    blocked, write = threading.Event(), RecordingWriter.write

    def slow(self: RecordingWriter, *arguments: Any, **options: Any) -> int:
        blocked.wait(limit_s())
        return write(self, *arguments, **options)

    class Paced(Steps):
        """Leaves a decoder that is free the time for every frame; the disk goes on before the last."""

        def read(self, into: Pixels) -> Frame | Rejected | None:
            result = super().read(into)
            if isinstance(result, Frame) and result.seq == 2 * BEHIND:
                blocked.set()
                wait_until(lambda: one.done.written == 2 * BEHIND)
            time.sleep(0.01)
            return result

    monkeypatch.setattr(RecordingWriter, "write", slow)
    one = recorder(tmp_path / "take", Paced(*range(2 * BEHIND + 1)))
    one.run()
    decoded = [entry.decoded for entry in load_recording(tmp_path / "take").frames]
    assert decoded[0] is True
    assert decoded[BEHIND + 1 : -1] == [False] * (BEHIND - 1), "one frame is in the writer's hands"
    assert decoded[-1] is True


def test_a_full_disk_leaves_a_recording(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The error is told, the frames until then can be read, and nothing waits for ever."""
    write = Path.write_bytes

    def until_full(path: Path, data: bytes) -> int:
        if path.name == "000007.png":
            raise OSError(28, "No space left on device")
        return write(path, data)

    monkeypatch.setattr(Path, "write_bytes", until_full)
    one = recorder(tmp_path / "take", Steps(*range(500)))
    with pytest.raises(RecordingError, match=r"000007.png: cannot be written: the disk is full \("):
        one.run()
    assert [entry.seq for entry in load_recording(tmp_path / "take").frames] == list(range(7))


def test_a_bug_in_an_encoder_ends_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """With its error, also where many frames wait: nothing waits for ever for a writer that is gone."""
    may_fail = threading.Event()

    def broken(pixels: Pixels) -> bytes:
        may_fail.wait(limit_s())
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr("ledpi.daemon.recorder.encode_picture", broken)
    one = recorder(tmp_path / "take", Steps(*range(WAITING + 50)))
    threading.Timer(0.5, may_fail.set).start()
    ended: list[BaseException] = []

    def run() -> None:
        try:
            one.run()
        except ZeroDivisionError as error:
            ended.append(error)

    running = threading.Thread(target=run, daemon=True)
    running.start()
    running.join(limit_s())
    assert [str(error) for error in ended] == ["a bug"]


def test_a_camera_that_was_lost_meanwhile_is_reported(tmp_path: Path) -> None:
    """However many attempts it took to open it again; what it did not make meanwhile is not counted as missed."""
    one = recorder(tmp_path / "take", Steps(0, 1, LOST, LOST, LOST, 2, 3))
    one.run()
    assert (one.done.written, one.done.missed, one.done.unfit, one.done.lost) == (4, 0, 0, 1)
    assert summary(one.done).endswith("none lost; the camera was lost and opened again 1 time")


@pytest.mark.slow
def test_a_replay_decodes_as_live(tmp_path: Path) -> None:
    """The simulated drive, recorded and decoded live; `decode --as-live` gives the same lines, apart from times."""
    take = tmp_path / "take"
    done = record(str(take), "--seconds", "1.5", *SIMULATED)
    assert done.returncode == 0, done.stderr
    replay = ledpi("decode", "--as-live", take).stdout
    live = [json.loads(line) for line in (take / LIVE_FILE).read_text().splitlines()]
    again = [json.loads(line) for line in replay.splitlines()]
    for line in live + again:
        del line["decode_ms"]
    assert sum(len(line["markers"]) for line in live) > 0
    assert again == live
    assert {entry.search_budget is not None for entry in load_recording(take).frames if entry.decoded} == {True}


@pytest.mark.slow
def test_ctrl_c_ends_it_in_order(tmp_path: Path) -> None:
    """Writes what was captured, and the summary tells of it; exit status 0."""
    take = tmp_path / "take"
    command = [*LEDPI, "record", str(take), "--seconds", "600", *SIMULATED]
    with subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, text=True) as process:
        wait_until(lambda: (take / "frames").is_dir() and len(os.listdir(take / "frames")) >= 5)
        process.send_signal(signal.SIGINT)
        said = process.communicate(timeout=limit_s())[0]
        assert process.returncode == 0
    frames = load_recording(take).frames
    assert said.startswith(f"{take}: {len(frames)} frames, ")
    assert len(os.listdir(take / "frames")) == len(frames)


@pytest.mark.slow
def test_it_is_bounded_by_size(tmp_path: Path) -> None:
    """A megabyte is some 25 frames; it ends soon after, and long before its time."""
    done = record(str(tmp_path / "take"), "--seconds", "50", "--max-mb", "1", *SIMULATED)
    assert done.returncode == 0
    assert sum(path.stat().st_size for path in (tmp_path / "take/frames").iterdir()) >= 1e6


@pytest.mark.slow
def test_a_folder_that_holds_something_is_left_alone(tmp_path: Path) -> None:
    """Status 2, and the reason, and no word of a recording that there is none."""
    (tmp_path / "notes.txt").write_text("mine")
    done = record(str(tmp_path), *SIMULATED)
    assert (done.returncode, done.stdout) == (2, "")
    assert "is not empty" in done.stderr
    assert os.listdir(tmp_path) == ["notes.txt"]


@pytest.mark.slow
def test_an_undecoded_frame_is_left_out_as_live(tmp_path: Path) -> None:
    """By its line in frames.jsonl; without the option every frame is decoded."""
    panel = {"dictionary": "DICT_4X4_50", "panel": SPEC}
    with RecordingWriter(tmp_path / "take", camera=INFO, **panel) as writer:  # type: ignore[arg-type]
        for seq, decoded in enumerate((True, False, True)):
            frame = Steps(seq).read(np.zeros((48, 64), np.uint8))
            assert isinstance(frame, Frame)
            writer.write(frame, decoded=decoded)
    command = [*LEDPI, "decode", str(tmp_path / "take")]
    seqs = [
        [
            json.loads(line)["seq"]
            for line in subprocess.run(
                command + option, cwd=ROOT, capture_output=True, text=True, check=True
            ).stdout.splitlines()
        ]
        for option in ([], ["--as-live"])
    ]
    assert seqs == [[0, 1, 2], [0, 2]]
