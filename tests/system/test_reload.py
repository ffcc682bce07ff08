"""SIGHUP with any file at all: the old configuration runs on, and SIGTERM works."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import ClassVar

import pytest

from ledpi.camera.base import Camera
from ledpi.camera.simulated import open_simulated
from ledpi.config.settings import Config, load_config
from ledpi.core.records import Frame, Pixels
from ledpi.daemon.reload import Reading
from ledpi.daemon.service import Service
from ledpi.wire import FixMessage, MarkerMessage, State
from tests.builders.daemon import (
    COMMAND,
    SIMULATED,
    SIMULATED_YAML,
    Controller,
    Ended,
    OtherCamera,
    controller,
    daemon,
    end,
    lines_until,
    slowness,
    wait_for_log,
    write_recording,
)
from tests.builders.waiting import limit_s, wait_until

FILES = 40  # each a SIGHUP, and a tenth of a second
# In it, a file of that name is as on a mount whose server is gone.
STUCK = """
import os, sys, time
def hang(event, args):
    if event == "open" and os.path.basename(os.path.realpath(str(args[0]))) == "stuck.yaml":
        time.sleep(3600)
sys.addaudithook(hang)
from ledpi.cli import main
main()
"""
NUMBER = "9" * 5000


def a_pipe(file: Path) -> None:
    os.mkfifo(file)


def a_folder(file: Path) -> None:
    file.mkdir()


def a_device(file: Path) -> None:
    file.symlink_to("/dev/zero")


def too_large(file: Path) -> None:
    file.touch()
    os.truncate(file, 2**40)  # without taking any room


def nothing(file: Path) -> None:
    """No file of that name."""


def content(text: str) -> Callable[[Path], object]:
    return lambda file: file.write_text(text)


BOMB = "a: &a [x]\n" + "".join(f"{b}: &{b} [{f'*{a},' * 9}]\n" for a, b in pairwise("abcdefghij"))
AS_CONFIG = {
    "pipe": a_pipe,
    "folder": a_folder,
    "device": a_device,
    "too large": too_large,
    "missing": nothing,
    "bomb": content(BOMB),
    "nested": content("a: " + "[" * 99_999),
    "number": content(f"serial: {{baud: {NUMBER}}}"),
    "hexadecimal": content(f"panels: {{side_m: 0x{NUMBER}}}"),
    "number for a key": content(f"panels: {{side_m: 1, overrides: {{0x{NUMBER}: {{}}}}}}"),
    "number for all": content(f"0x{NUMBER}"),
    "long key": content(f"{'k' * 99_999}: 1"),
    "long name": content(f"panels: {{side_m: 1, dictionary: {'n' * 99_999}.yaml}}"),
    "no recording": content("panels: {side_m: 1}\ncamera: {source: 'recording:gone'}"),
    "bytes": lambda file: file.write_bytes(bytes(range(256)) * 99),
}
NAMED = {name: AS_CONFIG[name] for name in ("pipe", "folder", "device", "too large", "missing", "bomb", "nested")}
NAMING = {  # configurations that are right but for the file that they name
    "map": "panels: {side_m: 1}\ncamera: {source: simulated}\nmap: named.yaml",
    "lens": "panels: {side_m: 1}\ncamera: {source: 'recording:take', intrinsics: named.yaml}",
    "lens of the simulator": "panels: {side_m: 1}\ncamera: {source: simulated, intrinsics: named.yaml}",
    "words": "panels: {side_m: 1, dictionary: named.yaml}\ncamera: {source: simulated}",
}


@contextmanager
def running(folder: Path, command: list[str] = COMMAND) -> Iterator[tuple[subprocess.Popen[str], Controller]]:
    """The daemon with config.yaml in `folder`, once it has told where a panel is."""
    with controller() as line:
        (folder / "config.yaml").write_text("panels: {side_m: 0.16}\n" + SIMULATED_YAML)
        options = ("--config", str(folder / "config.yaml"))
        with daemon(f"serial.port={line.port}", options=options, command=command) as process:
            line.wait_for(lambda c: bool(c.markers))
            yield process, line


def refusal(process: subprocess.Popen[str]) -> str:
    """Returns what it says after SIGHUP."""
    process.send_signal(signal.SIGHUP)
    return wait_for_log(process, "reload_refused")


def holds(process: subprocess.Popen[str]) -> tuple[int, int]:
    """Counts its threads and descriptors."""
    there = Path(f"/proc/{process.pid}")
    return len([*(there / "task").iterdir()]), len([*(there / "fd").iterdir()])


def memory_kb(process: subprocess.Popen[str]) -> int:
    return int(Path(f"/proc/{process.pid}/status").read_text().split("VmRSS:")[1].split()[0])


def ended_in_time(process: subprocess.Popen[str]) -> Ended:
    ended = end(process, signal.SIGTERM)
    assert ended.status == 0
    assert ended.seconds_to_end < 1.0 * slowness()
    return ended


def put(file: Path, make: Callable[[Path], object]) -> None:
    """In the place of what has the name."""
    if file.is_dir():
        file.rmdir()
    file.unlink(missing_ok=True)
    make(file)


@pytest.mark.slow
def test_bad_files_change_nothing(tmp_path: Path) -> None:
    """One after the other, the configuration itself and what it names: same threads, same descriptors, same stream."""
    write_recording(tmp_path / "take", 3, calibrated=False)
    rng = random.Random(23)
    cases = [("config.yaml", name) for name in AS_CONFIG] + [(naming, name) for naming in NAMING for name in NAMED]
    cases += rng.choices(cases, k=max(0, FILES - len(cases)))
    with running(tmp_path) as (process, line):
        before = holds(process)
        for which, name in cases:
            if which == "config.yaml":
                put(tmp_path / which, AS_CONFIG[name])
            else:
                put(tmp_path / "config.yaml", content(NAMING[which]))
                put(tmp_path / "named.yaml", NAMED[name])
            said = refusal(process)
            assert str(tmp_path) in said, (which, name, said)
            assert len(said) < 1000, (which, name, said)
        seen = len(line.markers)
        line.wait_for(lambda c: len(c.markers) > seen + 3)
        # One may be open for a moment only.
        wait_until(lambda: all(now <= then for now, then in zip(holds(process), before, strict=True)))
        ended_in_time(process)


@pytest.mark.slow
def test_reloads_leave_nothing_behind(tmp_path: Path) -> None:
    """Each with another socket for the tap: threads, descriptors (one may be open for a moment), memory: 10 MB each."""
    file, held = tmp_path / "config.yaml", []
    with running(tmp_path) as (process, _):
        text = file.read_text()
        for number in range(25):
            file.write_text(f"{text}tap: {{socket: {tmp_path}/{number}}}\n")
            process.send_signal(signal.SIGHUP)
            wait_for_log(process, f"tap={tmp_path}/{number}")
            held.append((*holds(process), memory_kb(process)))
    assert all(now <= then + 1 for now, then in zip(held[-1][:2], held[5][:2], strict=True))
    assert held[-1][2] < held[5][2] + 30_000


@pytest.mark.slow
def test_a_mount_that_hangs_stops_nothing(tmp_path: Path) -> None:
    """The log says that something is waited for; the stream goes on; a second SIGHUP adds no thread; SIGTERM works."""
    (tmp_path / "stuck.yaml").touch()
    with running(tmp_path, [sys.executable, "-c", STUCK, "run"]) as (process, line):
        threads, _ = holds(process)
        put(tmp_path / "config.yaml", content(NAMING["map"].replace("named", "stuck")))
        process.send_signal(signal.SIGHUP)
        wait_for_log(process, "reload_waits")
        process.send_signal(signal.SIGHUP)
        seen = len(line.markers)
        line.wait_for(lambda c: len(c.markers) > seen + 20)
        wait_until(lambda: holds(process)[0] == threads + 1)
        ended_in_time(process)


def test_a_configuration_that_arrives_late_is_taken() -> None:
    """As when the mount is back. Until then there is no result."""
    began, may_end = threading.Event(), threading.Event()

    def load() -> Config:
        began.set()
        assert may_end.wait(limit_s())
        return load_config(None, ("panels.side_m=0.16", "camera.source=simulated"))

    reading = Reading(load)
    assert began.wait(limit_s())
    assert reading.result() is None
    may_end.set()
    while (result := reading.result()) is None:
        time.sleep(0.001)
    assert isinstance(result, Config)


def test_whatever_a_file_brings_about_is_a_result() -> None:
    """Also an error that nobody has foreseen; no thread ends with a traceback."""

    def load() -> Config:
        raise MemoryError

    reading = Reading(load)
    while (result := reading.result()) is None:
        time.sleep(0.001)
    assert isinstance(result, MemoryError)


def test_where_no_thread_can_be_begun_that_is_the_result(monkeypatch: pytest.MonkeyPatch) -> None:
    """The system has a limit of these, too."""

    def refused(_: threading.Thread) -> None:
        raise RuntimeError("can't start new thread")

    with monkeypatch.context() as patch:
        patch.setattr(threading.Thread, "start", refused)
        reading = Reading(lambda: load_config(None, SIMULATED))
    assert str(reading.result()) == "can't start new thread"


# ---- What stays open


OTHER = {
    "panels": ("side_m: 0.16", "side_m: 0.158"),
    "age": ("baud: 115200", "baud: 115200, max_age_ms: 90"),
    "baud": ("baud: 115200", "baud: 230400"),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "camera_stays", "port_stays"),
    [("panels", 0, 1), ("age", 1, 1), ("baud", 1, 0)],
)
def test_what_a_reload_does_not_change_stays_open(
    tmp_path: Path, change: str, camera_stays: bool, port_stays: bool
) -> None:
    """An Arduino is reset by each opening of its port. The stream goes on, the numbers too, and no "stopping" is said.

    The camera is the simulator, which shows other panels where those of the configuration are others.
    """
    file, opens = tmp_path / "config.yaml", 1 if port_stays else 2
    with controller() as line:
        text = f"panels: {{side_m: 0.16}}\n{SIMULATED_YAML}serial: {{port: {line.port}, baud: 115200}}\n"
        file.write_text(text)
        with daemon(options=("--config", str(file))) as process:
            line.wait_for(lambda c: len(c.markers) > 3)
            file.write_text(text.replace(*OTHER[change]))
            process.send_signal(signal.SIGHUP)
            log = lines_until(process, "INFO start ", 2)
            while sum("serial_open" in entry for entry in log) < opens:
                log += lines_until(process, "serial_open")
            before = len(line.got)
            line.wait_for(lambda c: sum(isinstance(message, MarkerMessage) for _, message in c.got[before:]) > 3)
            line.wait_for(lambda c: c.receiver.counters.restarts == opens - 1)  # before it, the old one's are read
            stopping = sum(status.state is State.STOPPING for _, status in line.statuses)
            log += end(process, signal.SIGTERM).log
    opened = sum("serial_open" in entry for entry in log)
    assert (opened, stopping == 0) == (opens, port_stays)
    assert sum("time 0 of its scene" in entry for entry in log) == (1 if camera_stays else 2)
    assert line.receiver.counters.lost == 0
    assert line.receiver.counters.restarts == (0 if port_stays else 1)


class Counted(OtherCamera):
    """A camera that knows how often it was opened, and whether it is closed."""

    opened: ClassVar[list[Counted]] = []

    def __init__(self) -> None:
        super().__init__()
        self.closed = False
        self.opened.append(self)

    def read(self, into: Pixels) -> Frame | None:
        return self._camera.read(into)

    def close(self) -> None:
        self.closed = True
        super().close()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("change", "opened"),
    [
        ("camera.intrinsics=null", 1),
        ("serial.port=/nowhere/else", 1),
        ("panels.black_hz=1300", 2),  # another frame period may suit these
        ("camera.source=v4l2:/dev/video1", 2),
    ],
)
def test_a_device_runs_on_unless_it_would_be_set_up_otherwise(
    change: str, opened: int, caplog: pytest.LogCaptureFixture
) -> None:
    """To close and open a camera takes a second or two without a pose. In the end it is closed."""
    given = ("panels.side_m=0.16", "camera.source=v4l2:/dev/video0", "camera.row_time_us=33.67", "tap.socket=null")
    configs = iter([load_config(None, given), load_config(None, (*given, change))])
    Counted.opened.clear()
    caplog.set_level("INFO", "ledpi")
    service = Service(lambda: next(configs), lambda _: Counted())
    running = threading.Thread(target=service.run)
    running.start()
    service.reload()
    wait_until(lambda: caplog.text.count(" start version=") == 2)
    assert [camera.closed for camera in Counted.opened] == [True] * (opened - 1) + [False]
    service.stop()
    running.join(limit_s())
    assert all(camera.closed for camera in Counted.opened)


@pytest.mark.slow
def test_a_camera_that_hangs_is_opened_again() -> None:
    """Its reader does not come back to be handed over."""
    config = load_config(None, (*SIMULATED, "serial.port=/nowhere/port"))
    ends = threading.Event()

    class Hanging(Counted):
        def read(self, into: Pixels) -> Frame | None:
            ends.wait(limit_s())
            return None

        def close(self) -> None:
            super().close()
            ends.set()

    Counted.opened.clear()
    service = Service(lambda: config, lambda _: Counted() if Counted.opened else Hanging())
    running = threading.Thread(target=service.run)
    running.start()
    service.reload()
    wait_until(lambda: len(Counted.opened) >= 2)
    service.stop()
    running.join(limit_s())
    assert [type(camera) for camera in Counted.opened] == [Hanging, Counted]
    assert all(camera.closed for camera in Counted.opened)


@pytest.mark.slow
def test_an_error_while_the_new_daemon_is_made_brings_the_old_configuration_back(
    caplog: pytest.LogCaptureFixture,
) -> None:
    """One that nobody has foreseen, or the system's, and when the old daemon has ended already."""
    config = load_config(None, (*SIMULATED, "serial.port=/nowhere/port"))
    configs = iter([config, load_config(None, (*SIMULATED, "serial.port=/nowhere/port", "camera.exposure_us=5000"))])
    opened: list[Camera] = []

    def open_second_never(_: Config) -> Camera:
        if len(opened) == 1 and "reload_refused" not in caplog.text:
            raise OSError(24, "full")
        opened.append(open_simulated(config, paced=True))
        return opened[-1]

    caplog.set_level("INFO", "ledpi")
    service = Service(lambda: next(configs), open_second_never)
    running = threading.Thread(target=service.run)
    running.start()
    service.reload()
    wait_until(lambda: len(opened) >= 2)
    service.stop()
    running.join(limit_s())
    assert not running.is_alive()
    assert 'reload_refused error="OSError: [Errno 24] full" stays="the old configuration"' in caplog.text


def fixes(line: Controller) -> list[FixMessage]:
    return [message for _, message in line.got if isinstance(message, FixMessage)]


@pytest.mark.slow
def test_a_reload_with_another_map_is_reported_with_each_fix(tmp_path: Path) -> None:
    """The panel hangs ten metres further, as no drive goes: fixes jump, and say so; with the same map they do not."""
    file, map_file = tmp_path / "config.yaml", tmp_path / "markers.yaml"

    def hang(x_m: float) -> None:
        map_file.write_text(f"panels: {{7: {{position_m: [{x_m}, 0, 1], quaternion_wxyz: [0.5, 0.5, 0.5, 0.5]}}}}\n")

    with controller() as line:
        file.write_text(
            f"panels: {{side_m: 0.16, upright: true}}\nmap: markers.yaml\n{SIMULATED_YAML}serial: {{port: {line.port}}}"
        )
        hang(3.0)
        with daemon(options=("--config", str(file))) as process:
            wait_for_log(process, "INFO start ")
            for x_m in (3.0, 13.0):
                line.wait_for(lambda c: bool(fixes(c)))
                hang(x_m)
                process.send_signal(signal.SIGHUP)
                wait_for_log(process, "INFO start ")
                seen = len(fixes(line))
                line.wait_for(lambda c, seen=seen: len(fixes(c)) > seen + 3)  # type: ignore[misc]
            assert end(process, signal.SIGTERM).status == 0
        line.close()
    counted = [fix.map_resets for fix in fixes(line)]
    assert set(counted) == {0, 1}
    assert counted == sorted(counted)
    before, after = fixes(line)[counted.count(0) - 1], fixes(line)[counted.count(0)]
    assert after.pose.position_m[0] > before.pose.position_m[0] + 5.0
