"""The last seconds as a recording: decoded again it gives what it gave live, once its panels are found again."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from ledpi.cli.decode import OLD_STATE_FILE
from ledpi.core.errors import RecordingError
from ledpi.core.records import PanelSpec
from ledpi.runtime import takes
from ledpi.runtime.rewind_ring import RewindRing
from ledpi.runtime.rewind_writer import MAX_WAITING, RewindWriter
from ledpi.runtime.take_writer import LIVE_FILE
from ledpi.runtime.takes import MAX_AUTOMATIC, Shown
from tests.builders.command import ledpi
from tests.builders.rewind import (
    DRIVE,
    Stream,
    as_lines,
    decoded_live,
    differences_once_settled,
    stream,
    without_times,
)
from tests.builders.waiting import limit_s

SPEC = PanelSpec(side_m=0.16, black_hz=1250.0, white_hz=2450.0)
COUNT = 16


@pytest.fixture(scope="module")
def drive() -> Stream:
    return stream(COUNT)


def ring_with(drive: Stream, first: int = 0, budgets: Sequence[int] = ()) -> RewindRing:
    """All from the frame `first` on; with budgets, where each frame had one of its own."""
    ring = RewindRing(*DRIVE, 35.0, 10.0, 300_000_000)
    frames, live = drive.frames[first:], drive.live[first:]
    for frame, result, budget in zip(frames, live, budgets or [150_000] * len(frames), strict=True):
        ring.keep(frame, result, budget)
    return ring


def writer_of(ring: RewindRing, folder: Path, drive: Stream) -> RewindWriter:
    shown = Shown(camera=drive.camera, dictionary="DICT_4X4_50", panel=SPEC, source="simulated")
    writer = RewindWriter(ring, folder, shown)
    writer.start()
    return writer


def saved(drive: Stream, folder: Path, first: int = 0, budgets: Sequence[int] = ()) -> Path:
    """A recording of the stream from the frame `first` on."""
    ring = ring_with(drive, first, budgets)
    writer = writer_of(ring, folder, drive)
    try:
        return writer.write("asked", ring.take()).result(limit_s())
    finally:
        writer.close()


def decode(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    return ledpi("decode", *arguments)


def lines_of(text: str) -> list[dict[str, object]]:
    return without_times([json.loads(line) for line in text.splitlines()])


@pytest.mark.slow
def test_a_recording_from_the_daemons_start_decodes_as_it_did_live(drive: Stream, tmp_path: Path) -> None:
    """To the last bit, where each frame had a budget of its own: the command's lines are those of live.jsonl."""
    budgets = [[1, 1, 1_000_000][k % 3] for k in range(COUNT)]
    pipeline, live = drive.pipeline(), []
    for frame, budget in zip(drive.frames, budgets, strict=True):
        pipeline.likelihood.search_budget = budget
        live.append(pipeline.decode(frame))
    folder = saved(replace(drive, live=live), tmp_path, budgets=budgets)
    done = decode("--as-live", folder)
    assert (done.returncode, done.stderr) == (0, "")
    assert lines_of(done.stdout) == as_lines(live)
    assert lines_of((folder / LIVE_FILE).read_text()) == as_lines(live)
    assert lines_of(decode(folder).stdout) != as_lines(live)  # budgets matter


@pytest.mark.slow
def test_one_that_begins_later_decodes_as_it_did_live_after_a_second(tmp_path: Path) -> None:
    """By then its panels are found and read again; and its note says so."""
    drive = stream(96)
    folder = saved(drive, tmp_path, 30)
    live = as_lines(drive.live[30:])
    assert live[0]["markers"]
    again = lines_of(decode("--as-live", folder).stdout)
    assert differences_once_settled(live, again) == []
    assert "first second" in load_note(folder)


def test_only_the_daemons_own_user_may_read_it(drive: Stream, tmp_path: Path) -> None:
    """Whoever may not use the tap gets no picture from the folder either."""
    saved(drive, tmp_path / "takes")
    assert (tmp_path / "takes").stat().st_mode & 0o077 == 0


def load_note(folder: Path) -> str:
    return str(yaml.safe_load((folder / "recording.yaml").read_text())["note"])


@pytest.mark.slow
def test_a_state_that_an_older_version_wrote_is_not_read(drive: Stream, tmp_path: Path) -> None:
    """Whatever it holds: that is said once, in one line, and the recording is decoded."""
    folder = saved(drive, tmp_path)
    plain = decode("--as-live", folder)
    with (folder / OLD_STATE_FILE).open("wb") as state:
        state.write(b"\x80\x04\x95")
        state.truncate(10 * 2**30)  # without taking room on the disk
    done = decode("--as-live", folder)
    assert done.returncode == 0
    assert lines_of(done.stdout) == lines_of(plain.stdout)
    assert done.stderr == f"ledpi: {folder}: state.bin is not read; the first second may differ from what was live\n"


@pytest.mark.slow
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
    folder = saved(drive, tmp_path)
    assert lines_of(decode("--as-live", folder).stdout) == as_lines(drive.live)
    assert any(decoded.markers for decoded in drive.live)


@pytest.mark.slow
def test_a_recording_that_is_cut_off_is_one(drive: Stream, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The daemon ends meanwhile: the name says that it is a part, and that part decodes as it did live."""
    ring = ring_with(drive)
    writer = writer_of(ring, tmp_path, drive)
    give_back, given = ring.give_back, []

    def count(kept: object) -> None:
        given.append(kept)
        if len(given) == 12:
            writer._stop.set()

    monkeypatch.setattr(ring, "give_back", lambda kept: (count(kept), give_back(kept)))
    with pytest.raises(
        RecordingError, match=r"the daemon ends, and 4 frames more are not written; 12 frames are in .*\.part"
    ):
        writer.write("asked", ring.take()).result(limit_s())
    writer.close()
    (part,) = tmp_path.glob("2*")
    assert part.name.endswith("-asked.part")
    assert lines_of(decode("--as-live", part).stdout) == as_lines(drive.live[:12])
    assert len(given) == COUNT  # every room is free again


def test_a_disk_that_is_too_full_is_reported(drive: Stream, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Before anything is written, as a disk that ledpi has filled stops more than ledpi; the rooms are free again."""
    monkeypatch.setattr(takes, "MIN_FREE_BYTES", 10**18)
    ring = ring_with(drive)
    before = ring.room
    writer = writer_of(ring, tmp_path / "takes", drive)
    with pytest.raises(RecordingError, match=r"the disk has \d+ MB left; \d+ MB are needed"):
        writer.write("asked", ring.take()).result(limit_s())
    writer.close()
    assert list((tmp_path / "takes").iterdir()) == []
    assert ring.room == before + COUNT


def test_those_that_nobody_asked_for_do_not_pile_up(drive: Stream, tmp_path: Path) -> None:
    """The newest stay, whole or not; those that somebody asked for stay, and so does what is no recording."""
    old = [f"2026010{day}T000000Z-camera_lost" for day in range(1, 8)]
    kept = ["20250101T000000Z-asked", "20250101T000000Z-camera_lost-mine", "notes"]
    for name in (*old, *kept, "20260101T000000Z-contradicted-2.part"):
        (tmp_path / name).mkdir()
    ring = ring_with(drive)
    writer = writer_of(ring, tmp_path, drive)
    path = writer.write("camera_lost", ring.take()).result(limit_s())
    writer.close()
    assert {p.name for p in tmp_path.iterdir() if p.is_dir()} == {*old[-MAX_AUTOMATIC + 1 :], *kept, path.name}


def test_two_in_one_second_have_names_of_their_own(drive: Stream, tmp_path: Path) -> None:
    """Neither is written over the other."""
    ring = ring_with(drive)
    writer = writer_of(ring, tmp_path, drive)
    kept = ring.take()
    half = len(kept) // 2
    paths = {writer.write("asked", part).result(limit_s()) for part in (kept[:half], kept[half:])}
    writer.close()
    assert set(tmp_path.glob("2*")) == paths
    assert len(paths) == 2


def test_more_than_it_can_write_is_refused(drive: Stream, tmp_path: Path) -> None:
    """Each waits with its pictures' rooms; so only some may, and the rooms of what is refused are free again."""
    ring = ring_with(drive)
    shown = Shown(camera=drive.camera, dictionary="DICT_4X4_50", panel=SPEC, source="simulated")
    writer = RewindWriter(ring, tmp_path, shown)  # it is not started, and writes nothing
    for _ in range(MAX_WAITING):
        writer.write("asked", [])
    kept, before = ring.take(), ring.room
    with pytest.raises(RecordingError, match="others are still being written"):
        writer.write("asked", kept)
    assert ring.room == before + len(kept)
