"""docs/wire.md is executed: every vector on it, in both directions, and with whatever a line does to it."""

from __future__ import annotations

import json
from typing import Any

import pytest

from ledpi.cli.monitor import json_line
from ledpi.wire import Message, Receiver
from ledpi.wire.codec import FROM_LEDPI, FrameError, decode, encode
from ledpi.wire.numbers import deviation_code, deviation_value
from tests.builders.wire import (
    PAGE,
    RejectedVector,
    Vector,
    controller_vectors,
    message_of,
    rejected_vectors,
    vectors,
)

VECTORS = vectors()
CONTROLLER = controller_vectors()
REJECTED = rejected_vectors()
BYTES = {"odometry": 27, "time_ask": 12, "time_answer": 20}  # of the others: 40

each_vector = pytest.mark.parametrize("vector", VECTORS + CONTROLLER, ids=lambda v: v.name)
each_rejected = pytest.mark.parametrize("vector", REJECTED, ids=lambda v: v.name)


def assert_says(message: Message, values: dict[str, Any]) -> None:
    """The message says what the page does; its quaternion to within its resolution."""
    said = json.loads(json_line(message))
    assert said.pop("quaternion_wxyz", None) == pytest.approx(values.get("quaternion_wxyz"), abs=1 / 32767)
    assert said == {key: value for key, value in values.items() if key != "quaternion_wxyz"}


def received(*chunks: bytes, kinds: tuple[type[Message], ...] = FROM_LEDPI) -> tuple[list[Message], Receiver]:
    """Returns what a receiver makes of a stream that it hears from its first byte (hence the delimiter)."""
    receiver = Receiver(kinds)
    messages = receiver.feed(b"\0")
    for chunk in chunks:
        messages += receiver.feed(chunk)
    return messages, receiver


def test_the_page_has_vectors_of_every_kind() -> None:
    """An empty or renamed block would make all tests below pass."""
    assert {v.values["message"] for v in VECTORS} == {"marker", "fix", "status", "state", "time_ask"}
    assert {v.values["message"] for v in CONTROLLER} == {"odometry", "time_answer"}
    assert {v.reason for v in REJECTED} == {"length", "cobs", "crc", "value", "version", "type", "flags"}


def test_the_page_and_the_header_say_what_the_largest_deviation_is() -> None:
    """254 is no value like the others: what it stands for, or more."""
    assert deviation_code(1e6) == deviation_code(49.152) == 254
    assert deviation_value(254) == 49.152
    for file in (PAGE, PAGE.parents[1] / "firmware/receiver/ledpi_receiver.h"):
        assert "254 is 49.152 m or" in file.read_text(encoding="utf-8")


@each_vector
def test_a_message_and_the_bytes_on_the_page_become_each_other(vector: Vector) -> None:
    """The page's bytes, number and values; nothing moves by going round: a relay may decode and send on."""
    assert encode(message_of(vector.values), vector.sequence) == vector.frame
    assert len(vector.frame) == BYTES.get(vector.values["message"], 40)
    sequence, message = decode(vector.frame[:-1], vector.kinds)
    assert sequence == vector.sequence
    assert_says(message, vector.values)
    assert encode(message, sequence) == vector.frame


def test_a_stream_of_all_vectors_is_received_whole_and_bytewise() -> None:
    """However the stream is cut, the messages are the same."""
    stream = b"".join(v.frame for v in VECTORS)
    whole, receiver = received(stream)
    assert len(whole) == receiver.counters.good == len(VECTORS)
    for message, vector in zip(whole, VECTORS, strict=True):
        assert_says(message, vector.values)
    for size in (1, 2, 7, 39, 41):
        pieces = [stream[i : i + size] for i in range(0, len(stream), size)]
        assert received(*pieces)[0] == whole


@pytest.mark.parametrize("garbage", [b"\xff", b"boot: ok\r\n", b"\x04\x01\x01", bytes(range(1, 256))])
def test_garbage_before_between_and_after_costs_no_message(garbage: bytes) -> None:
    """Each piece of garbage ends at a delimiter; every frame around it is received."""
    noise = garbage + b"\0"
    messages, receiver = received(noise + noise.join(v.frame for v in VECTORS) + noise)
    assert len(messages) == len(VECTORS)
    assert sum(receiver.counters.bad.values()) == len(VECTORS) + 1


@each_vector
def test_any_flipped_bit_is_rejected_and_the_next_frame_is_received(vector: Vector) -> None:
    """Each of a frame's bits. (A flipped delimiter joins two frames, which costs the second one too.)"""
    for bit in range(8 * len(vector.frame)):
        damaged = bytearray(vector.frame)
        damaged[bit // 8] ^= 1 << bit % 8
        messages, receiver = received(bytes(damaged) + vector.frame + vector.frame, kinds=vector.kinds)
        delimiter_hit = bit // 8 == len(vector.frame) - 1
        assert len(messages) == (1 if delimiter_hit else 2)
        assert sum(receiver.counters.bad.values()) >= 1


@each_vector
def test_a_truncated_frame_is_rejected_and_the_next_one_is_received(vector: Vector) -> None:
    """A sender that is unplugged after any number of bytes, and begins anew with a delimiter."""
    for length in range(1, len(vector.frame) - 1):
        messages, receiver = received(vector.frame[:length], b"\0" + vector.frame, kinds=vector.kinds)
        assert len(messages) == 1
        assert sum(receiver.counters.bad.values()) == 1


@each_rejected
def test_what_the_page_rejects_is_counted_for_that_reason(vector: RejectedVector) -> None:
    """Newer versions, types and flags are skipped; everything else is bad. The next frame is received."""
    with pytest.raises(FrameError) as error:
        decode(vector.frame[:-1])
    assert error.value.reason == vector.reason
    messages, receiver = received(vector.frame, VECTORS[0].frame)
    assert len(messages) == 1
    counters = receiver.counters
    newer = vector.reason in ("version", "type", "flags")
    assert (counters.skipped if newer else counters.bad) == {vector.reason: 1}
    assert (counters.bad if newer else counters.skipped) == {}
