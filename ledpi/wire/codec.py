"""Messages ↔ bytes, as docs/wire.md lays them out. Pure.

A frame is COBS(version, type, sequence, body, CRC-32) and a zero byte: little endian, 40 bytes at most. Bytes that are
no message of ours raise FrameError, with a reason that receivers count by.
"""

from __future__ import annotations

import struct
import zlib
from typing import Literal, TypeAlias

from cobs import cobs

from ledpi.core.errors import WireError
from ledpi.wire.bodies import BODIES
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
FROM_LEDPI: tuple[type[Message], ...] = tuple(message for message in BODIES if message not in FROM_CONTROLLER)
_BY_KIND = {body.kind: (message, body) for message, body in BODIES.items()}


class FrameError(WireError):
    """Bytes that are no message of ours. `sequence` is known where the CRC was right."""

    def __init__(self, reason: FrameFault, text: str, sequence: int | None = None) -> None:
        super().__init__(text)
        self.reason: FrameFault = reason
        self.sequence = sequence


def encode(message: Message, sequence: int) -> bytes:
    """The whole frame, delimiter included: its kind's bytes on docs/wire.md. `sequence` is 0 to 65535."""
    body = BODIES[type(message)]
    content = _HEADER.pack(VERSION, body.kind, sequence) + body.pack(message)
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
    message, body = _BY_KIND.get(kind, (None, None))
    if body is None or message not in kinds:
        raise FrameError("type", f"message type {kind} is not known", sequence)
    if len(packed) != body.layout.size:
        raise FrameError("length", f"type {kind} has {body.layout.size} bytes of body, not {len(packed)}", sequence)
    try:
        return sequence, body.unpack(packed)
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
