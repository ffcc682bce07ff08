"""The last seconds as a recording: decoded again it gives what it gave live, once its panels are found again."""

from __future__ import annotations

import json
import subprocess
import threading
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from ledpi.cli.decode import OLD_STATE_FILE
from ledpi.config.settings import RewindSettings
from ledpi.core.errors import DiskFullError, RecordingError
from ledpi.daemon import rewind, takes
from ledpi.daemon.rewind import OWN_BYTES, Rewind, default_budget_bytes, limit_bytes
from ledpi.daemon.takes import LIVE_FILE, MAX_AUTOMATIC, MAX_WAITING, TakeWriter
from tests.builders.command import ledpi
from tests.builders.rewind import (
    Stream,
    as_lines,
    decoded_live,
    later,
    stream,
    without_times,
)
from tests.builders.waiting import limit_s

COUNT = 16


@pytest.fixture(scope="module")
def drive() -> Stream:
    return stream(COUNT)


def rewind_of(drive: Stream, folder: Path, first: int = 0, budgets: Sequence[int] = ()) -> Rewind:
    """One that keeps all from the frame `first` on; with budgets, where each frame had one of its own."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("STATE_DIRECTORY", str(folder))
        made = Rewind(RewindSettings(seconds=10.0, memory_mb=100.0), drive.shown, 35.0)
    frames, live = drive.frames[first:], drive.live[first:]
    for frame, result, budget in zip(frames, live, budgets or [150_000] * len(frames), strict=True):
        made.keep(frame, result, budget)
    return made


def saved(drive: Stream, folder: Path, first: int = 0, budgets: Sequence[int] = ()) -> Path:
    """A recording of the stream from the frame `first` on."""
    return rewind_of(drive, folder, first, budgets).save().result(limit_s())


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


def test_only_the_daemons_own_user_may_read_it(drive: Stream, tmp_path: Path) -> None:
    """Whoever may not use the tap gets no picture from the folder either."""
    saved(drive, tmp_path / "takes")
    assert (tmp_path / "takes").stat().st_mode & 0o077 == 0


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
    made, write, written = rewind_of(drive, tmp_path), TakeWriter.write_kept, []

    def count(*arguments: Any) -> None:
        write(*arguments)
        written.append(arguments)
        if len(written) == 12:
            made.stop()

    monkeypatch.setattr(TakeWriter, "write_kept", count)
    with pytest.raises(
        RecordingError, match=r"^rewind: the daemon ends, and 4 frames more are not written; 12 frames are in .*\.part"
    ):
        made.save().result(limit_s())
    (part,) = tmp_path.glob("2*")
    assert part.name.endswith("-asked.part")
    assert lines_of(decode("--as-live", part).stdout) == as_lines(drive.live[:12])


def test_a_disk_that_is_too_full_is_reported(drive: Stream, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Before anything is written, as a disk that ledpi has filled stops more than ledpi; the rooms are free again."""
    monkeypatch.setattr(takes, "MIN_FREE_BYTES", 10**18)
    made = rewind_of(drive, tmp_path / "takes")
    with pytest.raises(DiskFullError, match=r"^rewind: .*the disk has \d+ MB left; \d+ MB are needed"):
        made.save().result(limit_s())
    assert list((tmp_path / "takes").iterdir()) == []


def test_those_that_nobody_asked_for_do_not_pile_up(drive: Stream, tmp_path: Path) -> None:
    """The newest stay, whole or not; those that somebody asked for stay, and so does what is no recording."""
    old = [f"2026010{day}T000000Z-camera_lost" for day in range(1, 8)]
    kept = ["20250101T000000Z-asked", "20250101T000000Z-camera_lost-mine", "notes"]
    for name in (*old, *kept, "20260101T000000Z-contradicted-2.part"):
        (tmp_path / name).mkdir()
    path = rewind_of(drive, tmp_path).save("camera_lost").result(limit_s())
    assert {p.name for p in tmp_path.iterdir() if p.is_dir()} == {*old[-MAX_AUTOMATIC + 1 :], *kept, path.name}


def test_more_than_it_can_write_is_refused(drive: Stream, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each waits with its pictures' rooms, so only some may. All that were taken have names of their own."""
    goes_on, write = threading.Event(), TakeWriter.write_kept
    monkeypatch.setattr(TakeWriter, "write_kept", lambda *values: (goes_on.wait(limit_s()), write(*values)))
    made, futures = rewind_of(drive, tmp_path), []
    for number in range(1, MAX_WAITING + 2):
        futures.append(made.save())
        made.keep(later(drive.frames[0], number * 10**12, number * 1000), drive.live[0], 1)
    with pytest.raises(RecordingError, match="others are still being written"):
        made.save()
    goes_on.set()
    assert len({future.result(limit_s()) for future in futures}) == MAX_WAITING + 1


def test_where_no_thread_can_be_begun_it_is_said_and_the_next_one_is_whole(
    drive: Stream, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The rooms of what was refused are used for other frames."""

    def refused(thread: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    made = rewind_of(drive, tmp_path)
    with monkeypatch.context() as patch:
        patch.setattr(threading.Thread, "start", refused)
        with pytest.raises(RecordingError, match="the system gives this process no further thread"):
            made.save()
    for frame, result in zip(drive.frames, drive.live, strict=True):
        made.keep(later(frame, 10**12, 1000), result, 1)
    path = made.save().result(limit_s())
    assert len(list((path / "frames").iterdir())) == COUNT
    assert list(tmp_path.glob("2*")) == [path]


# ---- Memory


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """A service's cgroup, as /proc/self/cgroup and /sys/fs/cgroup show it; limited by nothing."""
    group = tmp_path / "groups" / "system.slice" / "ledpi.service"
    group.mkdir(parents=True)
    (group / "memory.max").write_text("max\n")
    (group.parent / "memory.max").write_text("max\n")
    (tmp_path / "own").write_text("0::/system.slice/ledpi.service\n")
    return tmp_path / "own"


def limit(own: Path) -> int | None:
    return limit_bytes(own, own.parent / "groups")


def test_of_a_services_limit_and_that_of_what_it_is_in_the_smallest_holds(own: Path) -> None:
    """As the kernel has them; `max` is none."""
    assert limit(own) is None
    (own.parent / "groups/system.slice/ledpi.service/memory.max").write_text("900000000\n")
    assert limit(own) == 900_000_000
    (own.parent / "groups/system.slice/memory.max").write_text("600000000\n")
    assert limit(own) == 600_000_000


def test_other_systems_have_no_limit_that_is_known(tmp_path: Path) -> None:
    """Without /proc, or with cgroups of the first version."""
    assert limit_bytes(tmp_path / "nothing", tmp_path) is None
    (tmp_path / "own").write_text("9:memory:/here\n")
    assert limit_bytes(tmp_path / "own", tmp_path) is None


def test_the_budget_is_an_eighth_and_never_what_the_work_needs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Takes an eighth of the machine's; what a limit leaves beside the daemon's own work; nothing where that is nil."""
    monkeypatch.setattr(rewind, "limit_bytes", lambda: None)
    eighth = default_budget_bytes()
    total_kb = int(Path("/proc/meminfo").read_text().split()[1])
    assert eighth == pytest.approx(total_kb * 1024 / 8, rel=0.01)
    monkeypatch.setattr(rewind, "limit_bytes", lambda: OWN_BYTES + 5_000_000)
    assert default_budget_bytes() == min(eighth, 5_000_000)
    monkeypatch.setattr(rewind, "limit_bytes", lambda: 100_000_000)
    assert default_budget_bytes() == 0
