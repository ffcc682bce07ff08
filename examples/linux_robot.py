"""A robot that runs Linux: reads ledpi's stream, drives while its fix is young, and otherwise stands still.

    python examples/linux_robot.py /dev/ttyUSB0
"""

from __future__ import annotations

import math
import sys
import time

import serial

from ledpi.wire import FixMessage, Message, NoFix, Receiver, StatusMessage

TIMEOUT_S = 0.3  # the newest fix may be so old, counted from its picture


class Guard:
    """May the robot drive? The same rule as ledpi_guard in firmware/receiver."""

    def __init__(self) -> None:
        self._exposed_s = -math.inf

    def take(self, message: Message, now_s: float) -> None:
        if isinstance(message, FixMessage):
            self._exposed_s = now_s - message.age_us / 1e6
        elif isinstance(message, StatusMessage) and message.no_fix is not NoFix.NONE:
            self._exposed_s = -math.inf

    def may_drive(self, now_s: float) -> bool:
        return now_s - self._exposed_s < TIMEOUT_S


def main() -> None:
    if len(sys.argv) != 2:
        sys.exit("usage: python examples/linux_robot.py PORT")
    receiver, guard = Receiver(), Guard()
    with serial.Serial(sys.argv[1], 115200, timeout=0.02) as line:
        line.reset_input_buffer()  # what piled up before we listened is old
        while True:
            for message in receiver.feed(line.read(max(1, line.in_waiting))):
                guard.take(message, time.monotonic())
                if isinstance(message, FixMessage):
                    x, y, _ = message.pose.position_m
                    print(f"at {x:.3f} {y:.3f} m")
            print("drive" if guard.may_drive(time.monotonic()) else "stop")


if __name__ == "__main__":
    main()
