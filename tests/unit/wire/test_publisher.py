"""The publisher on a real pty: what reaches the other end, whatever the port does."""

from __future__ import annotations

import fcntl
import itertools
import os
import select
import statistics
import subprocess
import sys
import termios
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import pytest

from ledpi.config.settings import SerialSettings
from ledpi.core.errors import WireError
from ledpi.core.linux import who_holds
from ledpi.wire import FixMessage, MarkerMessage, Message, NoFix, Receiver, State, StatusMessage
from ledpi.wire.codec import DELIMITER, encode
from ledpi.wire.line import SerialLine, listening
from ledpi.wire.publisher import Publisher
from tests.builders.waiting import wait_until
from tests.builders.wire import decoded_now


class FarEnd:
    """The motor controller's end of a pty."""

    def __init__(self) -> None:
        self._master, self._slave = os.openpty()  # the slave is held, or the master could not be read before
        tty.setraw(self._master)
        os.set_blocking(self._master, False)
        self.path = os.ttyname(self._slave)
        self.receiver = Receiver()
        self.messages: list[Message] = []
        self.arrived_ns: list[int] = []

    def read(self, seconds: float) -> bool:
        """Takes in what comes, for at most that long, and tells whether anything did."""
        comes = bool(select.select([self._master], [], [], seconds)[0])
        if comes:
            for message in self.receiver.feed(os.read(self._master, 4096)):
                self.messages.append(message)
                self.arrived_ns.append(time.monotonic_ns())
        return comes

    def read_until(self, condition: Callable[[], bool]) -> None:
        """Takes in what comes until the condition holds."""
        wait_until(condition, meanwhile=lambda: self.read(0.02))

    def of(self, kind: type[Message]) -> list[Message]:
        return [message for message in self.messages if isinstance(message, kind)]

    def marker_ids(self) -> list[int]:
        return [message.id for message in self.messages if isinstance(message, MarkerMessage)]

    def say(self, data: bytes) -> None:
        """Writes to the daemon."""
        os.write(self._master, data)

    def fileno(self) -> int:
        return self._slave

    def is_full(self) -> bool:
        return not select.select([], [self._slave], [], 0)[1]

    def unplug(self) -> None:
        for fd in (self._master, self._slave):
            with suppress(OSError):
                os.close(fd)


@pytest.fixture
def far_end() -> Iterator[FarEnd]:
    end = FarEnd()
    yield end
    end.unplug()


@pytest.fixture
def start() -> Iterator[Callable[..., Publisher]]:
    """Starts publishers and stops them after the test. No pose grows too old, unless a test says when."""
    started = []

    def start(port: str | Path, **settings: Any) -> Publisher:
        publisher = Publisher(SerialSettings(port=str(port), **{"max_age_ms": 60_000.0} | settings))
        publisher.start()
        started.append(publisher)
        return publisher

    yield start
    for publisher in started:
        publisher.stop()


def publisher_threads() -> list[threading.Thread]:
    return [thread for thread in threading.enumerate() if thread.name == "publisher"]


def jam(publisher: Publisher, far_end: FarEnd) -> None:
    """Publishes without reading, until the port's buffer is full and poses are replaced where they wait."""
    numbers = itertools.count()
    wait_until(
        lambda: far_end.is_full() and publisher.counters.replaced >= 100,
        "a full port",
        lambda: publisher.publish(decoded_now(next(numbers) % 50)),
    )


Start = Callable[..., Publisher]


def test_the_age_runs_from_mid_exposure_to_the_first_byte(far_end: FarEnd, start: Start) -> None:
    """Not less than when it was handed over, not more than when it had arrived."""
    publisher = start(far_end.path)
    far_end.read_until(lambda: len(far_end.messages) >= 1)
    mid_ns = time.monotonic_ns() - 30_000_000
    publisher.publish(decoded_now(fix=True, age_ms=30.0))
    far_end.read_until(lambda: len(far_end.of(FixMessage)) >= 1)
    arrived_ns = far_end.arrived_ns[far_end.messages.index(far_end.of(FixMessage)[0])]
    fix = far_end.of(FixMessage)[0]
    assert isinstance(fix, FixMessage)
    status_and_zero_us = (41 + 1) * 10 / 115200 * 1e6
    assert 30_000 <= fix.age_us <= (arrived_ns - mid_ns) / 1000 + status_and_zero_us


def test_the_age_counts_the_making_of_the_packet(
    far_end: FarEnd, start: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The clock is read before: on a computer that then takes 5 ms, no packet says that it left before it was made."""

    def slowly(message: Message, sequence: int) -> bytes:
        time.sleep(0.005)
        return encode(message, sequence)

    monkeypatch.setattr("ledpi.wire.publisher.encode", slowly)
    publisher, took_us = start(far_end.path), []
    far_end.read_until(lambda: len(far_end.messages) >= 1)
    for n in range(20):
        mid_ns = time.monotonic_ns() - 30_000_000
        publisher.publish(decoded_now(n, age_ms=30.0))
        far_end.read_until(lambda n=n: n in far_end.marker_ids())  # type: ignore[misc]
        took_us.append((far_end.arrived_ns[-1] - mid_ns) / 1000 - 30_000)
    last = far_end.of(MarkerMessage)[-1]
    assert isinstance(last, MarkerMessage)
    # What is expected of the making is what others before have taken.
    assert 35_000 <= last.age_us <= 30_000 + took_us[-1] + max(took_us)


def test_the_age_counts_the_bytes_that_have_not_left(far_end: FarEnd, start: Start) -> None:
    """At 9600 baud a packet and its zero take 42.7 ms: each of a frame's markers is that much older than the last."""
    publisher = start(far_end.path, baud=9600, max_age_ms=1000.0)
    far_end.read_until(lambda: len(far_end.messages) >= 1)
    publisher.publish(decoded_now(1, 2, 3, 4))
    far_end.read_until(lambda: len(far_end.marker_ids()) >= 4)
    ages_us = [message.age_us for message in far_end.messages if isinstance(message, MarkerMessage)]
    packet_us = 41 * 10 / 9600 * 1e6
    assert all(later - earlier >= packet_us - 1 for earlier, later in itertools.pairwise(ages_us))


def test_a_heartbeat_comes_at_least_five_times_a_second(far_end: FarEnd, start: Start) -> None:
    """Even when nothing is seen; the first at once, saying "starting"."""
    start(far_end.path)
    far_end.read_until(lambda: len(far_end.messages) >= 10)
    assert all(isinstance(message, StatusMessage) for message in far_end.messages)
    first = far_end.messages[0]
    assert isinstance(first, StatusMessage)
    assert (first.state, first.no_fix) == (State.STARTING, NoFix.NOT_RUNNING)
    gaps_s = [(b - a) / 1e9 for a, b in itertools.pairwise(far_end.arrived_ns)]
    assert statistics.median(gaps_s) <= 0.2


def test_a_stale_pose_is_never_written(far_end: FarEnd, start: Start) -> None:
    """It is counted; a fresh one after it arrives."""
    publisher = start(far_end.path, max_age_ms=1000.0)
    far_end.read_until(lambda: len(far_end.messages) >= 1)
    publisher.publish(decoded_now(7, fix=True, age_ms=1500.0))
    wait_until(lambda: publisher.counters.stale == 2)
    publisher.publish(decoded_now(8))
    far_end.read_until(lambda: far_end.marker_ids() == [8])
    assert far_end.of(FixMessage) == []


def test_what_was_on_the_line_before_costs_no_packet(far_end: FarEnd, start: Start) -> None:
    """The first byte is a delimiter: half a frame of an earlier sender does not swallow our first one."""
    far_end.receiver.feed(b"\0\x05\x01\x01")
    publisher = start(far_end.path)
    far_end.read_until(lambda: len(far_end.messages) >= 2)
    wait_until(lambda: publisher.counters.statuses >= 2)
    assert far_end.receiver.counters.bad == {"cobs": 1}


def test_an_absent_port_is_waited_for(far_end: FarEnd, start: Start, tmp_path: Path) -> None:
    """The daemon starts without it, says why, and sends when it is there: nothing old, everything new."""
    port = tmp_path / "controller"
    publisher = start(port)
    publisher.publish(decoded_now(7, fix=True))
    wait_until(lambda: publisher.counters.error is not None)
    assert publisher.counters.error == f"{port}: cannot be opened: no such file or directory"
    port.symlink_to(far_end.path)
    far_end.read_until(lambda: len(far_end.messages) >= 1)
    counters = publisher.counters
    assert counters.connected
    assert counters.error is None
    publisher.publish(decoded_now(8))
    far_end.read_until(lambda: far_end.marker_ids() != [])
    assert far_end.marker_ids() == [8]
    assert far_end.of(FixMessage) == []


def test_a_lost_port_is_found_again(start: Start, tmp_path: Path) -> None:
    """Unplugged while sending, plugged in under the same name: the numbers go on, nothing old is sent.

    Who publishes just then, and meets the loss, goes on as if nothing had happened.
    """
    port, first, second = tmp_path / "controller", FarEnd(), FarEnd()
    port.symlink_to(first.path)
    publisher = start(port)
    first.read_until(lambda: len(first.messages) >= 2)
    first.unplug()
    publisher.publish(decoded_now(3))
    wait_until(lambda: not publisher.counters.connected)
    assert (publisher.counters.markers, publisher.failure) == (0, None)
    assert publisher.counters.error is not None
    publisher.publish(decoded_now(7))
    port.unlink()
    port.symlink_to(second.path)
    second.read_until(lambda: len(second.messages) >= 2)
    publisher.publish(decoded_now(8))
    second.read_until(lambda: second.marker_ids() != [])
    assert second.marker_ids() == [8]
    assert publisher.counters.opened == 2
    assert second.receiver.counters.restarts == 0
    second.unplug()


def test_a_receiver_that_does_not_read_costs_packets_but_no_time(far_end: FarEnd, start: Start) -> None:
    """The port's buffer fills; from then on poses are dropped and counted. Reading again, new ones arrive."""
    publisher = start(far_end.path, baud=4_000_000, max_age_ms=500.0)
    jam(publisher, far_end)
    assert publisher.counters.connected
    time.sleep(0.55)  # what waits grows older than max_age_ms
    assert publisher.counters.cut <= 2  # a full port is not written to: what waits stays to be replaced
    far_end.read_until(lambda: publisher.counters.stale > 0)
    publisher.publish(decoded_now(1000))
    far_end.read_until(lambda: 1000 in far_end.marker_ids())
    bad = far_end.receiver.counters.bad
    assert sum(bad.values()) <= publisher.counters.cut  # a packet that was cut short is all that can be bad


def test_a_pose_is_on_a_free_line_when_publish_returns(far_end: FarEnd, start: Start) -> None:
    """The decode worker writes it itself; what is left follows by the publisher's thread."""
    publisher = start(far_end.path)

    def is_written_at_once() -> bool:
        while far_end.read(0.03):
            pass  # until the line is quiet
        before = publisher.counters.fixes
        publisher.publish(decoded_now(3, 7, fix=True))
        return publisher.counters.fixes > before

    # Its thread may have taken the line for a status just then.
    assert any(is_written_at_once() for _ in range(20))
    far_end.read_until(lambda: far_end.marker_ids()[-2:] == [3, 7])


def test_a_write_never_waits(far_end: FarEnd) -> None:
    """Cuts the packet where a port has no room after all; the next one begins with a delimiter."""
    line = SerialLine(far_end.path, 115200, ahead=DELIMITER)
    packet = encode(StatusMessage(state=State.RUNNING, no_fix=NoFix.NO_PANEL), 1)
    whole = len(list(itertools.takewhile(lambda written: written, (line.write(packet) for _ in itertools.count()))))
    assert whole > 1
    far_end.read_until(lambda: len(far_end.messages) >= whole)
    assert line.write(packet)
    far_end.read_until(lambda: len(far_end.messages) == whole + 1)
    assert sum(far_end.receiver.counters.bad.values()) <= 1
    line.close()


def test_what_the_kernel_still_queues_is_waited_for(far_end: FarEnd, monkeypatch: pytest.MonkeyPatch) -> None:
    """One packet at most waits there; it is asked once after each. (A pty's own queue is always empty.)"""
    line, queued = SerialLine(far_end.path, 9600, clock=lambda: 0), iter([40, 0, 0])
    monkeypatch.setattr("serial.Serial.out_waiting", property(lambda _: next(queued)))
    assert line.busy_ns(0) == pytest.approx(40 * 10 / 9600 * 1e9, abs=1)
    assert [line.busy_ns(0), line.busy_ns(0)] == [0, 0]
    line.write(bytes(40))
    assert line.busy_ns(0) > 0
    assert next(queued, None) is None
    monkeypatch.undo()
    line.close()


def test_stop_sends_a_last_status(far_end: FarEnd, start: Start) -> None:
    """The last message of all, after which the thread is gone."""
    publisher = start(far_end.path)
    publisher.set_status(StatusMessage(state=State.RUNNING, no_fix=NoFix.NO_PANEL, frames=99))
    far_end.read_until(lambda: len(far_end.messages) >= 2)
    publisher.stop()
    assert publisher_threads() == []
    far_end.read_until(lambda: isinstance(m := far_end.messages[-1], StatusMessage) and m.state is State.STOPPING)
    last = far_end.messages[-1]
    assert isinstance(last, StatusMessage)
    assert (last.no_fix, last.frames) == (NoFix.NOT_RUNNING, 99)
    assert far_end.receiver.counters.lost == 0
    assert not publisher.counters.connected


def test_stop_ends_in_any_state(far_end: FarEnd, start: Start, tmp_path: Path) -> None:
    """In the middle of a back-off, never started, stopped before; with a last status that has no room."""
    waiting, jammed = start(tmp_path / "nothing"), start(far_end.path, baud=4_000_000)
    wait_until(lambda: waiting.counters.error is not None)
    jam(jammed, far_end)
    for publisher in (waiting, waiting, jammed, Publisher(SerialSettings(port="nothing"))):
        publisher.stop()
    assert publisher_threads() == []


@pytest.mark.parametrize(
    ("path", "reason"),
    [
        ("pyproject.toml", "not a serial port"),
        ("tests", "is a directory"),
        ("/dev/ptmx", "not a serial port"),  # each that opens it gets a terminal, at whose other end nobody reads
    ],
)
def test_a_port_that_is_none_is_reported_in_one_line(start: Start, path: str, reason: str) -> None:
    """The error is there for the health line; the daemon goes on."""
    publisher = start(path)
    wait_until(lambda: publisher.counters.error is not None)
    assert publisher.counters.error == f"{path}: cannot be opened: {reason}"


# ---- The port is ours


@contextmanager
def another_program(code: str, port: str) -> Iterator[subprocess.Popen[bytes]]:
    """Python without ledpi and pyserial, as any program: it has `port` open, and has said so."""
    opens = "import fcntl, os, sys, time; port = os.open(sys.argv[1], os.O_RDWR | os.O_NOCTTY); "
    command = [sys.executable, "-c", f"{opens}{code}", port]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        yield process
        process.kill()


HOLDS = "print(flush=True); sys.stdin.read()"
LOCKS = f"fcntl.flock(port, fcntl.LOCK_EX); {HOLDS}"
WRITES = "print(flush=True); [(os.write(port, bytes({octets})), time.sleep(0.003)) for _ in iter(int, 1)]"


def test_a_port_that_another_process_holds_is_waited_for(far_end: FarEnd, start: Start) -> None:
    """Two writers would spoil each other's frames; who it is, and how to stop it, is said."""
    with another_program(LOCKS, far_end.path) as other:
        publisher = start(far_end.path)
        wait_until(lambda: publisher.counters.error is not None)
        error = str(publisher.counters.error)
    assert error.startswith(f"{far_end.path}: cannot be opened: in use by another process, held by python")
    assert f"(process {other.pid}); stop it with: sudo " in error
    far_end.read_until(lambda: len(far_end.messages) >= 1)


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root, to be another user")
def test_nobody_else_may_open_it(far_end: FarEnd) -> None:
    """By TIOCEXCL: other programs need not know of it, as they must of a lock. Closed, it is free again."""
    os.chmod(far_end.path, 0o666)

    def refused() -> bool:
        command = ["head", "-c", "0", far_end.path]
        done = subprocess.run(command, user=65534, env={"LC_ALL": "C"}, capture_output=True, text=True, check=False)
        assert done.stderr == "" or "Device or resource busy" in done.stderr
        return done.returncode != 0

    line = SerialLine(far_end.path, 115200)
    assert refused()
    line.close()
    assert not refused()


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root, to be another user")
def test_a_holder_that_cannot_be_seen_is_to_be_looked_for(far_end: FarEnd) -> None:
    """Another user's, as the service sees it: how to find out is said."""
    os.chmod(far_end.path, 0o666)
    fcntl.ioctl(far_end.fileno(), termios.TIOCEXCL)
    who_holds(far_end.path)  # what it imports, the other user might not be able to read
    child = os.fork()
    if child == 0:
        os.setuid(65534)
        try:
            SerialLine(far_end.path, 115200)
        except WireError as error:
            os._exit(0 if f"in use by another process, which `sudo fuser -v {far_end.path}` names" in str(error) else 1)
        os._exit(2)
    assert os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == 0


def test_closing_it_resets_no_controller(far_end: FarEnd) -> None:
    """With HUPCL, DTR would fall, and rise when the port is opened again: an Arduino's reset."""
    line = SerialLine(far_end.path, 115200)
    line.close()
    assert not termios.tcgetattr(far_end.fileno())[2] & termios.HUPCL


def test_who_else_has_it_open_is_named_once(
    far_end: FarEnd, start: Start, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One that was there before, for which TIOCEXCL comes too late."""
    monkeypatch.setattr("ledpi.wire.line.OTHERS_EVERY_S", 0.0)
    with another_program(HOLDS, far_end.path) as other:
        publisher = start(far_end.path)
        wait_until(lambda: publisher.counters.connected)
        for _ in range(3):
            publisher.name_others()
    (named,) = [entry.getMessage() for entry in caplog.records if entry.levelname == "WARNING"]
    assert named.startswith(f'serial_shared port={far_end.path} with="python')
    assert f"(process {other.pid}); stop it with: sudo " in named


@pytest.mark.slow
@pytest.mark.parametrize("octets", [b"AT\r\n", b"\0"])
def test_foreign_bytes_cost_no_packet(far_end: FarEnd, start: Start, octets: bytes) -> None:
    """A zero is on either side of each frame: what another program writes in between is a bad frame of its own."""
    with another_program(WRITES.format(octets=list(octets)), far_end.path):
        publisher = start(far_end.path, baud=4_000_000)
        until = time.monotonic() + 1.0
        while time.monotonic() < until:
            publisher.publish(decoded_now(7, fix=True))
            far_end.read(0.004)
        publisher.stop()
        sent = publisher.counters.sent
        far_end.read_until(lambda: len(far_end.messages) >= sent)
    counters = far_end.receiver.counters
    assert (counters.lost, counters.restarts, counters.good) == (0, 0, sent)
    assert (sum(counters.bad.values()) > 0) is (octets != b"\0")


def test_without_a_port_nothing_is_opened_or_kept() -> None:
    """`serial.port: null`: poses go to the tap alone, and none counts as lost."""
    publisher = Publisher(SerialSettings(port=None))
    publisher.start()
    publisher.publish(decoded_now(7))
    publisher.stop()
    assert (publisher.counters.opened, publisher.counters.sent, publisher.counters.unsent) == (0, 0, 0)


def test_a_mistake_in_hearing_does_not_end_it(far_end: FarEnd, caplog: pytest.LogCaptureFixture) -> None:
    """It is told once, and the next is heard."""
    heard = []

    def hear(data: bytes, now_ns: int) -> None:
        heard.append(data)
        if b"x" in data:
            raise OverflowError("of ours")

    line = SerialLine(far_end.path, 115200)
    with listening(line, hear):
        for count, said in enumerate((b"x", b"x", b"more"), start=1):
            far_end.say(said)
            wait_until(lambda count=count: len(heard) >= count)
    line.close()
    assert b"".join(heard) == b"xxmore"
    assert [record.message for record in caplog.records].count("ear_failed error=\"OverflowError('of ours')\"") == 1
