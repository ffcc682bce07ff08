"""What was kept, as a recording: decoded again it gives what it gave live, to the last bit."""

from __future__ import annotations

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ledpi.cli.decode import _blaming_state
from ledpi.core.errors import RecordingError
from ledpi.core.records import Decoded, PanelSpec
from ledpi.pipeline.state_file import STATE_FILE, resume_from
from ledpi.recording.picture import read_picture
from ledpi.recording.reader import load_recording
from ledpi.runtime import takes
from ledpi.runtime.recorder import LIVE_FILE
from ledpi.runtime.rewind_ring import RewindRing
from ledpi.runtime.rewind_writer import MAX_WAITING, RewindWriter
from ledpi.runtime.takes import MAX_AUTOMATIC, Shown
from tests.builders import ROOT
from tests.builders.rewind import DRIVE, EVERY, Stream, as_lines, decoded_live, exactly, stream, without_times

COMMAND = [sys.executable, "-c", "from ledpi.cli import main; main()"]
SPEC = PanelSpec(side_m=0.16, black_hz=1250.0, white_hz=2450.0)
COUNT, FIRST = 2 * EVERY + 1, EVERY
PATIENCE_S = 120.0


@pytest.fixture(scope="module")
def drive() -> Stream:
    return stream(COUNT)


def ring_with(drive: Stream, decoded: list[Decoded], budgets: list[int]) -> RewindRing:
    """All from FIRST on, the state before it included."""
    ring = RewindRing(*DRIVE, 35.0, 10.0, 300_000_000)
    ring.begin(drive.states[FIRST])
    for frame, result, budget in zip(drive.frames[FIRST:], decoded, budgets, strict=True):
        ring.keep(frame, result, budget, lambda: drive.states[FIRST])
    return ring


def writer_of(ring: RewindRing, folder: Path, drive: Stream) -> RewindWriter:
    shown = Shown(camera=drive.camera, dictionary="DICT_4X4_50", panel=SPEC, source="simulated")
    writer = RewindWriter(ring, folder, shown)
    writer.start()
    return writer


def saved(drive: Stream, folder: Path, budgets: list[int] | None = None) -> tuple[Path, list[Decoded]]:
    """A recording of the stream from FIRST on, and what was decoded live, with other budgets for each frame."""
    pipeline = drive.pipeline()
    pipeline.resume(drive.states[FIRST])
    budgets = budgets or [150_000] * (len(drive.frames) - FIRST)
    live = []
    for frame, budget in zip(drive.frames[FIRST:], budgets, strict=True):
        pipeline.likelihood.search_budget = budget
        live.append(pipeline.decode(frame))
    ring = ring_with(drive, live, budgets)
    writer = writer_of(ring, folder, drive)
    try:
        return writer.write("asked", ring.take()).result(PATIENCE_S), live
    finally:
        writer.close()


def decode(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    command = [*COMMAND, "decode", *map(str, arguments)]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=PATIENCE_S)


def lines_of(text: str) -> list[dict[str, object]]:
    return without_times([json.loads(line) for line in text.splitlines()])


def test_it_decodes_to_the_last_bit(drive: Stream, tmp_path: Path) -> None:
    """From the first frame on, with the pictures and the state that were written."""
    folder, live = saved(drive, tmp_path)
    recording = load_recording(folder)
    pipeline = drive.pipeline()
    assert resume_from(folder, pipeline)
    again = []
    for entry in recording.frames:
        picture = np.empty(DRIVE, np.uint8)
        assert read_picture(entry.picture, picture) is None
        again.append(exactly(pipeline.decode(recording.frame(entry, picture))))
    assert again == [exactly(decoded) for decoded in live]
    assert live[0].markers  # and the first of them shows a panel already


def test_decode_as_live_says_what_live_did(drive: Stream, tmp_path: Path) -> None:
    """The command's lines are those of live.jsonl, where each frame had a budget of its own."""
    budgets = [[25_000, 1_000_000, 60_000][k % 3] for k in range(COUNT - FIRST)]
    folder, live = saved(drive, tmp_path, budgets)
    done = decode("--as-live", folder)
    assert done.returncode == 0, done.stderr
    assert lines_of(done.stdout) == as_lines(live)
    assert lines_of((folder / LIVE_FILE).read_text()) == as_lines(live)
    (folder / STATE_FILE).unlink()
    assert lines_of(decode("--as-live", folder).stdout) != as_lines(live)  # it does matter


def test_a_driver_that_misreports_its_rows_is_seen_through_as_it_was_live(tmp_path: Path) -> None:
    """Live the stream found out by its own times; so it must when it is decoded as live, and not twice."""
    true = stream(COUNT)
    report = 0.94
    frames = [
        replace(frame, row_time_us=frame.row_time_us * report, exposure_us=frame.exposure_us * report)
        for frame in true.frames
    ]
    info = replace(
        true.camera, row_time_us=true.camera.row_time_us * report, exposure_us=true.camera.exposure_us * report
    )
    drive = decoded_live(true.config, info, frames)
    assert drive.states[FIRST].clock.ratio == pytest.approx(1 / report, rel=1e-3)
    folder, live = saved(drive, tmp_path)
    assert lines_of(decode("--as-live", folder).stdout) == as_lines(live)


def test_a_wrong_state_is_one_line(drive: Stream, tmp_path: Path) -> None:
    """Exit status 2, the file, what is wrong; nothing is decoded."""
    folder, _ = saved(drive, tmp_path)
    (folder / STATE_FILE).write_bytes(b"\x80\x04\x95")
    done = decode("--as-live", folder)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"ledpi: {folder / STATE_FILE}: begins with no line of JSON; must be as ledpi writes it\n"
    assert decode(folder).returncode == 0  # it is a recording all the same


def test_a_state_that_brings_a_frame_down_is_one_line(tmp_path: Path) -> None:
    """Well-formed, but none that a pipeline was ever in: whatever comes of it is told as the file's fault."""
    with (
        pytest.raises(RecordingError, match=r"state.bin: frame 7 cannot be decoded after what it says \(LinAlgError\)"),
        _blaming_state(tmp_path, 7),
    ):
        np.linalg.inv(np.zeros((2, 2)))


def test_a_recording_that_is_cut_off_is_one(drive: Stream, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The daemon ends meanwhile: the name says that it is a part, and that part decodes as it did live."""
    ring = ring_with(drive, drive.live[FIRST:], [150_000] * (COUNT - FIRST))
    writer = writer_of(ring, tmp_path, drive)
    give_back, given = ring.give_back, []

    def count(kept: object) -> None:
        given.append(kept)
        if len(given) == 12:
            writer._stop.set()

    monkeypatch.setattr(ring, "give_back", lambda kept: (count(kept), give_back(kept)))
    with pytest.raises(RecordingError, match=r"\.part: cut off after 12 of 16 frames: the daemon ends"):
        writer.write("asked", ring.take()).result(PATIENCE_S)
    writer.close()
    (part,) = tmp_path.iterdir()
    assert part.name.endswith("-asked.part")
    assert lines_of(decode("--as-live", part).stdout) == as_lines(drive.live[FIRST : FIRST + 12])
    assert len(given) == COUNT - FIRST  # every room is free again


def test_a_disk_that_is_too_full_is_reported(drive: Stream, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Before anything is written, as a disk that ledpi has filled stops more than ledpi; the rooms are free again."""
    monkeypatch.setattr(takes, "MIN_FREE_BYTES", 10**18)
    ring = ring_with(drive, drive.live[FIRST:], [150_000] * (COUNT - FIRST))
    before = ring.room
    writer = writer_of(ring, tmp_path / "takes", drive)
    with pytest.raises(RecordingError, match=r"the disk has \d+ MB left; \d+ MB are needed"):
        writer.write("asked", ring.take()).result(PATIENCE_S)
    writer.close()
    assert list((tmp_path / "takes").iterdir()) == []
    assert ring.room == before + COUNT - FIRST


def test_those_that_nobody_asked_for_do_not_pile_up(drive: Stream, tmp_path: Path) -> None:
    """The newest stay, whole or not; those that somebody asked for stay, and so does what is no recording."""
    old = [f"2026010{day}T000000Z-camera_lost" for day in range(1, 8)]
    kept = ["20250101T000000Z-asked", "20250101T000000Z-camera_lost-mine", "notes"]
    for name in (*old, *kept, "20260101T000000Z-contradicted-2.part"):
        (tmp_path / name).mkdir()
    ring = ring_with(drive, drive.live[FIRST:], [150_000] * (COUNT - FIRST))
    writer = writer_of(ring, tmp_path, drive)
    path = writer.write("camera_lost", ring.take()).result(PATIENCE_S)
    writer.close()
    assert {p.name for p in tmp_path.iterdir()} == {*old[-MAX_AUTOMATIC + 1 :], *kept, path.name}


def test_two_in_one_second_have_names_of_their_own(drive: Stream, tmp_path: Path) -> None:
    """Neither is written over the other."""
    ring = ring_with(drive, drive.live[FIRST:], [150_000] * (COUNT - FIRST))
    writer = writer_of(ring, tmp_path, drive)
    kept = ring.take()
    half = len(kept) // 2
    with_state = [kept[half]._replace(state=drive.states[FIRST]), *kept[half + 1 :]]
    paths = {writer.write("asked", part).result(PATIENCE_S) for part in (kept[:half], with_state)}
    writer.close()
    assert set(tmp_path.iterdir()) == paths
    assert len(paths) == 2


def test_more_than_it_can_write_is_refused(drive: Stream, tmp_path: Path) -> None:
    """Each waits with its pictures' rooms; so only some may, and the rooms of what is refused are free again."""
    ring = ring_with(drive, drive.live[FIRST:], [150_000] * (COUNT - FIRST))
    shown = Shown(camera=drive.camera, dictionary="DICT_4X4_50", panel=SPEC, source="simulated")
    writer = RewindWriter(ring, tmp_path, shown)  # it is not started, and writes nothing
    for _ in range(MAX_WAITING):
        writer.write("asked", [])
    kept, before = ring.take(), ring.room
    with pytest.raises(RecordingError, match="others are still being written"):
        writer.write("asked", kept)
    assert ring.room == before + len(kept)
