"""Bodies of the two-way line's messages. Pure; codec.py frames them, docs/wire.md is the contract."""

from __future__ import annotations

import struct

from ledpi.core.errors import WireError
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
    UNITS_PER_SI_S,
    Mode,
    OdometryMessage,
    StateMessage,
    TimeAnswer,
    TimeAsk,
)

STATE = struct.Struct(
    "<6s3h3B3bIHHBBBB"
)  # x and y, yaw and velocity, deviations, correlations, then the record's order
ODOMETRY = struct.Struct("<I3iB")
TIME_ASK = struct.Struct("<H")
TIME_ANSWER = struct.Struct("<HII")

_I16_UNKNOWN, _I32_UNKNOWN = -0x8000, -0x80000000
_CORRELATION_UNKNOWN = -128
_MODE, _CONTESTED, _PANEL_MOVED, _NO_CLOCK = 7, 8, 16, 32  # of a state's byte of mode and flags
_RESTARTED, _LIFTED, _SLIPPING = 1, 2, 4  # odometry's flags


def pack_state(s: StateMessage) -> bytes:
    position, moving = [I24_UNKNOWN] * 2, [_I16_UNKNOWN] * 3
    linked = [_CORRELATION_UNKNOWN] * 3
    if s.position_m and s.velocity and s.correlations and s.yaw_rad is not None:
        position = [round(v * UNITS_PER_SI) for v in s.position_m]
        moving = [round(s.yaw_rad * UNITS_PER_SI), *(round(v * UNITS_PER_SI_S) for v in s.velocity)]
        linked = [round(CORRELATION_STEPS * v) for v in s.correlations]
    flags = s.mode | _CONTESTED * s.contested | _PANEL_MOVED * s.panel_moved | _NO_CLOCK * (s.clock_us is None)
    return STATE.pack(
        i24(*position),
        *moving,
        *pack_deviations(s.deviations),
        *linked,
        s.clock_us or 0,
        limited(s.panel_age_ms, U16, unknown=True),
        limited(None if s.way_m is None else round(100 * s.way_m), U16, unknown=True),
        flags,
        s.map_resets,
        s.relocalisations,
        limited(s.panels, 0xFF),
    )


def unpack_state(body: bytes) -> StateMessage:
    xy, yaw, speed, rate, *others = STATE.unpack(body)
    codes, linked, (clock_us, age, way, flags, *counts) = tuple(others[:3]), others[3:6], others[6:]
    check_flags(flags, _MODE | _CONTESTED | _PANEL_MOVED | _NO_CLOCK)
    if flags & _MODE > max(Mode):
        raise UnknownFlagsError(f"mode {flags & _MODE} is not known")
    x, y = from_i24(xy)
    numbers = x, y, yaw, speed, rate, *codes, *linked
    unknown = (I24_UNKNOWN,) * 2 + (_I16_UNKNOWN,) * 3 + (DEVIATION_UNKNOWN,) * 3 + (_CORRELATION_UNKNOWN,) * 3
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


def pack_odometry(o: OdometryMessage) -> bytes:
    totals = (_I32_UNKNOWN if v is None else v for v in (o.left_100um, o.right_100um, o.yaw_100urad))
    flags = _RESTARTED * o.restarted | _LIFTED * o.lifted | _SLIPPING * o.slipping
    return ODOMETRY.pack(o.clock_us, *totals, flags)


def unpack_odometry(body: bytes) -> OdometryMessage:
    clock_us, left, right, yaw, flags = ODOMETRY.unpack(body)
    check_flags(flags, _RESTARTED | _LIFTED | _SLIPPING)
    return OdometryMessage(
        clock_us=clock_us,
        left_100um=known(left, _I32_UNKNOWN),
        right_100um=known(right, _I32_UNKNOWN),
        yaw_100urad=known(yaw, _I32_UNKNOWN),
        restarted=bool(flags & _RESTARTED),
        lifted=bool(flags & _LIFTED),
        slipping=bool(flags & _SLIPPING),
    )


def pack_time_ask(ask: TimeAsk) -> bytes:
    return TIME_ASK.pack(ask.number)


def unpack_time_ask(body: bytes) -> TimeAsk:
    return TimeAsk(number=TIME_ASK.unpack(body)[0])


def pack_time_answer(answer: TimeAnswer) -> bytes:
    return TIME_ANSWER.pack(answer.number, answer.arrived_us, answer.left_us)


def unpack_time_answer(body: bytes) -> TimeAnswer:
    number, arrived_us, left_us = TIME_ANSWER.unpack(body)
    return TimeAnswer(number=number, arrived_us=arrived_us, left_us=left_us)
