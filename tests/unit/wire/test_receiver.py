"""The receiver's bookkeeping: what was lost, what was bad, and how little it keeps."""

from __future__ import annotations

import tracemalloc

import pytest

from ledpi.wire import NoFix, Receiver, State, StatusMessage
from ledpi.wire.codec import encode

STATUS = StatusMessage(state=State.RUNNING, no_fix=NoFix.NO_PANEL)


def receiver_of(*sequences: int) -> Receiver:
    receiver = Receiver()
    for sequence in sequences:
        assert receiver.feed(encode(STATUS, sequence)) == [STATUS]
    return receiver


@pytest.mark.parametrize(
    ("sequences", "lost", "restarts"),
    [
        ((5, 6, 10), 3, 0),
        ((4711, 4712), 0, 0),  # joined in the middle: the first number that is heard is where counting begins
        ((65534, 65535, 1, 2, 4), 1, 0),  # 0 is kept for the first packet after a start
        ((900, 0, 1, 2), 0, 1),
        ((900, 3, 4, 6), 1, 1),  # a step back, where number 0 was not heard
    ],
)
def test_missing_numbers_are_lost_packets(sequences: tuple[int, ...], lost: int, restarts: int) -> None:
    """A sender that begins anew has lost nothing."""
    counters = receiver_of(*sequences).counters
    assert (counters.lost, counters.restarts) == (lost, restarts)


def test_a_bad_packet_is_bad_and_lost() -> None:
    """It was damaged (one bad), and its message never came (one lost)."""
    receiver = receiver_of(1)
    damaged = bytearray(encode(STATUS, 2))
    damaged[6] ^= 0x10
    receiver.feed(bytes(damaged))
    receiver.feed(encode(STATUS, 3))
    assert (receiver.counters.good, receiver.counters.lost) == (2, 1)
    assert receiver.counters.bad == {"crc": 1}


def test_the_rest_of_a_frame_that_began_before_is_not_counted() -> None:
    """A monitor that is plugged in at any moment has seen no fault."""
    receiver = Receiver()
    assert receiver.feed(encode(STATUS, 1)[17:] + encode(STATUS, 2)) == [STATUS]
    assert receiver.counters.bad == {}


def test_a_stream_without_delimiters_is_one_bad_frame_and_takes_no_memory() -> None:
    """The wrong baud rate for a day: the buffer is bounded, and the next frame is received."""
    receiver = Receiver()
    receiver.feed(b"\0")
    noise = b"\x55" * 4096
    receiver.feed(noise)
    tracemalloc.start()
    for _ in range(1000):
        receiver.feed(noise)
    kept, _ = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert kept < 4096
    assert receiver.feed(b"\0" + encode(STATUS, 1)) == [STATUS]
    assert receiver.counters.bad == {"length": 1}
