"""Layouts of messages, to bytes and back, in one table. Pure; codec.py frames them, docs/wire.md is the contract."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import fields
from typing import Any, NamedTuple

from ledpi.core.errors import WireError
from ledpi.wire.message import FixMessage, MarkerMessage, Message, NoFix, State, StatusMessage, WirePose
from ledpi.wire.numbers import (
    DEVIATION_UNKNOWN,
    I24_UNKNOWN,
    UNITS_PER_SI,
    UnknownFlagsError,
    check_flags,
    from_i24,
    i24,
    known,
    limited,
    pack_deviations,
    unpack_deviations,
)
from ledpi.wire.state_message import (
    CORRELATION_STEPS,
    U16,
    U32,
    UNITS_PER_SI_S,
    Mode,
    OdometryMessage,
    StateMessage,
    TimeAnswer,
    TimeAsk,
)

_POSE = "I9s4h6B"  # age, position (3 × 24 bits), quaternion, deviations; at one place in both pose messages
_MARKER = struct.Struct("<HB" + _POSE)  # ID, flags
_FIX = struct.Struct("<BBB" + _POSE)  # panels used, map resets, flags
_STATUS = struct.Struct("<BBBbH5I2H")  # the fields in the record's order
# x and y, yaw and velocity, deviations, correlations, then the record's order.
_STATE = struct.Struct("<6s3h3B3bIHHBBBB")
_ODOMETRY = struct.Struct("<I3iB")

_Q15, _I16_UNKNOWN, _I32_UNKNOWN, _I8_UNKNOWN = 32767, -0x8000, -0x80000000, -128
# A bit each, from the lowest on.
_MARKER_FLAGS = ("uncalibrated", "ambiguous", "alternate")
_ODOMETRY_FLAGS = ("restarted", "lifted", "slipping")
_MODE, _CONTESTED, _PANEL_MOVED, _NO_CLOCK = 7, 8, 16, 32  # of a state's byte of mode and flags
# A status's fields behind the first two, with what stands for unknown.
_UNKNOWN = {
    **{"panels_in_view": 0xFF, "temperature_c": _I8_UNKNOWN, "throttling": U16},
    **dict.fromkeys(("uptime_s", "frames", "frames_dropped", "markers", "packets_dropped"), U32),
    **dict.fromkeys(("decode_p50_us", "decode_p99_us"), U16),
}


class Layout(NamedTuple):
    """A message's own bytes."""

    kind: int  # the type on the line
    fields: struct.Struct
    pack: Callable[[Any], bytes]
    unpack: Callable[[bytes], Message]


def _flags(message: Message, names: tuple[str, ...]) -> int:
    return sum(getattr(message, name) << bit for bit, name in enumerate(names))


def _set(flags: int, names: tuple[str, ...]) -> dict[str, bool]:
    check_flags(flags, (1 << len(names)) - 1)
    return {name: bool(flags >> bit & 1) for bit, name in enumerate(names)}


def _pack_marker(message: MarkerMessage) -> bytes:
    flags = _flags(message, _MARKER_FLAGS)
    return _MARKER.pack(message.id, flags, limited(message.age_us, U32), *_pack_pose(message.pose))


def _unpack_marker(body: bytes) -> MarkerMessage:
    marker_id, flags, age_us, *pose = _MARKER.unpack(body)
    flagged = _set(flags, _MARKER_FLAGS)  # first, as a newer sender's pose may be another
    return MarkerMessage(id=marker_id, age_us=age_us, pose=_unpack_pose(*pose), **flagged)


def _pack_fix(message: FixMessage) -> bytes:
    used, age_us = limited(message.panels_used, 0xFF), limited(message.age_us, U32)
    return _FIX.pack(used, message.map_resets, 0, age_us, *_pack_pose(message.pose))


def _unpack_fix(body: bytes) -> FixMessage:
    panels_used, map_resets, flags, age_us, *packed = _FIX.unpack(body)
    check_flags(flags, 0)
    pose = _unpack_pose(*packed)
    if pose is None:
        raise WireError("a fix without a pose")
    return FixMessage(age_us=age_us, pose=pose, panels_used=panels_used, map_resets=map_resets)


def _pack_status(s: StatusMessage) -> bytes:
    told = {name: limited(getattr(s, name), unknown, unknown=True) for name, unknown in _UNKNOWN.items()}
    told["temperature_c"] = _I8_UNKNOWN if s.temperature_c is None else max(-127, min(127, s.temperature_c))
    return _STATUS.pack(s.state, s.no_fix, *told.values())


def _unpack_status(body: bytes) -> StatusMessage:
    state, no_fix, *packed = _STATUS.unpack(body)
    told = {name: known(value, unknown) for (name, unknown), value in zip(_UNKNOWN.items(), packed, strict=True)}
    if told["throttling"] is not None:
        told["throttling"] &= 0x0F0F
    return StatusMessage(state=State(state), no_fix=NoFix(no_fix), **told)


def _pack_pose(pose: WirePose | None) -> tuple[bytes | int, ...]:
    if pose is None:
        return i24(*[I24_UNKNOWN] * 3), *[_I16_UNKNOWN] * 4, *[DEVIATION_UNKNOWN] * 6
    position = [round(v * UNITS_PER_SI) for v in pose.position_m]
    sign = -1 if pose.quaternion_wxyz[0] < 0 else 1
    norm = math.hypot(*pose.quaternion_wxyz)
    quaternion = [sign * round(v / norm * _Q15) for v in pose.quaternion_wxyz]
    return i24(*position), *quaternion, *pack_deviations(pose.deviation_m), *pack_deviations(pose.deviation_rad)


def _unpack_pose(position: bytes, *others: int) -> WirePose | None:
    x, y, z = from_i24(position)
    q = qw, qx, qy, qz = others[:4]
    if I24_UNKNOWN in (x, y, z) or _I16_UNKNOWN in q:
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


def _pack_state(s: StateMessage) -> bytes:
    position, moving, linked = [I24_UNKNOWN] * 2, [_I16_UNKNOWN] * 3, [_I8_UNKNOWN] * 3
    if s.position_m and s.velocity and s.correlations and s.yaw_rad is not None:
        position = [round(v * UNITS_PER_SI) for v in s.position_m]
        moving = [round(s.yaw_rad * UNITS_PER_SI), *(round(v * UNITS_PER_SI_S) for v in s.velocity)]
        linked = [round(CORRELATION_STEPS * v) for v in s.correlations]
    flags = s.mode | _CONTESTED * s.contested | _PANEL_MOVED * s.panel_moved | _NO_CLOCK * (s.clock_us is None)
    age = limited(s.panel_age_ms, U16, unknown=True)
    way = limited(None if s.way_m is None else round(100 * s.way_m), U16, unknown=True)
    counts = s.map_resets, s.relocalisations, limited(s.panels, 0xFF)
    numbers = *moving, *pack_deviations(s.deviations), *linked
    return _STATE.pack(i24(*position), *numbers, s.clock_us or 0, age, way, flags, *counts)


def _unpack_state(body: bytes) -> StateMessage:
    xy, yaw, speed, rate, *others = _STATE.unpack(body)
    codes, linked, (clock_us, age, way, flags, *counts) = tuple(others[:3]), others[3:6], others[6:]
    check_flags(flags, _MODE | _CONTESTED | _PANEL_MOVED | _NO_CLOCK)
    if flags & _MODE > max(Mode):
        raise UnknownFlagsError(f"mode {flags & _MODE} is not known")
    x, y = from_i24(xy)
    numbers = x, y, yaw, speed, rate, *codes, *linked
    unknown = (I24_UNKNOWN,) * 2 + (_I16_UNKNOWN,) * 3 + (DEVIATION_UNKNOWN,) * 3 + (_I8_UNKNOWN,) * 3
    if any(a == b for a, b in zip(numbers, unknown, strict=True)) != (numbers == unknown):
        raise WireError("a state of which a part is unknown")
    has_pose = numbers != unknown
    xy_r, x_yaw_r, y_yaw_r = (round(code / CORRELATION_STEPS, 4) for code in linked)
    way_cm = known(way, U16)
    return StateMessage(
        position_m=(x / UNITS_PER_SI, y / UNITS_PER_SI) if has_pose else None,
        yaw_rad=yaw / UNITS_PER_SI if has_pose else None,
        velocity=(speed / UNITS_PER_SI_S, rate / UNITS_PER_SI_S) if has_pose else None,
        deviations=unpack_deviations(codes),
        correlations=(xy_r, x_yaw_r, y_yaw_r) if has_pose else None,
        clock_us=None if flags & _NO_CLOCK else clock_us,
        panel_age_ms=known(age, U16),
        way_m=None if way_cm is None else way_cm / 100,
        mode=Mode(flags & _MODE),
        contested=bool(flags & _CONTESTED),
        panel_moved=bool(flags & _PANEL_MOVED),
        map_resets=counts[0],
        relocalisations=counts[1],
        panels=counts[2],
    )


def _pack_odometry(o: OdometryMessage) -> bytes:
    totals = (_I32_UNKNOWN if v is None else v for v in (o.left_100um, o.right_100um, o.yaw_100urad))
    return _ODOMETRY.pack(o.clock_us, *totals, _flags(o, _ODOMETRY_FLAGS))


def _unpack_odometry(body: bytes) -> OdometryMessage:
    clock_us, *totals, flags = _ODOMETRY.unpack(body)
    left, right, yaw = (known(total, _I32_UNKNOWN) for total in totals)
    flagged = _set(flags, _ODOMETRY_FLAGS)
    return OdometryMessage(clock_us=clock_us, left_100um=left, right_100um=right, yaw_100urad=yaw, **flagged)


def _as_they_are(kind: int, message: type[Message], layout: struct.Struct) -> Layout:
    """A body of the record's whole numbers, in its order."""
    names = [field.name for field in fields(message)]
    return Layout(
        kind,
        layout,
        lambda said: layout.pack(*(getattr(said, name) for name in names)),
        lambda body: message(**dict(zip(names, layout.unpack(body), strict=True))),
    )


LAYOUTS: dict[type[Message], Layout] = {
    MarkerMessage: Layout(1, _MARKER, _pack_marker, _unpack_marker),
    FixMessage: Layout(2, _FIX, _pack_fix, _unpack_fix),
    StatusMessage: Layout(3, _STATUS, _pack_status, _unpack_status),
    StateMessage: Layout(4, _STATE, _pack_state, _unpack_state),
    OdometryMessage: Layout(16, _ODOMETRY, _pack_odometry, _unpack_odometry),
    TimeAsk: _as_they_are(17, TimeAsk, struct.Struct("<H")),
    TimeAnswer: _as_they_are(18, TimeAnswer, struct.Struct("<HII")),
}
