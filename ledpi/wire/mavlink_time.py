"""An autopilot's questions for our clock (TIMESYNC) among all that it says. Knows neither clock nor port.

Hundreds of packets a second come from an autopilot. Only those of this kind are taken apart.
"""

from __future__ import annotations

import re
from typing import Any

from ledpi.wire.message import SyncAnswer

# The start of a MAVLink 2 packet of message 111: its length, flags, number, system, component.
_TIMESYNC = re.compile(rb"\xfd([\0-\x12])([\0\1]).{4}\x6f\0\0", re.DOTALL)
_FRAMING, _SIGNATURE = 12, 13  # bytes beside what it holds; and of a signed one
_HEAD = 10


class TimeQuestions:
    """Finds them in bytes as they come."""

    def __init__(self, dialect: Any) -> None:
        self._reader, self._error = dialect.MAVLink(None), dialect.MAVError
        self._waiting = b""

    def heard(self, data: bytes, now_ns: int) -> list[SyncAnswer]:
        """Takes what has come; returns what is to be answered. An answer, as an echo of ours, is no question."""
        data, at = self._waiting + data, 0
        answers: list[SyncAnswer] = []
        while found := _TIMESYNC.search(data, at):
            at, end = found.start(), found.start() + _FRAMING + found[1][0] + _SIGNATURE * found[2][0]
            if end > len(data):
                self._waiting = data[at:]
                return answers
            try:
                question = self._reader.decode(bytearray(data[at:end]))
            except self._error:  # no packet after all, or a damaged one
                at += 1
                continue
            at = end
            if question.tc1 == 0:
                answers.append(SyncAnswer(asked_ns=question.ts1, arrived_ns=now_ns))
        self._waiting = data[max(at, len(data) - _HEAD + 1) :]
        return answers
