"""`record` of the tap: from now on, what a real daemon decodes is written as a recording."""

from __future__ import annotations

import json
import signal
import subprocess
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import pytest

from ledpi.camera.recording.reader import load_recording
from ledpi.core.errors import DiskFullError, RecordingError, TapError
from ledpi.daemon import takes as takes_module
from ledpi.daemon.rewind import TapRecorder
from ledpi.daemon.takes import LIVE_FILE, RECORDED, takes_folder
from ledpi.daemon.tap.client import connect
from ledpi.daemon.tap.protocol import Request
from tests.builders.command import ledpi
from tests.builders.daemon import SIMULATED, SIMULATED_YAML, daemon, end
from tests.builders.rewind import differences_once_settled, stream, without_exposures, without_times
from tests.builders.tap import at, reach
from tests.builders.waiting import limit_s, wait_until

OFF = "rewind.seconds=0"
NO_ROOM = r"the disk has \d+ MB left; \d+ MB are needed: make room on it"


def decoded_again(take: Path) -> list[dict[str, Any]]:
    """By `ledpi decode --as-live`."""
    done = ledpi("decode", "--as-live", take)
    assert done.returncode == 0, done.stderr
    return without_times([json.loads(line) for line in done.stdout.splitlines()])


def live(take: Path) -> list[dict[str, Any]]:
    return without_times([json.loads(line) for line in (take / LIVE_FILE).read_text().splitlines()])


def recorded(takes: Path) -> list[Path]:
    """Lists them; where the machine is so busy that no frame comes, a fault has its own."""
    return sorted(takes.glob("*-recorded*"))


Lines = Iterator[dict[str, Any]]


def until(lines: Lines, kind: str, request_id: int | None = None) -> tuple[dict[str, Any], list[dict[str, Any]]]:
    """The next line of that kind (the answer to that request), and the frames until then."""
    frames = []
    for line in lines:
        if line["type"] == kind and (request_id is None or line["id"] == request_id):
            return line, frames
        assert line["type"] != "error", line
        frames += [line] if line["type"] == "decoded" else []
    raise AssertionError("the daemon has ended")


def some_frames(lines: Lines, count: int) -> None:
    for _ in range(count):
        until(lines, "decoded")


@pytest.mark.slow
@pytest.mark.alone  # where others take the processor, live searches less than is needed to find a panel
def test_two_seconds_are_recorded_as_the_tap_told_them(takes: Path, tmp_path: Path) -> None:
    """Each frame, from the first on; with the last seconds kept beside."""
    path = tmp_path / "tap.sock"
    with daemon(*SIMULATED, at(path)), reach(path) as client:
        lines = client.lines()
        hello = next(lines)
        some_frames(lines, 40)
        answer, frames = until(lines, "done", client.send("record", seconds=2))
    take = Path(answer["path"])
    assert hello["may"] == ["save", "record"]
    assert recorded(takes) == [take]
    assert take.name.endswith("-recorded")
    assert answer["dropped"] == 0
    again = decoded_again(take)
    assert [line["seq"] for line in again] == [line["seq"] for line in live(take)]
    assert len(again) == answer["frames"] == len(load_recording(take).frames)
    assert live(take)[0]["markers"]  # in its very first frame, as they were followed
    told = {line["seq"]: without_exposures(line) for line in frames}
    common = [line for line in live(take) if line["seq"] in told]
    assert len(common) > 5
    for line in common:
        seen = [{key: marker[key] for key in marker if key != "exposed_ns"} for marker in told[line["seq"]]["markers"]]
        assert {key: told[line["seq"]][key] for key in line} | {"markers": seen} == line  # the tap tells times, too
    assert differences_once_settled(live(take), again) == []


def test_record_stop_ends_it_and_a_second_one_is_refused(takes: Path, tmp_path: Path) -> None:
    """Any client may stop it, and both hear where it is; then another one may begin."""
    path = tmp_path / "tap.sock"
    with daemon(*SIMULATED, at(path), OFF), reach(path) as client, connect(path) as other:
        lines = client.lines()
        with pytest.raises(TapError, match="record_stop: nothing is being recorded"):
            other.ask("record_stop")
        begun = client.send("record", seconds=600)
        some_frames(lines, 30)
        with pytest.raises(TapError, match="record: a recording runs already; record_stop ends it"):
            other.ask("record", seconds=1)
        stopped = other.ask("record_stop")
        answer, _ = until(lines, "done", begun)
        begun_again = client.send("record", seconds=600)
        some_frames(lines, 5)
        other.ask("record_stop")
        again, _ = until(lines, "done", begun_again)
    assert {key: stopped[key] for key in ("path", "frames", "dropped")} == {
        key: answer[key] for key in ("path", "frames", "dropped")
    }
    assert recorded(takes) == sorted([Path(answer["path"]), Path(again["path"])])
    assert answer["frames"] > 5


@pytest.mark.slow
def test_a_take_is_read_and_deleted_through_the_tap(takes: Path, tmp_path: Path) -> None:
    """Piece by piece as a tar file, which is the take; while it is being recorded neither is possible."""
    path = tmp_path / "tap.sock"
    with daemon(*SIMULATED, at(path), OFF), reach(path) as client, connect(path) as other:
        lines = client.lines()
        client.send("record", seconds=600)
        some_frames(lines, 20)
        wait_until(lambda: other.ask("takes")["takes"] != [])
        (running,) = other.ask("takes")["takes"]
        assert running["written"]
        for do in ("take", "take_delete"):
            with pytest.raises(TapError, match="is being written; ask again when it is complete"):
                other.ask(do, name=running["name"])
        name = Path(other.ask("record_stop")["path"]).name
        data, size = b"", 1
        while len(data) < size:
            piece = other.ask("take", name=name, offset=len(data))
            data, size = data + piece["raw"], piece["size"]
        (tmp_path / "take.tar").write_bytes(data)
        subprocess.run(["tar", "-xf", "take.tar"], cwd=tmp_path, check=True)
        assert live(tmp_path / name) == live(takes / name)
        assert len(load_recording(tmp_path / name).frames) == other.ask("takes")["takes"][0]["frames"]
        with pytest.raises(TapError, match="name: must be that of a take"):
            other.ask("take_delete", name="../../state")
        other.ask("take_delete", name=name)
        assert other.ask("takes")["takes"] == []
    assert recorded(takes) == []


@pytest.mark.slow
def test_the_daemons_end_makes_it_whole(takes: Path, tmp_path: Path) -> None:
    """Here another one begins, of a new configuration; who asked hears of it."""
    path, config = tmp_path / "tap.sock", tmp_path / "config.yaml"
    config.write_text("panels: {side_m: 0.16}\n" + SIMULATED_YAML, encoding="utf-8")
    with daemon(at(path), OFF, options=("--config", str(config))) as process, reach(path) as client:
        lines = client.lines()
        begun = client.send("record", seconds=600)
        some_frames(lines, 30)
        process.send_signal(signal.SIGHUP)
        answer, _ = until(lines, "done", begun)
        assert next(line for line in lines if line["type"] == "hello")["may"] == ["record"]
        some_frames(lines, 1)
        assert end(process, signal.SIGTERM).status == 0
    assert recorded(takes) == [Path(answer["path"])]
    assert len(live(Path(answer["path"]))) == answer["frames"] > 5
    assert len(decoded_again(Path(answer["path"]))) == answer["frames"]


def begun(recorder: TapRecorder, pool: ThreadPoolExecutor) -> Future[dict[str, Any]]:
    """It records in a thread of its own, as the tap has it."""
    running = pool.submit(recorder.record, Request(do="record", seconds=600.0))
    wait_until(lambda: any(RECORDED in each.name for each in takes_folder().glob("*")))
    return running


def test_a_disk_that_is_too_full_is_told(takes: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Before anything is written, and while it is: a disk that ledpi has filled stops more than ledpi."""
    drive = stream(8)
    recorder = TapRecorder(drive.shown)
    with ThreadPoolExecutor() as pool:
        running = begun(recorder, pool)
        for index, (frame, decoded) in enumerate(zip(drive.frames, drive.live, strict=True)):
            if index == 5:
                wait_until(lambda: len(list(takes.glob("*-recorded.part/frames/*.png"))) == 5)
                monkeypatch.setattr(takes_module, "MIN_FREE_BYTES", 10**18)
            recorder.keep(frame, decoded, 150_000)
        with pytest.raises(DiskFullError, match=rf"{NO_ROOM}; 5 frames are in /"):
            running.result(limit_s())
    with pytest.raises(DiskFullError, match=f"{NO_ROOM}$"):
        recorder.record(Request(do="record", seconds=600.0))
    (part,) = recorded(takes)
    assert len(load_recording(part).frames) == 5


def test_without_a_frame_nothing_is_written(takes: Path) -> None:
    """Who asked hears so, as does who stopped it. After the daemon's end none begins."""
    drive = stream(1)
    recorder = TapRecorder(drive.shown)
    with ThreadPoolExecutor() as pool:
        running = begun(recorder, pool)
        with pytest.raises(RecordingError, match="no frame was decoded meanwhile"):
            recorder.stop(Request(do="record_stop"))
        with pytest.raises(RecordingError, match="no frame was decoded meanwhile"):
            running.result(limit_s())
        recorder.close()
        with pytest.raises(RecordingError, match="the daemon ends"):
            recorder.record(Request(do="record", seconds=1.0))
    assert recorded(takes) == []
