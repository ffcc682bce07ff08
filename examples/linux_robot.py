"""A robot that runs Linux: reads ledpi's stream, drives while its fix is young, and otherwise stands still.

python examples/linux_robot.py /dev/ttyUSB0
"""

from __future__ import annotations

import math
import sys
import termios
import time
from collections.abc import Iterator
from typing import NoReturn

import serial

from ledpi.wire import FixMessage, Message, NoFix, Receiver, StatusMessage

EVERY_S = 0.5
TIMEOUT_S = 0.3  # the newest fix may be so old, counted from its picture
LATE_S = 0.1  # since the last look at the port: what has come is of no certain age


class Guard:
    """May the robot drive? The same rule as ledpi_guard in firmware/receiver."""

    def __init__(self) -> None:
        self._exposed_s = -math.inf
        self._no_fix = NoFix.UNKNOWN

    def take(self, message: Message, now_s: float) -> None:
        if isinstance(message, FixMessage):
            self._exposed_s = now_s - message.age_us / 1e6
        elif isinstance(message, StatusMessage):
            self._no_fix = message.no_fix
            if message.no_fix is not NoFix.NONE:
                self._exposed_s = -math.inf

    def may_drive(self, now_s: float) -> bool:
        return now_s - self._exposed_s < TIMEOUT_S

    def why_not(self) -> str:
        """As ledpi said last, in words: `no panel`."""
        if self._no_fix in (NoFix.NONE, NoFix.UNKNOWN):
            return f"no fix for {TIMEOUT_S:g} s"
        return self._no_fix.name.lower().replace("_", " ")


class Narrator:
    """Says each change at once, and where the robot is twice a second."""

    def __init__(self) -> None:
        self._said, self._said_s = "", -math.inf

    def line(self, state: str, where: str, now_s: float) -> str | None:
        if state == self._said and (not where or now_s - self._said_s < EVERY_S):
            return None
        self._said, self._said_s = state, now_s
        return f"{state} {where}".rstrip()


def wrong(said: str) -> NoReturn:
    """Ends with status 2, as a command does that was called wrongly."""
    print(said, file=sys.stderr)
    sys.exit(2)


def heard(port: str) -> Iterator[tuple[list[Message], float]]:
    """Yields what comes, and when (monotonic). What piled up while nobody read is old: it is thrown away."""
    receiver, read_s = Receiver(), -math.inf
    try:
        with serial.Serial(port, 115200, timeout=0.02) as line:
            while True:
                data, now_s = line.read(max(1, line.in_waiting)), time.monotonic()
                if now_s - read_s > LATE_S:
                    line.reset_input_buffer()
                    data = b""
                read_s = now_s
                yield receiver.feed(data), now_s
    except (serial.SerialException, termios.error) as error:
        wrong(f"{port}: {error}; must be the serial port that ledpi writes to")


def main() -> None:
    if len(sys.argv) != 2:
        wrong("usage: python examples/linux_robot.py PORT")
    guard, narrator, where = Guard(), Narrator(), ""
    for messages, came_s in heard(sys.argv[1]):
        for message in messages:
            guard.take(message, came_s)
            if isinstance(message, FixMessage):
                x, y, _ = message.pose.position_m
                where = f"at {x:.3f} {y:.3f} m"
        now_s = time.monotonic()
        drives = guard.may_drive(now_s)
        # Your motors belong here, at every turn; what is printed is for a person.
        said = narrator.line("drive" if drives else f"stop: {guard.why_not()}", where if drives else "", now_s)
        if said is not None:
            print(said, flush=True)


if __name__ == "__main__":
    main()
