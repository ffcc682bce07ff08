"""Bodies of poses and of the daemon's status. Pure; codec.py frames them, docs/wire.md is the contract."""

from __future__ import annotations

import math
import struct

from ledpi.core.errors import WireError
from ledpi.wire.message import FixMessage, MarkerMessage, NoFix, State, StatusMessage, WirePose
from ledpi.wire.numbers import (
    DEVIATION_UNKNOWN,
    I24_UNKNOWN,
    UNITS_PER_SI,
    check_flags,
    from_i24,
    i24,
    known,
    limited,
    pack_deviations,
    unpack_deviations,
)

_POSE = "I9s4h6B"  # age, position (3 × 24 bits), quaternion, deviations; at one place in both pose messages
MARKER = struct.Struct("<HB" + _POSE)  # ID, flags
FIX = struct.Struct("<BBB" + _POSE)  # panels used, map resets, flags
STATUS = struct.Struct("<BBBbH5I2H")  # the fields in the record's order

_UNCALIBRATED, _AMBIGUOUS, _ALTERNATE = 1, 2, 4  # a marker's flags
_Q15 = 32767
_Q15_UNKNOWN = -32768
_TEMPERATURE_UNKNOWN = -128


def pack_marker(message: MarkerMessage) -> bytes:
    flags = _UNCALIBRATED if message.uncalibrated else 0
    flags |= _AMBIGUOUS if message.ambiguous else 0
    flags |= _ALTERNATE if message.alternate else 0
    return MARKER.pack(message.id, flags, limited(message.age_us, 0xFFFFFFFF), *_pack_pose(message.pose))


def unpack_marker(body: bytes) -> MarkerMessage:
    marker_id, flags, age_us, *pose = MARKER.unpack(body)
    check_flags(flags, _UNCALIBRATED | _AMBIGUOUS | _ALTERNATE)
    return MarkerMessage(
        id=marker_id,
        age_us=age_us,
        pose=_unpack_pose(*pose),
        uncalibrated=bool(flags & _UNCALIBRATED),
        ambiguous=bool(flags & _AMBIGUOUS),
        alternate=bool(flags & _ALTERNATE),
    )


def pack_fix(message: FixMessage) -> bytes:
    used, age_us = limited(message.panels_used, 0xFF), limited(message.age_us, 0xFFFFFFFF)
    return FIX.pack(used, message.map_resets, 0, age_us, *_pack_pose(message.pose))


def unpack_fix(body: bytes) -> FixMessage:
    panels_used, map_resets, flags, age_us, *packed = FIX.unpack(body)
    check_flags(flags, 0)
    pose = _unpack_pose(*packed)
    if pose is None:
        raise WireError("a fix without a pose")
    return FixMessage(age_us=age_us, pose=pose, panels_used=panels_used, map_resets=map_resets)


def pack_status(s: StatusMessage) -> bytes:
    temperature = _TEMPERATURE_UNKNOWN if s.temperature_c is None else max(-127, min(127, s.temperature_c))
    totals = (s.uptime_s, s.frames, s.frames_dropped, s.markers, s.packets_dropped)
    return STATUS.pack(
        s.state,
        s.no_fix,
        limited(s.panels_in_view, 0xFF, unknown=True),
        temperature,
        limited(s.throttling, 0xFFFF, unknown=True),
        *(limited(total, 0xFFFFFFFF, unknown=True) for total in totals),
        *(limited(time, 0xFFFF, unknown=True) for time in (s.decode_p50_us, s.decode_p99_us)),
    )


def unpack_status(body: bytes) -> StatusMessage:
    state, no_fix, panels, temperature, throttling, *others = STATUS.unpack(body)
    uptime, frames, frames_dropped, markers, packets_dropped = (known(v, 0xFFFFFFFF) for v in others[:5])
    p50, p99 = (known(v, 0xFFFF) for v in others[5:])
    throttling = known(throttling, 0xFFFF)
    return StatusMessage(
        state=State(state),
        no_fix=NoFix(no_fix),
        panels_in_view=known(panels, 0xFF),
        temperature_c=known(temperature, _TEMPERATURE_UNKNOWN),
        throttling=throttling if throttling is None else throttling & 0x0F0F,
        uptime_s=uptime,
        frames=frames,
        frames_dropped=frames_dropped,
        markers=markers,
        packets_dropped=packets_dropped,
        decode_p50_us=p50,
        decode_p99_us=p99,
    )


def _pack_pose(pose: WirePose | None) -> tuple[bytes | int, ...]:
    if pose is None:
        position, quaternion = [I24_UNKNOWN] * 3, [_Q15_UNKNOWN] * 4
        deviations = [DEVIATION_UNKNOWN] * 6
    else:
        position = [round(v * UNITS_PER_SI) for v in pose.position_m]
        sign = -1 if pose.quaternion_wxyz[0] < 0 else 1
        norm = math.hypot(*pose.quaternion_wxyz)
        quaternion = [sign * round(v / norm * _Q15) for v in pose.quaternion_wxyz]
        deviations = [*pack_deviations(pose.deviation_m), *pack_deviations(pose.deviation_rad)]
    return i24(*position), *quaternion, *deviations


def _unpack_pose(position: bytes, *others: int) -> WirePose | None:
    x, y, z = from_i24(position)
    q = qw, qx, qy, qz = others[:4]
    if I24_UNKNOWN in (x, y, z) or _Q15_UNKNOWN in q:
        return None
    norm = math.hypot(*q)
    if abs(norm / _Q15 - 1.0) > 1e-3:
        raise WireError(f"quaternion of length {norm / _Q15:.3f}")
    return WirePose(
        position_m=(x / UNITS_PER_SI, y / UNITS_PER_SI, z / UNITS_PER_SI),
        quaternion_wxyz=(qw / norm, qx / norm, qy / norm, qz / norm),
        deviation_m=unpack_deviations(others[4:7]),
        deviation_rad=unpack_deviations(others[7:10]),
    )
