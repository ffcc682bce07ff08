"""Packets of an autopilot that are of use here, among all that it says. Knows neither clock nor port.

Hundreds of packets a second come from an autopilot. Only those of these kinds are taken apart: its questions for our
clock and its answers of its own (TIMESYNC), and what moves it: the ways of its wheels, and its rate of turn. Its pose
is never read: its filter holds our fixes, and we would hear our own echo.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

from ledpi.wire.codec import ReceiverCounters
from ledpi.wire.message import Message, SyncAnswer
from ledpi.wire.numbers import UNITS_PER_SI, wrapped32
from ledpi.wire.state_message import TOTAL_MAX, U16, U32, OdometryMessage, TimeAnswer

_FRAMING, _SIGNATURE, _HEAD = 12, 13, 10  # bytes beside what a packet holds; of a signed one; before what it holds
_LATER = 2  # bytes that newer dialects add to a packet: whom a TIMESYNC is for
STALE_US = 250_000  # without wheels, or without a rate, which are not known then
MOST_M, MOST_RAD_S = 1e9, 70.0  # that wheels go, and twice what gyros measure: more is no measurement
_NOTHING = ReceiverCounters(good=0, lost=0, restarts=0, bad={}, skipped={})


class _Packets:
    """Finds those of some kinds in bytes as they come; not our own, as an echo brings them."""

    def __init__(self, dialect: Any, kinds: Iterable[int]) -> None:
        self._reader, self._error, self._own = dialect.MAVLink(None), dialect.MAVError, own_component(dialect)
        self._most = {kind.to_bytes(3, "little"): dialect.mavlink_map[kind].unpacker.size for kind in kinds}
        # MAVLink 2: a packet's length, flags, number, system, component, kind.
        self._start = re.compile(rb"\xfd(.)([\0\1]).{4}(" + b"|".join(map(re.escape, self._most)) + b")", re.DOTALL)
        self._waiting = b""

    def heard(self, data: bytes) -> list[Any]:
        data, at = self._waiting + data, 0
        whole: list[Any] = []
        while found := self._start.search(data, at):
            at, length = found.start(), found[1][0]
            end = at + _FRAMING + length + _SIGNATURE * found[2][0]
            if length <= self._most[found[3]] + _LATER and end > len(data):
                self._waiting = data[at:]
                return whole
            try:
                packet = self._reader.decode(bytearray(data[at:end]))
            except self._error:  # no packet after all, or a damaged one
                at += 1
                continue
            at = end
            if packet.get_srcComponent() != self._own:
                whole.append(packet)
        self._waiting = data[max(at, len(data) - _HEAD + 1) :]
        return whole


def own_component(dialect: Any) -> int:
    """Number of our part of the vehicle."""
    return int(dialect.MAV_COMP_ID_VISUAL_INERTIAL_ODOMETRY)


class TimeQuestions:
    """An autopilot's questions for our clock."""

    def __init__(self, dialect: Any) -> None:
        self._packets = _Packets(dialect, (dialect.MAVLINK_MSG_ID_TIMESYNC,))

    def heard(self, data: bytes, now_ns: int) -> list[SyncAnswer]:
        """Takes what has come; returns what is to be answered. An answer is no question."""
        packets = self._packets.heard(data)
        return [SyncAnswer(asked_ns=packet.ts1, arrived_ns=now_ns) for packet in packets if packet.tc1 == 0]


class AutopilotReceiver:
    """The messages of a controller (ledpi.wire.codec) that an autopilot's packets stand for.

    Its stamps are compared modulo 2³² µs: ArduPilot's Rover has its wheels' of 32 bits, which is 71 minutes.
    """

    counters = _NOTHING  # what comes beside these is no mistake

    def __init__(self, dialect: Any, system: int) -> None:
        """`system`: the vehicle's; others may be on the line."""
        self._packets = _Packets(
            dialect,
            (dialect.MAVLINK_MSG_ID_TIMESYNC, dialect.MAVLINK_MSG_ID_ATTITUDE, dialect.MAVLINK_MSG_ID_WHEEL_DISTANCE),
        )
        self._source = system, int(dialect.MAV_COMP_ID_AUTOPILOT1)
        self._wheels_us: int | None = None  # when they were told last, on its clock
        self._rate: tuple[int, float] | None = None  # when it was told last, and what it was; rad/s to the left
        self._yaw_rad = 0.0
        self._restarted = True

    def feed(self, data: bytes) -> list[Message]:
        """The messages that `data` completes, oldest first."""
        packets = [p for p in self._packets.heard(data) if (p.get_srcSystem(), p.get_srcComponent()) == self._source]
        return [message for packet in packets for message in self._messages(packet)]

    def _messages(self, packet: Any) -> list[Message]:
        kind = packet.get_type()
        if kind == "TIMESYNC":
            clock_us = packet.tc1 // 1000 & U32
            answer = TimeAnswer(number=packet.ts1 & U16, arrived_us=clock_us, left_us=clock_us)
            return [answer] if packet.tc1 > 0 else []
        if kind == "ATTITUDE":
            t_us = 1000 * packet.time_boot_ms
            if not abs(packet.yawspeed) < MOST_RAD_S:
                return []
            self._turn(t_us, -packet.yawspeed)  # its z points down
            # Its stamps are whole milliseconds: of one moment it looks older than wheels that have microseconds.
            has_wheels = self._wheels_us is not None and abs(wrapped32(t_us - self._wheels_us)) <= STALE_US
            return [] if has_wheels else [self._odometry(t_us, (None, None))]
        wheels = packet.distance[:2]
        if packet.count < 2 or not all(abs(way) < MOST_M for way in wheels):
            return []
        self._wheels_us = packet.time_usec
        return [self._odometry(packet.time_usec, (_total(wheels[0]), _total(wheels[1])))]

    def _turn(self, t_us: int, rate: float) -> None:
        """Adds up the yaw: by the mean of the rates at both ends."""
        since_us = None if self._rate is None else wrapped32(t_us - self._rate[0])
        if self._rate is not None and since_us is not None and 0 <= since_us <= STALE_US:
            self._yaw_rad += since_us * 1e-6 * (rate + self._rate[1]) / 2
        else:
            self._restarted = True
        self._rate = t_us, rate

    def _odometry(self, t_us: int, wheels: tuple[int | None, int | None]) -> OdometryMessage:
        since_us = None if self._rate is None else wrapped32(t_us - self._rate[0])
        yaw = None
        if self._rate is not None and since_us is not None and abs(since_us) <= STALE_US:
            yaw = _total(self._yaw_rad + since_us * 1e-6 * self._rate[1])
        restarted, self._restarted = self._restarted, False
        left, right = wheels
        return OdometryMessage(
            clock_us=t_us & U32, left_100um=left, right_100um=right, yaw_100urad=yaw, restarted=restarted
        )


def _total(value: float) -> int:
    """In units of the wire, wrapping past the unknown value."""
    return max(-TOTAL_MAX, wrapped32(round(value * UNITS_PER_SI)))
