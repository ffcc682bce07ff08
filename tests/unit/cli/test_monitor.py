"""`ledpi monitor` as its user sees it: a process on a pty."""

from __future__ import annotations

import os
import select
import signal
import subprocess
import sys
import threading
import time
import tty
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from ledpi.wire import NoFix, State, StatusMessage
from ledpi.wire.codec import encode
from tests.builders import ROOT
from tests.builders.command import in_process
from tests.builders.made_up_daemon import HEALTH, LARGE, MadeUpDaemon
from tests.builders.waiting import limit_s
from tests.builders.wire import vectors

# Typer drops the name of a command that is the only one, so this one is made not to be.
COMMAND = [
    sys.executable,
    "-c",
    """
import ledpi.cli.monitor
from ledpi.cli import app, main
app.command("another")(lambda: None)
main()
""",
    "monitor",
]
VECTORS = vectors()
HELLO = StatusMessage(state=State.STARTING, no_fix=NoFix.NOT_RUNNING)


def run(*arguments: str) -> subprocess.CompletedProcess[str]:
    """A monitor that ends by itself."""
    command = [*COMMAND, *arguments]
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=limit_s(30))


class Monitored:
    """A monitor on a pty, and the sender's end."""

    def __init__(self, *options: str) -> None:
        self._master, self._slave = os.openpty()
        tty.setraw(self._master)
        self.path = os.ttyname(self._slave)
        self.sequence = 0
        self.process = subprocess.Popen(
            [*COMMAND, self.path, *options],
            cwd=ROOT,
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        )
        self._deadline = threading.Timer(limit_s(60), self.process.kill)
        self._deadline.start()
        self._wait_until_it_listens()

    def _wait_until_it_listens(self) -> None:
        """It throws away what came before it opened the port: says hello until it answers."""
        assert self.process.stdout is not None
        while not select.select([self.process.stdout], [], [], 0.05)[0]:
            self.sequence += 1
            os.write(self._master, encode(HELLO, self.sequence))

    def send(self, *frames: bytes) -> None:
        os.write(self._master, b"".join(frames))

    def lines(self, count: int) -> list[str]:
        """The next lines that are no hello."""
        assert self.process.stdout is not None
        found: list[str] = []
        while len(found) < count:
            line = self.process.stdout.readline()
            assert line, "the monitor ended"
            if "starting" not in line:
                found.append(line)
        return found

    def end(self, signal_number: int | None = None) -> tuple[int, list[str]]:
        """Exit status and the lines on standard error."""
        if signal_number is not None:
            self.process.send_signal(signal_number)
        _, errors = self.process.communicate(timeout=limit_s())
        return self.process.returncode, errors.splitlines()

    def close(self) -> None:
        self._deadline.cancel()
        self.process.kill()
        self.process.communicate()
        self.hang_up()

    def hang_up(self) -> None:
        for fd in (self._slave, self._master):
            with suppress(OSError):
                os.close(fd)


@pytest.fixture
def monitored(request: pytest.FixtureRequest) -> Iterator[Monitored]:
    monitor = Monitored(*getattr(request, "param", ()))
    yield monitor
    monitor.close()


@pytest.mark.slow
def test_text_lines_show_what_matters(monitored: Monitored) -> None:
    """A marker, a fix, a status with its reason, a state with what it rests on."""
    chosen = {v.name: v for v in VECTORS}
    names = ("marker", "marker, uncalibrated", "fix", "status", "state", "state, there is none", "time, asked")
    monitored.send(*(chosen[name].frame for name in names))
    marker, uncalibrated, fix, status, state, none, asked = monitored.lines(7)
    assert state.startswith(
        "state       xy +12.3456 -7.8901 ± 0.0064 0.0080 m  yaw -85.94 ± 0.18°  +0.512 m/s -14.3°/s"
    )
    assert state.endswith("by odometry, panels 5, the newest 85 ms ago\n")
    assert (none, asked) == ("state       none\n", "time_ask\n")
    assert marker.startswith("marker    7  xyz +0.1234 -0.0500 +2.0000 ± 0.0012 0.0031 0.0100 m  wxyz +0.60")
    assert "no pose" in uncalibrated
    assert "uncalibrated" in uncalibrated
    assert "heading -73.7°  panels 2  age 16.7 ms" in fix
    assert "running, no fix: no panel is in view" in status


@pytest.mark.slow
def test_the_summary_counts_lost_and_bad_packets(monitored: Monitored) -> None:
    """Two numbers are missing, a frame is damaged; Ctrl-C ends it with status 0."""
    status = StatusMessage(state=State.RUNNING, no_fix=NoFix.NO_PANEL)
    last = monitored.sequence
    damaged = bytearray(encode(status, last))
    damaged[8] ^= 1
    whole = [encode(status, last + n) for n in (1, 4, 5)]
    monitored.send(whole[0], whole[1], bytes(damaged), whole[2])
    monitored.lines(3)
    code, errors = monitored.end(signal.SIGINT)
    assert code == 0
    assert errors[-1].endswith(" packets, 2 lost, 1 bad (crc 1)")


@pytest.mark.slow
def test_sigterm_ends_it_as_ctrl_c_does(monitored: Monitored) -> None:
    """A script's background job cannot be sent Ctrl-C."""
    code, errors = monitored.end(signal.SIGTERM)
    assert code == 0
    assert " packets, 0 lost, 0 bad" in errors[-1]


@pytest.mark.slow
def test_a_hang_up_ends_it_cleanly(monitored: Monitored) -> None:
    """The other end of the pty is gone: said so, summary, status 0, no traceback."""
    monitored.hang_up()
    code, errors = monitored.end()
    assert code == 0
    assert errors[0] == f"{monitored.path}: the other end hung up"
    assert " packets, 0 lost, 0 bad" in errors[1]
    assert len(errors) == 2


@pytest.mark.slow
def test_it_ends_after_the_given_time() -> None:
    """A silent line: no output, a summary."""
    master, slave = os.openpty()
    done = run(os.ttyname(slave), "--seconds", "0.2")
    os.close(master)
    os.close(slave)
    assert (done.returncode, done.stdout) == (0, "")
    assert done.stderr == "0 packets, 0 lost, 0 bad\n"


@pytest.mark.slow
@pytest.mark.parametrize(
    ("port", "why"),
    [("/dev/no-such-port", "no such file or directory"), (str(ROOT / "pyproject.toml"), "not a serial port")],
    ids=["absent", "a file"],
)
def test_a_port_that_cannot_be_opened_is_one_line_and_status_2(port: str, why: str) -> None:
    """The port, what is wrong with it, and no traceback."""
    done = run(port)
    assert (done.returncode, done.stdout) == (2, "")
    assert done.stderr == f"ledpi: {port}: cannot be opened: {why}\n"


@pytest.mark.slow
def test_mavlink_is_named_and_status_2() -> None:
    """Not shown as so many bad packets: one frame of MAVLink 2 after another tells."""
    heartbeat = bytes.fromhex("fd 09 00 00 00 01 c4 00 00 00 00 00 00 00 12 08 00 04 03 5c 4b")
    master, slave = os.openpty()
    tty.setraw(master)
    process = subprocess.Popen([*COMMAND, os.ttyname(slave)], cwd=ROOT, text=True, stderr=subprocess.PIPE)
    while process.poll() is None:
        os.write(master, heartbeat)
        time.sleep(0.05)
    assert process.stderr is not None
    (line,) = process.stderr.read().splitlines()
    process.stderr.close()
    os.close(master)
    os.close(slave)
    assert process.returncode == 2
    assert "carries MAVLink" in line
    assert "serial.protocol: ledpi" in line


def test_of_a_daemon_it_asks_why_a_panel_is_not_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Twice a second, and the table ends with it."""
    monkeypatch.setitem(HEALTH, "decoded_per_s", 30.0)
    monkeypatch.setitem(HEALTH, "frames", 9)
    daemon = MadeUpDaemon(tmp_path / "tap.sock", hello=LARGE)
    beside = [[400.0, 100.0], [500.0, 100.0], [500.0, 200.0], [400.0, 200.0]]
    daemon.extra = {"rejected": [{"corners_px": beside, "why": "identify.not_in_dictionary"}]}
    status, said, _ = in_process(monkeypatch, capsys, "monitor")("--tap", tmp_path / "tap.sock", "--seconds", "1")
    daemon.close()
    assert status == 0
    assert "panel at 450, 150 is not read" in said
    assert 1 <= len(daemon.asked("picture")) <= 3
