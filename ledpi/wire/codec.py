"""Messages ↔ bytes, as docs/wire.md lays them out, and the other end of the line, which counts all else. Pure.

A frame is COBS(version, type, sequence, body, CRC-32) and a zero byte: little endian, 40 bytes at most. Bytes that are
no message of ours raise FrameError, with a reason that receivers count by.
"""

from __future__ import annotations

import struct
import zlib
from collections import Counter
from dataclasses import dataclass
from typing import Literal, TypeAlias

from cobs import cobs

from ledpi.core.errors import WireError
from ledpi.wire.layouts import LAYOUTS
from ledpi.wire.message import Message
from ledpi.wire.numbers import UnknownFlagsError
from ledpi.wire.state_message import OdometryMessage, TimeAnswer

VERSION = 1
DELIMITER = b"\0"
MAX_FRAME_BYTES = 40  # delimiter included

# The last three are no faults of the line: a newer sender's packets, with a right CRC, to be skipped.
FrameFault: TypeAlias = Literal["length", "cobs", "crc", "value", "version", "type", "flags"]

_HEADER = struct.Struct("<BBH")  # version, type, sequence
_CRC = struct.Struct("<I")

FROM_CONTROLLER: tuple[type[Message], ...] = (OdometryMessage, TimeAnswer)
FROM_LEDPI: tuple[type[Message], ...] = tuple(message for message in LAYOUTS if message not in FROM_CONTROLLER)
_BY_KIND = {layout.kind: (message, layout) for message, layout in LAYOUTS.items()}


class FrameError(WireError):
    """Bytes that are no message of ours. `sequence` is known where the CRC was right."""

    def __init__(self, reason: FrameFault, text: str, sequence: int | None = None) -> None:
        super().__init__(text)
        self.reason: FrameFault = reason
        self.sequence = sequence


def encode(message: Message, sequence: int) -> bytes:
    """The whole frame, delimiter included: its kind's bytes on docs/wire.md. `sequence` is 0 to 65535."""
    layout = LAYOUTS[type(message)]
    content = _HEADER.pack(VERSION, layout.kind, sequence) + layout.pack(message)
    return bytes(cobs.encode(content + _CRC.pack(zlib.crc32(content)))) + DELIMITER


def number_after(sequence: int) -> int:
    """Returns the next packet's number: 0 only once, so that a receiver sees a restart."""
    return sequence % 0xFFFF + 1


def decode(frame: bytes, kinds: tuple[type[Message], ...] = FROM_LEDPI) -> tuple[int, Message]:
    """Sequence number and message of a frame without its delimiter. Raises FrameError.

    `kinds` are those of one direction: an echo of what was sent is of no known type.
    """
    version, kind, sequence, packed = _open(frame)
    if version != VERSION:
        raise FrameError("version", f"version {version}; this receiver knows version {VERSION}", sequence)
    message, layout = _BY_KIND.get(kind, (None, None))
    if layout is None or message not in kinds:
        raise FrameError("type", f"message type {kind} is not known", sequence)
    if len(packed) != layout.fields.size:
        raise FrameError("length", f"type {kind} has {layout.fields.size} bytes of body, not {len(packed)}", sequence)
    try:
        return sequence, layout.unpack(packed)
    except UnknownFlagsError as error:
        raise FrameError("flags", str(error), sequence) from None
    except WireError as error:
        raise FrameError("value", str(error), sequence) from None


def _open(frame: bytes) -> tuple[int, int, int, bytes]:
    """Version, type, sequence and body of a frame whose CRC is right."""
    if len(frame) >= MAX_FRAME_BYTES:
        raise FrameError("length", f"a frame has at most {MAX_FRAME_BYTES} bytes, not {len(frame) + 1}")
    try:
        packet = bytes(cobs.decode(frame))
    except cobs.DecodeError as error:
        raise FrameError("cobs", f"not COBS: {error}") from None
    if len(packet) < _HEADER.size + _CRC.size:
        raise FrameError("length", f"{len(packet)} bytes cannot hold a header and a CRC")
    content = packet[: -_CRC.size]
    if zlib.crc32(content) != _CRC.unpack(packet[-_CRC.size :])[0]:
        raise FrameError("crc", "the CRC does not match")
    version, kind, sequence = _HEADER.unpack_from(content)
    return version, kind, sequence, content[_HEADER.size :]


_NEWER_SENDER: frozenset[FrameFault] = frozenset({"version", "type", "flags"})


@dataclass(frozen=True, slots=True, kw_only=True)
class ReceiverCounters:
    """Counts of what came in since the receiver was made."""

    good: int
    lost: int  # numbers missing in the sequence
    restarts: int  # times the sequence began anew
    bad: dict[FrameFault, int]  # damaged on the way, by reason
    skipped: dict[FrameFault, int]  # whole, but of a newer version, type or flag


class Receiver:
    """Turns a byte stream into messages, however it is cut. Raises nothing, keeps at most one frame of bytes.

    What comes before the first delimiter and is no frame is not counted: it began before we listened.
    """

    def __init__(self, kinds: tuple[type[Message], ...] = FROM_LEDPI) -> None:
        """`kinds`: those of one direction; others are skipped."""
        self._kinds = kinds
        self._partial = bytearray()
        self._joined = False
        self._last_sequence: int | None = None
        self._good = self._lost = self._restarts = 0
        self._bad: Counter[FrameFault] = Counter()
        self._skipped: Counter[FrameFault] = Counter()

    @property
    def counters(self) -> ReceiverCounters:
        """Frames since the start: good, lost, bad and skipped by reason, and the sender's restarts."""
        return ReceiverCounters(
            good=self._good, lost=self._lost, restarts=self._restarts, bad=dict(self._bad), skipped=dict(self._skipped)
        )

    def feed(self, data: bytes) -> list[Message]:
        """The messages that `data` completes, oldest first."""
        messages = []
        *ends, rest = data.split(DELIMITER)
        for end in ends:
            self._keep(end)
            message = self._finish()
            if message is not None:
                messages.append(message)
        self._keep(rest)
        return messages

    def _keep(self, piece: bytes) -> None:
        # One byte more than the longest frame is enough to know that this is none.
        self._partial += piece[: MAX_FRAME_BYTES - len(self._partial)]

    def _finish(self) -> Message | None:
        frame, joined = bytes(self._partial), self._joined
        self._partial.clear()
        self._joined = True
        if not frame:
            return None  # two delimiters in a row separate nothing
        try:
            sequence, message = decode(frame, self._kinds)
        except FrameError as error:
            if error.sequence is not None:
                self._count_lost(error.sequence)
            if error.reason in _NEWER_SENDER:
                self._skipped[error.reason] += 1
            elif joined:
                self._bad[error.reason] += 1
            return None
        self._count_lost(sequence)
        self._good += 1
        return message

    def _count_lost(self, sequence: int) -> None:
        """0 is only ever a sender's first number; after 65535 comes 1. A step back means a new sender."""
        if self._last_sequence is not None:
            missing = (sequence - self._last_sequence - 1) % 0xFFFF
            if sequence == 0 or missing >= 0x8000:
                self._restarts += 1
            else:
                self._lost += missing
        self._last_sequence = sequence
