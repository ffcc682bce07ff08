"""The contract that every bridge keeps to, whatever it leads to: run by all kinds with real far ends.

A daemon's end of the tap shows a frame each 20 ms. Its panel's x holds the frame's number, in millimetres.
"""

from __future__ import annotations

import itertools
import json
import re
import socket
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.builders.bridges import MOSQUITTO, Far, Mqtt, Nt, Running, Stdout, Tcp, Udp, Zenoh, bridge
from tests.builders.made_up_daemon import MadeUpDaemon
from tests.builders.tap import Raw
from tests.builders.waiting import limit_s, wait_until

MAX_AGE_US = 100_000  # serial.max_age_ms
FIRST = 1000  # the number of the first frame
FAR_ENDS = {far.kind: far for far in (Stdout, Udp, Tcp, Mqtt, Nt, Zenoh)}
# What a far end had taken in before it was blocked is its own: it may read that late. By the time since it woke, in
# bytes of a stream's buffers at both ends, this many frames.
IN_ITS_BUFFERS = 60


@pytest.fixture(params=FAR_ENDS)
def far(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Far]:
    if request.param == "mqtt" and MOSQUITTO is None:
        pytest.skip("mosquitto is not installed")
    if request.param == "nt":
        pytest.importorskip("ntcore", reason="pyntcore is not installed (no wheel for this Python or machine)")
    if request.param == "zenoh":
        pytest.importorskip("zenoh", reason="eclipse-zenoh is not installed")
    end = FAR_ENDS[request.param](tmp_path)
    end.start()
    yield end
    end.close()


@pytest.fixture
def daemon(tmp_path: Path) -> Iterator[MadeUpDaemon]:
    made_up = MadeUpDaemon(tmp_path / "tap.sock", numbered=True, first=FIRST)
    yield made_up
    made_up.close()
    Raw.close_all()


@pytest.fixture
def running(far: Far, daemon: MadeUpDaemon, tmp_path: Path) -> Iterator[Running]:
    read = far.read if isinstance(far, Stdout) else None
    with bridge(far.settings, tmp_path / "tap.sock", tmp_path, read) as one:
        wait_until(lambda: len(far.frames) > 5)
        yield one


def frames_after(far: Far, since: int) -> list[tuple[int, int, int]]:
    """Waits for a few new ones."""
    wait_until(lambda: len(far.frames) > since + 5)
    return far.frames[since:]


def shows(daemon: MadeUpDaemon, frames: int) -> None:
    """Waits until it has shown so many more, however slow this machine is."""
    seen = daemon.last_seq
    wait_until(lambda: daemon.last_seq >= seen + frames)


@pytest.mark.slow
def test_a_far_end_that_vanishes_is_found_again_and_told_nothing_old(
    far: Far, running: Running, daemon: MadeUpDaemon
) -> None:
    """Frames of the meantime are counted, and gone for good."""
    if isinstance(far, Stdout):
        pytest.skip("a pipe cannot come back")
    losses, files = running.log.count("target_lost"), open_files(running.process.pid)
    far.vanish()
    first, before = far.frames[0][1], far.frames[-1][1]
    if not isinstance(far, Udp):  # which never knows
        wait_until(lambda: running.log.count("target_lost") > losses)  # by a lease's end, or with the next that is sent
    shows(daemon, 50)
    since, back_ns = len(far.frames), time.monotonic_ns()
    far.start()
    frames = frames_after(far, since)
    assert frames[0][1] > before + 40
    assert all(at_ns - 1000 * age_us > back_ns - 1000 * MAX_AGE_US for at_ns, _, age_us in frames)
    wait_until(lambda: open_files(running.process.pid) <= files)  # nothing is left open of the one that is gone
    counters = running.end()
    became_of_them = ("sent", "missed", "replaced", "stale", "refused", "absent")
    assert sum(counters[what] for what in became_of_them) >= frames[-1][1] - first
    if not isinstance(far, Udp):
        assert counters["absent"] > 0
        assert counters["opened"] >= 2


@pytest.mark.slow
def test_a_far_end_that_blocks_gets_no_more_than_its_buffers_hold(
    far: Far, running: Running, daemon: MadeUpDaemon, tmp_path: Path
) -> None:
    """Once it has read those, what comes is new. Another follower of the tap gets every frame meanwhile."""
    far.block()
    other = Raw(tmp_path / "tap.sock")
    seqs = [other.next("decoded")["seq"] for _ in range(50)]
    assert seqs == list(range(seqs[0], seqs[0] + 50))
    shows(daemon, 75)
    since, woke = len(far.frames), daemon.last_seq
    far.unblock()
    wait_until(lambda: any(seq > woke + 50 for _, seq, _ in far.frames[since:]))
    frames = far.frames[since - 1 :]  # with the last before
    numbers = [seq for _, seq, _ in frames]
    assert numbers == sorted(numbers)
    assert isinstance(far, Nt) or len(set(numbers)) == len(numbers)  # ntcore may repeat one
    skipped = max(b - a for a, b in itertools.pairwise(numbers))
    if not isinstance(far, Udp | Nt | Zenoh):  # which loses some, or whose messages carry the time of their exposure
        assert skipped > 125 - 2 * IN_ITS_BUFFERS
    assert running.process.poll() is None


def test_all_of_a_network_get_datagrams(daemon: MadeUpDaemon, tmp_path: Path) -> None:
    """By its broadcast address, which the kernel permits only to who asks for it; states, too, but no old ones."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listener:
        listener.bind(("", 0))
        listener.settimeout(limit_s())
        far = {"kind": "udp", "host": "127.255.255.255", "port": listener.getsockname()[1]}
        with bridge(far, tmp_path / "tap.sock", tmp_path):
            wait_until(lambda: json.loads(listener.recv(1 << 16))["type"] == "decoded")
            daemon.frame = {"type": "robot_state", "t_ns": time.monotonic_ns() - 10**10, "mode": "old"}
            shows(daemon, 10)
            daemon.frame = {"type": "robot_state", "t_ns": time.monotonic_ns() + 10**10, "mode": "new"}
            said = [b""]
            wait_until(lambda: b'"new"' in said[-1], meanwhile=lambda: said.append(listener.recv(1 << 16)))
            assert not any(b'"old"' in each for each in said)


@pytest.mark.slow
def test_a_computer_that_is_too_slow_is_told_of(daemon: MadeUpDaemon, tmp_path: Path) -> None:
    """Once, while all is older than this output's own limit; with what would help."""
    daemon.frame = {"exposed_ns": time.monotonic_ns() - 10**9}
    far = {"kind": "udp", "host": "127.0.0.1", "port": 9, "max_age_ms": 250}
    with bridge(far, tmp_path / "tap.sock", tmp_path) as running:
        wait_until(lambda: "a larger outputs.far.max_age_ms" in running.log)
        shows(daemon, 20)
        assert running.log.count("for 5 s every frame was older than 250 ms") == 1
        assert running.end()["sent"] == 0


@pytest.mark.slow
def test_no_fault_on_either_side_stops_it(far: Far, running: Running, daemon: MadeUpDaemon, tmp_path: Path) -> None:
    """Frames arrive, each once and in order, none older than allowed when it is sent; and go on after each fault.

    What the tap has missed by its own word is counted.
    """
    frames = frames_after(far, len(far.frames))
    numbers = [seq for _, seq, _ in frames]
    assert numbers == sorted(set(numbers))
    for at_ns, seq, age_us in frames:
        since_exposure_us = (at_ns - daemon.exposed_ns[seq]) / 1000
        if far.tells_age:
            assert 0 <= age_us <= min(MAX_AGE_US, since_exposure_us + 1)
        else:  # by two clocks, which a slow machine compares badly
            assert age_us == pytest.approx(since_exposure_us, abs=MAX_AGE_US)
    far.send_garbage()
    assert frames_after(far, len(far.frames))
    for fault in ({"markers": [{"id": 7}]}, {"dropped": 7}):  # fits no message; the tap had no room for this client
        daemon.frame = fault
        shows(daemon, 15)
        daemon.frame = {}
        shows(daemon, 5)
        assert frames_after(far, len(far.frames)), fault
    daemon.close()
    again = MadeUpDaemon(tmp_path / "tap.sock", numbered=True)
    wait_until(lambda: sum(seq < FIRST for _, seq, _ in far.frames) > 5)  # they begin at 1 again, and are new
    again.close()
    assert running.process.poll() is None
    counters = running.end()
    assert counters["missed"] == 7
    assert counters["sent"] >= len(frames)
    assert counters["opened"] == 1


@pytest.mark.slow
def test_memory_stays_as_it_is_while_a_far_end_is_in_trouble(far: Far, running: Running, daemon: MadeUpDaemon) -> None:
    """Half of them vanish, the others block. So many frames would be some megabytes, were they kept."""
    vanishes = far.kind in ("tcp", "nt", "zenoh")
    shows(daemon, 100)
    far.vanish() if vanishes else far.block()
    daemon.frame_s = 0.005  # a stand-in for a longer trouble
    shows(daemon, 300)
    before = memory_kb(running.process.pid)
    shows(daemon, 600)
    grown_kb = memory_kb(running.process.pid) - before
    if vanishes:
        far.start()
    far.unblock()
    assert running.process.poll() is None
    assert grown_kb < 600


def memory_kb(pid: int) -> int:
    """A process's own: of the files that it has mapped the kernel keeps more or less as it likes."""
    found = re.search(r"RssAnon:\s+(\d+) kB", Path(f"/proc/{pid}/status").read_text(encoding="ascii"))
    assert found is not None, "the process has ended"
    return int(found[1])


def open_files(pid: int) -> int:
    """Counts a process's descriptors."""
    return len(list(Path(f"/proc/{pid}/fd").iterdir()))
