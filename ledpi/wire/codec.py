"""Messages ↔ bytes, as docs/wire.md lays them out. Pure.

A frame is COBS(version, type, sequence, body, CRC-32) and a zero byte: little endian, 40 bytes for each of
the three messages. Bytes that are no message of ours raise FrameError, with a reason that receivers count by.
"""

from __future__ import annotations

import math
import struct
import zlib
from enum import IntEnum
from typing import Literal, TypeAlias

from cobs import cobs

from ledpi.core.errors import WireError
from ledpi.wire.message import (
    UNITS_PER_SI,
    FixMessage,
    MarkerMessage,
    Message,
    NoFix,
    Quadruple,
    State,
    StatusMessage,
    Triple,
    WirePose,
)

VERSION = 1
DELIMITER = b"\0"
MAX_FRAME_BYTES = 40  # delimiter included

# The last three are no faults of the line: a newer sender's packets, with a right CRC, to be skipped.
FrameFault: TypeAlias = Literal["length", "cobs", "crc", "value", "version", "type", "flags"]

_HEADER = struct.Struct("<BBH")  # version, type, sequence
_CRC = struct.Struct("<I")
_POSE = "I9s4h6B"  # age, position (3 × 24 bits), quaternion, deviations; at one place in both pose messages
_MARKER = struct.Struct("<HB" + _POSE)  # ID, flags
_FIX = struct.Struct("<BBB" + _POSE)  # panels used, map resets, flags
_STATUS = struct.Struct("<BBBbH5I2H")  # the fields in the record's order

_UNCALIBRATED, _AMBIGUOUS, _ALTERNATE = 1, 2, 4  # a marker's flags
_I24_UNKNOWN = -0x800000
_Q15 = 32767
_Q15_UNKNOWN = -32768
_TEMPERATURE_UNKNOWN = -128
_DEVIATION_UNKNOWN = 255


class _Kind(IntEnum):
    MARKER = 1
    FIX = 2
    STATUS = 3


_LAYOUTS = {_Kind.MARKER: _MARKER, _Kind.FIX: _FIX, _Kind.STATUS: _STATUS}


class FrameError(WireError):
    """Bytes that are no message of ours. `sequence` is known where the CRC was right."""

    def __init__(self, reason: FrameFault, text: str, sequence: int | None = None) -> None:
        super().__init__(text)
        self.reason: FrameFault = reason
        self.sequence = sequence


def encode(message: Message, sequence: int) -> bytes:
    """The whole frame, delimiter included: exactly 40 bytes. `sequence` is 0 to 65535."""
    match message:
        case MarkerMessage():
            kind, body = _Kind.MARKER, _pack_marker(message)
        case FixMessage():
            kind, body = _Kind.FIX, _pack_fix(message)
        case StatusMessage():
            kind, body = _Kind.STATUS, _pack_status(message)
    content = _HEADER.pack(VERSION, kind, sequence) + body
    return bytes(cobs.encode(content + _CRC.pack(zlib.crc32(content)))) + DELIMITER


def number_after(sequence: int) -> int:
    """Returns the next packet's number: 0 only once, so that a receiver sees a restart."""
    return sequence % 0xFFFF + 1


def decode(frame: bytes) -> tuple[int, Message]:
    """Sequence number and message of a frame without its delimiter. Raises FrameError."""
    version, kind, sequence, body = _open(frame)
    if version != VERSION:
        raise FrameError("version", f"version {version}; this receiver knows version {VERSION}", sequence)
    layout = _LAYOUTS.get(kind)  # type: ignore[call-overload]
    if layout is None:
        raise FrameError("type", f"message type {kind} is not known", sequence)
    if len(body) != layout.size:
        raise FrameError("length", f"type {kind} has {layout.size} bytes of body, not {len(body)}", sequence)
    try:
        return sequence, _unpack(kind, body)
    except _UnknownFlagsError as error:
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


class _UnknownFlagsError(WireError):
    pass


def _unpack(kind: int, body: bytes) -> Message:
    if kind == _Kind.MARKER:
        return _unpack_marker(body)
    return _unpack_fix(body) if kind == _Kind.FIX else _unpack_status(body)


def _pack_marker(message: MarkerMessage) -> bytes:
    flags = _UNCALIBRATED if message.uncalibrated else 0
    flags |= _AMBIGUOUS if message.ambiguous else 0
    flags |= _ALTERNATE if message.alternate else 0
    return _MARKER.pack(message.id, flags, _limited(message.age_us, 0xFFFFFFFF), *_pack_pose(message.pose))


def _unpack_marker(body: bytes) -> MarkerMessage:
    marker_id, flags, age_us, *pose = _MARKER.unpack(body)
    _check_flags(flags, _UNCALIBRATED | _AMBIGUOUS | _ALTERNATE)
    return MarkerMessage(
        id=marker_id,
        age_us=age_us,
        pose=_unpack_pose(*pose),
        uncalibrated=bool(flags & _UNCALIBRATED),
        ambiguous=bool(flags & _AMBIGUOUS),
        alternate=bool(flags & _ALTERNATE),
    )


def _pack_fix(message: FixMessage) -> bytes:
    used, age_us = _limited(message.panels_used, 0xFF), _limited(message.age_us, 0xFFFFFFFF)
    return _FIX.pack(used, message.map_resets, 0, age_us, *_pack_pose(message.pose))


def _unpack_fix(body: bytes) -> FixMessage:
    panels_used, map_resets, flags, age_us, *packed = _FIX.unpack(body)
    _check_flags(flags, 0)
    pose = _unpack_pose(*packed)
    if pose is None:
        raise WireError("a fix without a pose")
    return FixMessage(age_us=age_us, pose=pose, panels_used=panels_used, map_resets=map_resets)


def _check_flags(flags: int, known: int) -> None:
    if flags & ~known:
        raise _UnknownFlagsError(f"flags 0x{flags:02x}; this receiver knows 0x{known:02x}")


def _pack_status(s: StatusMessage) -> bytes:
    temperature = _TEMPERATURE_UNKNOWN if s.temperature_c is None else max(-127, min(127, s.temperature_c))
    totals = (s.uptime_s, s.frames, s.frames_dropped, s.markers, s.packets_dropped)
    return _STATUS.pack(
        s.state,
        s.no_fix,
        _limited(s.panels_in_view, 0xFF, unknown=True),
        temperature,
        _limited(s.throttling, 0xFFFF, unknown=True),
        *(_limited(total, 0xFFFFFFFF, unknown=True) for total in totals),
        *(_limited(time, 0xFFFF, unknown=True) for time in (s.decode_p50_us, s.decode_p99_us)),
    )


def _unpack_status(body: bytes) -> StatusMessage:
    state, no_fix, panels, temperature, throttling, *others = _STATUS.unpack(body)
    uptime, frames, frames_dropped, markers, packets_dropped = (_known(v, 0xFFFFFFFF) for v in others[:5])
    p50, p99 = (_known(v, 0xFFFF) for v in others[5:])
    throttling = _known(throttling, 0xFFFF)
    return StatusMessage(
        state=State(state),
        no_fix=NoFix(no_fix),
        panels_in_view=_known(panels, 0xFF),
        temperature_c=_known(temperature, _TEMPERATURE_UNKNOWN),
        throttling=throttling if throttling is None else throttling & 0x0F0F,
        uptime_s=uptime,
        frames=frames,
        frames_dropped=frames_dropped,
        markers=markers,
        packets_dropped=packets_dropped,
        decode_p50_us=p50,
        decode_p99_us=p99,
    )


def _limited(value: int | None, top: int, *, unknown: bool = False) -> int:
    """Saturated at `top`, or, where `top` itself stands for unknown, one below it."""
    if value is None:
        return top
    return min(value, top - 1 if unknown else top)


def _known(value: int, unknown: int) -> int | None:
    return None if value == unknown else value


def _pack_pose(pose: WirePose | None) -> tuple[bytes | int, ...]:
    if pose is None:
        position, quaternion = [_I24_UNKNOWN] * 3, [_Q15_UNKNOWN] * 4
        deviations = [_DEVIATION_UNKNOWN] * 6
    else:
        position = [round(v * UNITS_PER_SI) for v in pose.position_m]
        sign = -1 if pose.quaternion_wxyz[0] < 0 else 1
        norm = math.hypot(*pose.quaternion_wxyz)
        quaternion = [sign * round(v / norm * _Q15) for v in pose.quaternion_wxyz]
        deviations = [*_pack_deviations(pose.deviation_m), *_pack_deviations(pose.deviation_rad)]
    return b"".join(v.to_bytes(3, "little", signed=True) for v in position), *quaternion, *deviations


def _unpack_pose(position: bytes, *others: int) -> WirePose | None:
    xyz = [int.from_bytes(position[i : i + 3], "little", signed=True) for i in (0, 3, 6)]
    q = others[:4]
    if _I24_UNKNOWN in xyz or _Q15_UNKNOWN in q:
        return None
    norm = math.hypot(*q)
    if abs(norm / _Q15 - 1.0) > 1e-3:
        raise WireError(f"quaternion of length {norm / _Q15:.3f}")
    return WirePose(
        position_m=_triple([v / UNITS_PER_SI for v in xyz]),
        quaternion_wxyz=_quadruple([v / norm for v in q]),
        deviation_m=_unpack_deviations(others[4:7]),
        deviation_rad=_unpack_deviations(others[7:10]),
    )


def _pack_deviations(deviations: Triple | None) -> list[int]:
    return [_DEVIATION_UNKNOWN] * 3 if deviations is None else [deviation_code(d) for d in deviations]


def _unpack_deviations(codes: tuple[int, ...]) -> Triple | None:
    return None if _DEVIATION_UNKNOWN in codes else _triple([deviation_value(code) for code in codes])


def deviation_code(deviation: float) -> int:
    """The smallest code whose value is not less: below the top, a deviation is never understated.

    A logarithmic byte: high half e, low half m; the value is m for e = 0 and (16 + m)·2^(e − 1) above, in
    steps of 0.1 mm or 0.1 mrad. Exact to 31 steps, within 1/16 to 49.152 (m or rad); 254 is that or more.
    """
    # 1e-6 of a step: a value that *is* a whole number of steps must not be lifted by its last binary digit.
    steps = math.ceil(min(deviation, 1e3) * UNITS_PER_SI - 1e-6)
    if steps < 16:
        return max(steps, 0)
    shift = steps.bit_length() - 5
    mantissa = -(-steps >> shift)  # rounded up; 32 carries into the exponent by the sum below
    return min((shift + 1 << 4) + mantissa - 16, _DEVIATION_UNKNOWN - 1)


def deviation_value(code: int) -> float:
    """Returns what a code below 255 stands for, in m or rad."""
    exponent, mantissa = code >> 4, code & 15
    return (mantissa if exponent == 0 else (16 + mantissa) << (exponent - 1)) / UNITS_PER_SI


def _triple(values: list[float]) -> Triple:
    a, b, c = values
    return a, b, c


def _quadruple(values: list[float]) -> Quadruple:
    a, b, c, d = values
    return a, b, c, d
