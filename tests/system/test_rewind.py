"""Rewind in the running daemon: saved when asked for, after a fault, and never at the cost of its work."""

from __future__ import annotations

import json
import logging
import resource
import signal
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from ledpi.camera.recording.reader import load_recording
from ledpi.camera.recovering import LOST
from ledpi.config.settings import RewindSettings, load_config
from ledpi.core.errors import RecordingError
from ledpi.core.records import Frame, Pixels, Rejected, RobotFix
from ledpi.daemon.rewind import AGAIN_NS, Rewind
from ledpi.daemon.takes import LIVE_FILE, takes_folder
from ledpi.pose.fix_history import CONTRADICTION
from tests.builders.command import ledpi
from tests.builders.daemon import (
    COMMAND,
    ROOT,
    SIMULATED,
    Controller,
    OtherCamera,
    controller,
    daemon,
    daemon_in_thread,
    end,
)
from tests.builders.rewind import Stream, differences_once_settled, stream, without_times
from tests.builders.waiting import limit_s, wait_until

# Where others take the processor, live searches less, and what is kept begins long after the daemon.
AS_LIVE = pytest.mark.alone


def whole(takes: Path) -> list[Path]:
    """The recordings that are done."""
    return sorted(p for p in takes.glob("2*") if p.suffix != ".part") if takes.exists() else []


def asked(takes: Path) -> list[Path]:
    """Those that somebody asked for: where the machine is so busy that no frame comes, a fault has its own."""
    return [take for take in whole(takes) if "-asked" in take.name]


def live_and_again(take: Path) -> tuple[list[dict[str, Any]], list[dict[str, Any]]]:
    """Lines of what was live, and those of `ledpi decode --as-live`; of a part, as many as both have."""
    done = ledpi("decode", "--as-live", take)
    assert done.returncode == 0, done.stderr
    again = without_times([json.loads(line) for line in done.stdout.splitlines()])
    live = without_times([json.loads(line) for line in (take / LIVE_FILE).read_text().splitlines()])
    assert len(live) == len(again) or (take.suffix == ".part" and len(again) - len(live) in (0, 1))
    assert live
    return live[: len(again)], again[: len(live)]


def differences(take: Path) -> list[tuple[object, object]]:
    """Lines of what was live, since the daemon's start, that are others when it is decoded again."""
    return [(a, b) for a, b in zip(*live_and_again(take), strict=True) if a != b]


def has_seen(line: Controller, markers: int) -> None:
    line.wait_for(lambda c: len(c.markers) >= markers)


@pytest.mark.slow
@AS_LIVE
def test_sigusr1_saves_what_was_live(takes: Path) -> None:
    """Twice: the first decodes as it did live from its first frame on, as the daemon had; the second after a second."""
    with controller() as line, daemon(*SIMULATED, f"serial.port={line.port}") as process:
        for count in (1, 2):
            seen = len(line.markers)
            has_seen(line, seen + 100)
            process.send_signal(signal.SIGUSR1)
            wait_until(lambda n=count: len(asked(takes)) == n, "a recording")
        has_seen(line, len(line.markers) + 20)
        ended = end(process, signal.SIGTERM)
    assert ended.status == 0
    first, second = asked(takes)
    assert differences(first) == []
    assert differences_once_settled(*live_and_again(second)) == []
    assert sum("rewind_saved cause=asked" in line for line in ended.log) == 2
    assert json.loads((second / LIVE_FILE).read_text().splitlines()[0])["markers"]  # in its very first frame
    budgets = {entry.search_budget for entry in load_recording(second).frames}
    assert None not in budgets


@pytest.mark.slow
def test_a_file_that_cannot_be_written_is_reported_and_the_daemon_goes_on(takes: Path) -> None:
    """The kernel refuses the first picture; poses go on, and the next recording, with room again, is whole."""
    with controller() as line, daemon(*SIMULATED, f"serial.port={line.port}") as process:
        has_seen(line, 20)
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (5_000, resource.RLIM_INFINITY))
        process.send_signal(signal.SIGUSR1)
        wait_until(lambda: takes.exists() and not list(takes.glob("*-asked*")), "the folder, and nothing in it")
        seen = len(line.markers)
        has_seen(line, seen + 20)
        resource.prlimit(process.pid, resource.RLIMIT_FSIZE, (resource.RLIM_INFINITY, resource.RLIM_INFINITY))
        process.send_signal(signal.SIGUSR1)
        wait_until(lambda: asked(takes), "a recording")
        ended = end(process, signal.SIGTERM)
    assert ended.status == 0
    (told,) = [line for line in ended.log if "rewind_failed cause=asked" in line]
    assert "cannot be written: File too large" in told
    live, again = live_and_again(*asked(takes))
    assert [line["seq"] for line in again] == [line["seq"] for line in live]


# In front of the daemon: once all is loaded, the system gives it 100 MB more, and no ring of 200.
SCANT = """
import re, resource
import ledpi.pipeline.pipeline, ledpi.daemon.service
from ledpi.daemon import daemon
run = daemon.Observers
def scant(*arguments):
    data = int(re.search(r"VmData:\\s+(\\d+)", open("/proc/self/status").read())[1]) * 1024
    resource.setrlimit(resource.RLIMIT_DATA, (data + 100_000_000, -1))
    return run(*arguments)
daemon.Observers = scant
"""


@pytest.mark.slow
def test_where_the_system_has_no_memory_for_it_poses_go_on(takes: Path) -> None:
    """The journal says that nothing is kept; who asks for it hears so."""
    command = [*COMMAND[:2], SCANT + COMMAND[2], *COMMAND[3:]]
    settings = (*SIMULATED, "rewind.seconds=100", "rewind.memory_mb=1000")
    with controller() as line, daemon(*settings, f"serial.port={line.port}", command=command) as process:
        has_seen(line, 20)
        process.send_signal(signal.SIGUSR1)
        has_seen(line, 40)
        ended = end(process, signal.SIGTERM)
    assert ended.status == 0
    assert any("rewind_short seconds=0 wanted=100 memory_mb=0" in entry for entry in ended.log)
    assert any("rewind_failed" in entry for entry in ended.log)
    assert not takes.exists()


@pytest.mark.slow
@AS_LIVE
def test_ledpi_rewind_asks_the_running_daemon(takes: Path, tmp_path: Path) -> None:
    """It copies the recording, or says where it is; a folder that holds something is refused before that."""
    socket = tmp_path / "tap"
    with controller() as line, daemon(*SIMULATED, f"serial.port={line.port}", f"tap.socket={socket}") as process:
        has_seen(line, 20)
        done = ledpi("rewind", tmp_path / "copy", "--tap", socket)
        assert (done.returncode, done.stdout) == (0, f"{tmp_path / 'copy'}\n"), done.stderr
        refused = ledpi("rewind", tmp_path / "copy", "--tap", socket)
        has_seen(line, len(line.markers) + 10)
        only_there = ledpi("rewind", "--tap", socket)
        end(process, signal.SIGTERM)
    gone = ledpi("rewind", "--tap", socket)
    assert differences(tmp_path / "copy") == []
    assert (refused.returncode, refused.stderr.count("\n")) == (2, 1)
    assert "is there already" in refused.stderr
    assert Path(only_there.stdout.strip()) == asked(takes)[1]
    assert (gone.returncode, gone.stderr.count("\n")) == (2, 1)
    assert "no running daemon answers" in gone.stderr


# ---- Faults


class Flaky(OtherCamera):
    """The simulated camera, lost again and again for half a second at a time."""

    def __init__(self, every: int) -> None:
        super().__init__()
        self._every, self._read, self.lost = every, 0, 0

    def read(self, into: Pixels) -> Frame | Rejected | None:
        self._read += 1
        if self._read % self._every == 0:
            self.lost += 1
            time.sleep(0.5)
            return LOST
        return self._camera.read(into)


@pytest.mark.slow
def test_a_lost_camera_is_saved_once(takes: Path) -> None:
    """A camera that is lost again soon is the same fault."""
    camera = Flaky(every=25)
    with controller() as line, daemon_in_thread(load_config(None, (*SIMULATED, f"serial.port={line.port}")), camera):
        wait_until(lambda: camera.lost >= 3 and whole(takes), "three losses")
    (take,) = takes.glob("2*")
    assert take.name.endswith("-camera_lost")
    assert load_recording(take).frames


@pytest.fixture(scope="module")
def drive() -> Stream:
    return stream(12)


def kept_by(rewind: Rewind, drive: Stream, *, contradicted: bool, later_ns: int = 0) -> None:
    """A dozen frames; the last contradicts the map."""
    for index, (frame, decoded) in enumerate(zip(drive.frames, drive.live, strict=True)):
        is_it = contradicted and index == len(drive.frames) - 1
        shown = replace(decoded, rejected=(*decoded.rejected, CONTRADICTION)) if is_it else decoded
        at_ns = frame.row0_readout_ns + later_ns
        rewind.keep(replace(frame, seq=frame.seq + later_ns // 10**6, row0_readout_ns=at_ns), shown, 150_000)


@pytest.fixture
def rewind(drive: Stream, takes: Path) -> Iterator[Rewind]:
    made = Rewind(RewindSettings(seconds=1.0, memory_mb=50.0), drive.shown, 17.0)
    yield made
    made.close()


def test_a_contradicted_panel_is_saved_once(rewind: Rewind, drive: Stream, takes: Path) -> None:
    """A map that is wrong contradicts every frame; that is one fault. A minute of peace later it is a new one."""
    kept_by(rewind, drive, contradicted=False)
    rewind.tick(0, lost=False)
    assert not takes.exists()
    second_ns = 10**9
    for number in range(1, 4):
        kept_by(rewind, drive, contradicted=True, later_ns=number * second_ns)
        rewind.tick(0, lost=False)
    wait_until(lambda: whole(takes), "a recording")
    kept_by(rewind, drive, contradicted=True, later_ns=5 * second_ns + AGAIN_NS)
    rewind.tick(0, lost=False)
    wait_until(lambda: len(whole(takes)) == 2, "another")
    assert {p.name.partition("-")[2] for p in takes.glob("2*")} <= {"contradicted", "contradicted-2"}


def test_a_panel_that_a_fix_leaves_out_is_contradicted(rewind: Rewind, drive: Stream, takes: Path) -> None:
    """There is a fix, of the others: whoever put up the map wants to know."""
    kept_by(rewind, drive, contradicted=False)
    frame, decoded = drive.frames[-1], drive.live[-1]
    solution = next(m.solution for d in drive.live for m in d.markers if m.solution is not None)
    fix = RobotFix(
        map_from_base_link=solution.camera_from_marker, mid_exposure_ns=1, panels_used=(7,), panels_rejected=(23,)
    )
    rewind.keep(replace(frame, seq=99, row0_readout_ns=frame.row0_readout_ns + 10**8), replace(decoded, robot=fix), 1)
    rewind.tick(0, lost=False)
    wait_until(lambda: whole(takes), "a recording")


def test_a_replay_saves_no_fault(drive: Stream, takes: Path) -> None:
    """Between its rounds there is a gap, and what it shows is recorded already. Who asks gets it all the same."""
    settings = RewindSettings(seconds=1.0, memory_mb=50.0)
    made = Rewind(settings, drive.shown._replace(source="recording:/takes/kitchen"), 17.0)
    kept_by(made, drive, contradicted=True)
    made.tick(0, lost=True)
    assert made.save().result(limit_s()).name.endswith("-asked")
    made.close()
    assert len(whole(takes)) == 1


def test_a_fault_before_anything_was_seen_is_no_failure(
    rewind: Rewind, drive: Stream, takes: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """A first frame that is late, as on a busy machine: there is nothing to save. A later loss is new."""
    rewind.tick(0, lost=True)
    rewind.tick(100_000_000, lost=False)
    assert not takes.exists()
    assert caplog.text == ""
    kept_by(rewind, drive, contradicted=False)
    rewind.tick(1_000_000_000, lost=True)
    wait_until(lambda: bool(whole(takes)), "the loss")
    assert [take.name.partition("-")[2] for take in whole(takes)] == ["camera_lost"]


# ---- Places and memory


def test_a_service_writes_in_its_state_directory(monkeypatch: pytest.MonkeyPatch) -> None:
    """systemd names it, or several; the unit's own is one of its own, not the calibration's."""
    monkeypatch.setenv("STATE_DIRECTORY", "/var/lib/ledpi-takes:/var/lib/other")
    assert takes_folder() == Path("/var/lib/ledpi-takes")
    assert "\nStateDirectory=ledpi-takes\n" in (ROOT / "systemd" / "ledpi.service").read_text()


def test_a_person_s_daemon_writes_in_their_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """As the XDG base directories have it."""
    monkeypatch.delenv("STATE_DIRECTORY", raising=False)
    monkeypatch.setenv("XDG_STATE_HOME", "/somewhere")
    assert takes_folder() == Path("/somewhere/ledpi/takes")
    monkeypatch.delenv("XDG_STATE_HOME")
    monkeypatch.setenv("HOME", "/home/anna")
    assert takes_folder() == Path("/home/anna/.local/state/ledpi/takes")


def test_what_does_not_fit_is_reported(drive: Stream, takes: Path, caplog: pytest.LogCaptureFixture) -> None:
    """Ten seconds in 20 MB: how many there are instead."""
    with caplog.at_level(logging.WARNING):
        Rewind(RewindSettings(seconds=10.0, memory_mb=20.0), drive.shown, 17.0)
    (told,) = [record.getMessage() for record in caplog.records if "rewind_short" in record.getMessage()]
    assert "wanted=10 memory_mb=20" in told


def test_asking_too_early_is_refused(drive: Stream, takes: Path) -> None:
    """Before a frame was decoded."""
    made = Rewind(RewindSettings(seconds=1.0, memory_mb=50.0), drive.shown, 17.0)
    with pytest.raises(RecordingError, match="nothing is kept yet"):
        made.save()
