"""The age in a packet is true when its first byte is written, wherever the process was held up before."""

from __future__ import annotations

import itertools
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType, SimpleNamespace
from typing import Any

import pytest

import ledpi.wire
from ledpi.config.settings import SerialSettings
from ledpi.wire import MarkerMessage, Message, Receiver
from ledpi.wire.codec import encode
from ledpi.wire.publisher import Publisher
from tests.builders.daemon import Controller, controller
from tests.builders.wire import decoded, decoded_now, marker_pose

pytestmark = pytest.mark.alone  # it tells how late a daemon is: no other test may take the processor meanwhile

WIRE = str(Path(ledpi.wire.__file__).parent)
PAUSE_S = 0.01
TOO_SMALL_US = 3000
TRIES = 6
FAST = 4_000_000  # baud: the line is free again at once
LONG_MS = 10_000  # no pose grows too old, however long a busy machine stops the process


class Pauses:
    """A trace function that holds up each thread once, when it comes to a line that is chosen."""

    def __init__(self) -> None:
        self.seen: set[tuple[str, int]] = set()
        self._chosen: tuple[str, int] | None = None
        self._held: set[int] = set()

    def choose(self, line: tuple[str, int] | None) -> None:
        self._chosen, self._held = line, set()

    @property
    def held(self) -> bool:
        return bool(self._held)

    def __call__(self, frame: FrameType, event: str, _: Any) -> Any:
        return self._at_line if frame.f_code.co_filename.startswith(WIRE) else None

    def _at_line(self, frame: FrameType, event: str, _: Any) -> Any:
        here, thread = (frame.f_code.co_filename, frame.f_lineno), threading.get_ident()
        self.seen.add(here)
        if here == self._chosen and thread not in self._held:
            self._held.add(thread)
            time.sleep(PAUSE_S)
        return self._at_line


@pytest.fixture
def pauses() -> Iterator[Pauses]:
    """For this thread, and for all that are started in the test."""
    before, pauses = sys.gettrace(), Pauses()
    threading.settrace(pauses)
    sys.settrace(pauses)
    yield pauses
    sys.settrace(before)
    threading.settrace(before)  # type: ignore[arg-type]


@pytest.fixture
def written(monkeypatch: pytest.MonkeyPatch) -> list[tuple[int, bytes]]:
    """Logs what is given to the kernel from now on, and when, ns."""
    log: list[tuple[int, bytes]] = []

    def write(port: int, data: bytes) -> int:
        log.append((time.monotonic_ns(), data))
        return os.write(port, data)

    monkeypatch.setattr("ledpi.wire.line.os", SimpleNamespace(**vars(os) | {"write": write}))
    return log


def sent_markers(written: list[tuple[int, bytes]]) -> dict[int, tuple[int, MarkerMessage]]:
    """By ID, with the time of each."""
    messages = ((at_ns, Receiver().feed(b"\0" + data)) for at_ns, data in list(written))
    return {m.id: (at_ns, m) for at_ns, some in messages for m in some if isinstance(m, MarkerMessage)}


def wait_until_free(publisher: Publisher, line: Controller) -> None:
    """Until a pose that is published is written at once: the first status has left."""
    line.wait_for(lambda _: publisher.counters.statuses > 0)


def understated_us(publisher: Publisher, line: Controller, written: list[tuple[int, bytes]], ids: list[int]) -> float:
    """Sends these panels and says by how much the age of one is too small, at most."""
    wait_until_free(publisher, line)
    written.clear()
    mid_ns = time.monotonic_ns() - 30_000_000
    publisher.publish(decoded(*(marker_pose(marker_id, mid_ns) for marker_id in ids)))
    line.wait_for(lambda _: sent_markers(written).keys() >= set(ids))
    return max((at_ns - mid_ns) / 1000 - marker.age_us for at_ns, marker in sent_markers(written).values())


@pytest.mark.slow
def test_a_pause_at_any_line_of_the_publisher_makes_no_age_too_small(
    pauses: Pauses, written: list[tuple[int, bytes]]
) -> None:
    """Both threads that send are held up, for three times what an age may be wrong by.

    A busy machine may stop the process by itself where the publisher can no longer see it, but not each time at a line.
    """
    ids = itertools.count()
    with controller(max_age_us=LONG_MS * 1000) as line:
        publisher = Publisher(SerialSettings(port=line.port, baud=FAST, max_age_ms=LONG_MS))
        publisher.start()
        for _ in range(20):  # the usual ways through it
            understated_us(publisher, line, written, [next(ids), next(ids)])
        lines, held = sorted(pauses.seen), 0
        for here in lines:
            for _ in range(TRIES):
                pauses.choose(here)
                worst_us = understated_us(publisher, line, written, [next(ids), next(ids)])
                held += pauses.held
                if worst_us <= TOO_SMALL_US:
                    break
            assert worst_us <= TOO_SMALL_US, f"{here}: {worst_us:.0f} µs too small"
        pauses.choose(None)
        publisher.stop()
    files = {Path(file).name for file, _ in lines}
    assert files >= {"publisher.py", "outbox.py", "line.py", "codec.py", "message.py"}
    assert held > 100


def slow_once(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """From the call of what is returned on, the next packet takes 20 ms to be encoded."""
    armed = threading.Event()

    def slowly(message: Message, sequence: int) -> bytes:
        if armed.is_set():
            armed.clear()
            time.sleep(0.02)
        return encode(message, sequence)

    monkeypatch.setattr("ledpi.wire.publisher.encode", slowly)
    return armed.set


def test_a_pose_that_grows_too_old_while_its_packet_is_made_is_not_written(monkeypatch: pytest.MonkeyPatch) -> None:
    """85 ms when it is handed over, 105 when it would be written: it is counted; a fresh one follows."""
    arm = slow_once(monkeypatch)
    with controller() as line:
        publisher = Publisher(SerialSettings(port=line.port, baud=FAST))
        publisher.start()
        wait_until_free(publisher, line)
        arm()
        publisher.publish(decoded_now(3, age_ms=85.0))
        line.wait_for(lambda _: publisher.counters.stale == 1)
        while not line.markers:  # on a busy machine one more may grow too old
            publisher.publish(decoded_now(7))
            time.sleep(0.01)
        publisher.stop()
    assert {marker.id for marker in line.markers} == {7}


def test_a_packet_that_is_made_again_keeps_its_number(monkeypatch: pytest.MonkeyPatch) -> None:
    """Counts no loss for what was not written; and the pose is sent, with its true age."""
    arm = slow_once(monkeypatch)
    with controller(max_age_us=LONG_MS * 1000) as line:
        publisher = Publisher(SerialSettings(port=line.port, baud=FAST, max_age_ms=LONG_MS))
        publisher.start()
        wait_until_free(publisher, line)
        arm()
        publisher.publish(decoded_now(3, age_ms=30.0))
        line.wait_for(lambda end: bool(end.markers))
        publisher.stop()
    assert line.markers[0].age_us >= 50_000
    assert line.receiver.counters.lost == 0
