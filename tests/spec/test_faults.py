"""Promises of docs/faults.md: the unmodified daemon on a recording, a pty for the controller, and what goes wrong.

Every packet of every test here is looked at for its age.
"""

from __future__ import annotations

import itertools
import os
import random
import re
import select
import signal
import socket
import subprocess
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from ledpi.config.settings import load_config
from ledpi.core.records import Frame, Pixels
from ledpi.daemon.daemon import Daemon
from ledpi.wire import FixMessage, MarkerMessage, Message, Receiver, State, StatusMessage
from tests.builders.daemon import (
    COMMAND,
    MAX_AGE_US,
    ROOT,
    OtherCamera,
    daemon,
    daemon_in_thread,
    end,
    slowness,
    write_recording,
)
from tests.builders.imports import RUN, file_of, reached_from
from tests.builders.waiting import wait_until

alone = pytest.mark.alone  # it tells how late a daemon is: no other test may take the processor meanwhile

BYTE_S = 10 / 115200
BACK_S = 1.0  # promised after a line is there again; a busy machine gets as much more as it is slower
PAGE = ROOT / "docs" / "faults.md"


class Line:
    """A pty that stands for the controller's end: read when the test says so, unplugged when it says so."""

    def __init__(self) -> None:
        self._master, self._slave = os.openpty()
        tty.setraw(self._master)
        os.set_blocking(self._master, False)
        self.path = os.ttyname(self._slave)
        self.receiver = Receiver()
        self.messages: list[Message] = []
        self._plugged = True

    def read(self, count: int = 65536, seconds: float = 0.02) -> list[Message]:
        """Reads what came by now, or comes within that time. Looks at each packet's age."""
        if not select.select([self._master], [], [], seconds)[0]:
            return []
        new = self._checked(self.receiver, os.read(self._master, count))
        self.messages += new
        return new

    def _checked(self, receiver: Receiver, data: bytes) -> list[Message]:
        """Returns what these bytes complete; no pose of it is older than allowed."""
        new = receiver.feed(data)
        for message in new:
            assert not isinstance(message, MarkerMessage | FixMessage) or message.age_us <= MAX_AGE_US
        return new

    def read_until(self, enough: Callable[[], bool]) -> None:
        """With what is there once it is enough."""
        wait_until(enough, meanwhile=self.read)
        while select.select([self._master], [], [], 0.0)[0]:
            self.read()

    def read_for(self, seconds: float) -> None:
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self.read()

    def wait_for_markers(self, count: int) -> None:
        """Reads until so many have come from now on."""
        came: list[Message] = []

        def read() -> None:
            came.extend(message for message in self.read() if isinstance(message, MarkerMessage))

        wait_until(lambda: len(came) >= count, f"{count} markers", read)

    def throw_away(self) -> None:
        """As a receiver should after a pause, see docs/wire.md; but not unseen."""
        receiver = Receiver()
        with suppress(BlockingIOError):
            while data := os.read(self._master, 65536):
                self._checked(receiver, data)

    def unplug(self) -> None:
        if self._plugged:
            self.throw_away()
            self._plugged = False
            os.close(self._master)
            os.close(self._slave)


@pytest.fixture
def plug(tmp_path: Path) -> Iterator[Callable[[], Line]]:
    """Each call plugs a new line in, under the same name."""
    port, lines = tmp_path / "controller", []

    def plug_in() -> Line:
        lines.append(Line())
        port.unlink(missing_ok=True)
        port.symlink_to(lines[-1].path)
        return lines[-1]

    yield plug_in
    for line in lines:
        line.unplug()


@pytest.fixture(scope="module")
def take(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A panel 1 m ahead, for a second; replayed again and again."""
    folder = tmp_path_factory.mktemp("faults") / "take"
    write_recording(folder, 60)
    return folder


def settings(take: Path, tmp_path: Path) -> tuple[str, ...]:
    return (f"camera.source=recording:{take}", f"serial.port={tmp_path / 'controller'}")


FOR_EVER = ("--frames", "1000000")


@pytest.mark.slow
@alone
def test_unplugged_and_plugged_in_again(take: Path, tmp_path: Path, plug: Callable[[], Line]) -> None:
    """Twice, in the middle of packets: the stream is back in a second, whole, and with nothing that waited."""
    line = plug()
    with daemon(*settings(take, tmp_path), options=FOR_EVER) as process:
        for _ in range(2):
            line.wait_for_markers(3)
            line.unplug()
            time.sleep(0.05)
            line = plug()
            back = time.monotonic()
            line.wait_for_markers(1)
            assert time.monotonic() - back < BACK_S * slowness()
        line.wait_for_markers(3)
        assert line.receiver.counters.bad == {}
        assert line.receiver.counters.lost == 0
        line.read_for(0.1)
        process.send_signal(signal.SIGTERM)
        line.read_for(0.5)
        assert end(process).status == 0
    assert isinstance(line.messages[0], StatusMessage)  # what a port gets first, so that its end knows where it is


@pytest.mark.slow
def test_the_port_becomes_something_else(take: Path, tmp_path: Path, plug: Callable[[], Line]) -> None:
    """A name that leads to no serial port for a while is waited out; each state is one line in the log."""
    line = plug()
    with daemon(*settings(take, tmp_path), options=FOR_EVER) as process:
        line.wait_for_markers(2)
        port = tmp_path / "controller"
        port.unlink()
        port.write_text("no port")
        line.unplug()
        time.sleep(0.8)
        plug().wait_for_markers(2)
        ended = end(process, signal.SIGTERM)
    assert ended.status == 0
    said = [entry for entry in ended.log if "serial_" in entry]
    assert sum("not a serial port" in entry for entry in said) == 1
    assert sum("serial_open" in entry for entry in said) == 2


@pytest.mark.slow
@alone
def test_a_receiver_that_stops_reading(take: Path, tmp_path: Path, plug: Callable[[], Line]) -> None:
    """Decoding goes on; when it reads again, and has thrown away what piled up, what comes is new."""
    line = plug()
    with daemon(*settings(take, tmp_path), options=FOR_EVER) as process:
        line.wait_for_markers(2)
        time.sleep(3.0)  # more than a pty holds at this rate, and counters of two seconds
        line.throw_away()
        line.receiver = Receiver()
        line.wait_for_markers(5)
        ended = end(process, signal.SIGTERM)
    assert ended.status == 0
    decoded = [int(n) for entry in ended.log for n in re.findall(r"(\d+) decoded/s", entry)]
    assert min(decoded[1:]) > 0  # the first second is the start's


@pytest.mark.slow
@alone
def test_a_receiver_as_fast_as_the_line(take: Path, tmp_path: Path, plug: Callable[[], Line]) -> None:
    """It takes 11,520 bytes a second and not one more: no packet is damaged, none is lost."""
    line = plug()
    with daemon(*settings(take, tmp_path), options=FOR_EVER) as process:
        line.wait_for_markers(1)
        due, until = time.monotonic(), time.monotonic() + 1.5
        while time.monotonic() < until:
            line.read(40, seconds=0.0)
            due = max(due + 40 * BYTE_S, time.monotonic() - 0.05)
            time.sleep(max(0.0, due - time.monotonic()))
        assert end(process, signal.SIGTERM).status == 0
    assert any(isinstance(message, MarkerMessage) for message in line.messages)
    assert (line.receiver.counters.bad, line.receiver.counters.lost) == ({}, 0)


@pytest.mark.slow
def test_corrupted_frames(take: Path, tmp_path: Path, plug: Callable[[], Line]) -> None:
    """A tenth of the pictures are broken, each in another way: no ID but the right one, and the others are sent."""
    rng = random.Random(8)
    damaged = tmp_path / "damaged"
    write_recording(damaged, 60)
    for picture in rng.sample(sorted((damaged / "frames").iterdir()), 6):
        content = bytearray(picture.read_bytes())
        match rng.randrange(3):
            case 0:
                del content[rng.randrange(len(content)) :]
            case 1:
                content[rng.randrange(8, len(content))] ^= 0xFF
            case _:
                content[:] = b""
        picture.write_bytes(content)
    line = plug()
    with daemon(*settings(damaged, tmp_path), options=FOR_EVER) as process:
        line.wait_for_markers(40)
        ended = end(process, signal.SIGTERM)
    assert {message.id for message in line.messages if isinstance(message, MarkerMessage)} == {7}
    assert ended.status == 0
    assert "capture." in ended.log[-1]


def test_sigterm_at_any_moment(take: Path, tmp_path: Path, plug: Callable[[], Line]) -> None:
    """From the first instruction on: no traceback; once it has said that it runs, exit status 0."""
    rng = random.Random(9)
    plug()
    for delay_s in [rng.uniform(0.0, 1.2) for _ in range(4)]:
        with daemon(*settings(take, tmp_path), options=FOR_EVER) as process:
            time.sleep(delay_s)
            ended = end(process, signal.SIGTERM)
        running = any("INFO start" in entry for entry in ended.log)
        assert ended.status == 0 or (ended.status == -signal.SIGTERM and not running)
        assert not any("Traceback" in entry for entry in ended.log)


@pytest.mark.slow
def test_nobody_takes_its_log(take: Path, tmp_path: Path, plug: Callable[[], Line]) -> None:
    """A pager that waits, a terminal that was stopped with Ctrl-S: the heartbeat goes on, and SIGTERM ends it."""
    line, (reads, writes) = plug(), os.pipe()
    os.set_blocking(writes, False)
    with suppress(BlockingIOError):
        while os.write(writes, bytes(1024)):
            pass
    os.set_blocking(writes, True)  # as the daemon has it
    given = [part for setting in settings(take, tmp_path) for part in ("--set", setting)]
    with subprocess.Popen([*COMMAND, *FOR_EVER, *given], cwd=ROOT, stderr=writes) as process:
        try:
            line.wait_for_markers(10)
            line.read_for(2.0)  # in each second it would say something
            seen = len(line.messages)
            line.read_until(lambda: sum(isinstance(message, StatusMessage) for message in line.messages[seen:]) > 3)
            process.send_signal(signal.SIGTERM)
            line.read_until(lambda: process.poll() is not None)
            assert process.returncode == 0
        finally:
            process.kill()
            os.close(reads)
            os.close(writes)
    assert isinstance(line.messages[-1], StatusMessage)
    assert line.messages[-1].state is State.STOPPING


# In front of the daemon: a frame that takes as long as a robot's processor may need for the worst one.
SLOW_FRAME = """
import time, cv2, numpy as np
from ledpi.pipeline.pipeline import Pipeline
decode, picture = Pipeline.decode, np.zeros((1500, 1500), np.uint8)
def slowly(*arguments, **options):
    decoded, until_s = decode(*arguments, **options), time.monotonic() + 1.5 * (arguments[1].seq > 30)
    while time.monotonic() < until_s:
        cv2.GaussianBlur(picture, (0, 0), 3)
    return decoded
Pipeline.decode = slowly
"""


@pytest.mark.slow
def test_sigterm_while_a_frame_takes_long(take: Path, tmp_path: Path, plug: Callable[[], Line]) -> None:
    """Nobody waits for it; and C++ does not abort the process because of the thread that is in it."""
    line = plug()
    command = [*COMMAND[:2], SLOW_FRAME + COMMAND[2], *COMMAND[3:]]
    with daemon(*settings(take, tmp_path), options=FOR_EVER, command=command) as process:
        line.wait_for_markers(10)
        line.read_for(1.0)  # by now frame 31 has come
        process.send_signal(signal.SIGTERM)
        line.read_until(lambda: process.poll() is not None)
        ended = end(process)
    assert ended.status == 0
    assert "INFO ended: " in ended.log[-1]
    assert isinstance(line.messages[-1], StatusMessage)
    assert line.messages[-1].state is State.STOPPING


class Hanging(OtherCamera):
    """Its driver hangs once the test says so, and as it is closed as well."""

    def __init__(self) -> None:
        super().__init__()
        self.hangs, self.may_end = threading.Event(), threading.Event()

    def read(self, into: Pixels) -> Frame | None:
        if self.hangs.is_set():
            self.may_end.wait()
            return None
        return self._camera.read(into)

    def close(self) -> None:
        self.may_end.wait()


@pytest.mark.slow
def test_a_driver_that_hangs_does_not_keep_the_last_word(tmp_path: Path, plug: Callable[[], Line]) -> None:
    """It would hang until systemd's patience is over, 5 s after SIGTERM, and the controller would hear nothing."""
    line, camera = plug(), Hanging()
    config = load_config(None, ("panels.side_m=0.16", f"serial.port={tmp_path / 'controller'}"))
    running = Daemon(config, camera)  # not by daemon_in_thread, whose end would wait for the driver
    thread = threading.Thread(target=running.run, daemon=True)
    thread.start()
    line.wait_for_markers(3)
    camera.hangs.set()
    line.read_for(0.2)
    running.stop()
    line.read_until(lambda: not thread.is_alive())
    camera.may_end.set()
    assert isinstance(line.messages[-1], StatusMessage)
    assert line.messages[-1].state is State.STOPPING


@pytest.mark.slow
def test_killed_and_started_again(take: Path, tmp_path: Path, plug: Callable[[], Line]) -> None:
    """SIGKILL leaves no lock behind: the next one has the port, and its receiver counts a restart, no loss."""
    rng = random.Random(10)
    line = plug()
    for _ in range(3):
        with daemon(*settings(take, tmp_path), options=FOR_EVER) as process:
            line.wait_for_markers(2)
            line.read_for(rng.uniform(0.0, 0.1))
            process.kill()
            process.wait()
            line.read_for(0.05)
    with daemon(*settings(take, tmp_path), options=FOR_EVER) as process:
        line.wait_for_markers(2)
        assert end(process, signal.SIGTERM).status == 0
    assert line.receiver.counters.restarts == 3
    assert line.receiver.counters.lost == 0


class Stalling(OtherCamera):
    """The simulated camera, which after ten frames delivers nothing, raises nothing and does not return."""

    def __init__(self) -> None:
        super().__init__()
        self._frames = itertools.count()
        self._closed = threading.Event()

    def read(self, into: Pixels) -> Frame | None:
        if next(self._frames) >= 10:
            self._closed.wait()
            return None
        return self._camera.read(into)

    def close(self) -> None:
        self._closed.set()


def test_a_stall_starves_the_watchdog(
    tmp_path: Path, plug: Callable[[], Line], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Tells systemd nothing while no frame comes, and the controller that the camera is lost."""
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
    monkeypatch.setenv("WATCHDOG_USEC", "100000")
    monkeypatch.delenv("WATCHDOG_PID", raising=False)
    line = plug()
    config = load_config(None, ("panels.side_m=0.16", f"serial.port={tmp_path / 'controller'}"))
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.setblocking(False)
        with daemon_in_thread(config, Stalling()):
            line.read_until(
                lambda: any(isinstance(m, StatusMessage) and m.state is State.CAMERA_LOST for m in line.messages)
            )
            time.sleep(0.3)  # whatever was due when it stalled
            with suppress(BlockingIOError):
                while manager.recv(4096):
                    pass
            line.read_for(0.5)  # five times what the watchdog allows
            with pytest.raises(BlockingIOError):
                manager.recv(4096)


# ---- The page


def test_the_page_and_the_tests_agree() -> None:
    """Each row names a test that there is, and each test of a fault here has its row."""
    rows = re.findall(r"^\| .* \| `(tests/[\w/]+\.py)::(\w+)` \|$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert len(rows) >= 15
    for path, name in rows:
        assert f"\ndef {name}(" in (ROOT / path).read_text(encoding="utf-8"), f"{path}::{name}"
    here = set(re.findall(r"^def (test_\w+)", Path(__file__).read_text(encoding="utf-8"), re.MULTILINE))
    named = {name for path, name in rows if path == "tests/spec/test_faults.py"}
    assert here - named == {"test_the_page_and_the_tests_agree"}


# In front of the daemon: a time of day that is years off, each time it is asked for.
SET_CLOCK = """
import itertools, time
years = itertools.cycle([0.0, 3e8, -3e8])
time.time = lambda now=time.time: now() + next(years)
time.time_ns = lambda: int(time.time() * 1e9)
"""


@pytest.mark.slow
@alone
def test_a_clock_that_is_set_changes_nothing(take: Path, tmp_path: Path, plug: Callable[[], Line]) -> None:
    """By years, to and fro: the stream is whole, ages are true, status comes as often as ever."""
    line = plug()
    command = [*COMMAND[:2], SET_CLOCK + COMMAND[2], *COMMAND[3:]]
    with daemon(*settings(take, tmp_path), options=FOR_EVER, command=command) as process:
        line.wait_for_markers(1)
        line.read_until(lambda: sum(isinstance(message, StatusMessage) for message in line.messages) >= 3)
        assert end(process, signal.SIGTERM).status == 0
    assert (line.receiver.counters.bad, line.receiver.counters.lost) == ({}, 0)
    ages_us = [message.age_us for message in line.messages if isinstance(message, MarkerMessage)]
    assert min(ages_us) > 5_000  # half the exposure, at the very least


@pytest.mark.slow
def test_nothing_asks_for_the_time_of_day() -> None:
    """In all that `run` reaches, C's clocks included: times are of the monotonic clock. Only recordings have a date."""
    asking = re.compile(r"\btime\.time(_ns)?\(|datetime\.now|\butcnow\(|\blocaltime\(|CLOCK_REALTIME")
    modules = reached_from(RUN, stop_at="ledpi.cli")
    assert len(modules) > 30
    del modules["ledpi.daemon.takes"]  # names folders by it, and notes it in recordings, for ROS 2's bags
    for module in modules:
        path = file_of(module)
        assert path is not None
        assert asking.search(path.read_text(encoding="utf-8")) is None, module
