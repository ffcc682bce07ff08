"""Reports of a run: lines of the journal, key=value where a program may read them, and words to systemd."""

from __future__ import annotations

import json
import logging
import math
import os
import select
import socket
import sys
import time
from typing import TextIO

_TIMEOUT_S = 1.0  # systemd reads at once; the daemon does not hang on it if it should not
# Of the watchdog, in the time that it allows: each 1.7 s of a WatchdogSec=10, and at least each 2 s where a tick and a
# frame have to be waited for.
FEEDS = 6
_PRIORITIES = {logging.ERROR: 3, logging.WARNING: 4, logging.INFO: 6, logging.DEBUG: 7}  # syslog's


def notify(message: str) -> bool:
    """Sends `READY=1`, `WATCHDOG=1`, `STOPPING=1` or `STATUS=…`. Returns whether systemd got it.

    False where no service manager listens (NOTIFY_SOCKET is not set), or where its socket is gone: a daemon
    goes on without.
    """
    address = os.environ.get("NOTIFY_SOCKET", "")
    if not address.startswith(("/", "@")):
        return False
    if address.startswith("@"):
        address = "\0" + address[1:]  # an abstract socket, which has no file
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM | socket.SOCK_CLOEXEC) as sender:
            sender.settimeout(_TIMEOUT_S)
            sender.sendto(message.encode(), address)
    except OSError:
        return False
    return True


def watchdog_period_s() -> float | None:
    """Returns how often to send `WATCHDOG=1`: each 1.7 s of a WatchdogSec=10; None where no watchdog watches us."""
    limit_us, watched = os.environ.get("WATCHDOG_USEC", ""), os.environ.get("WATCHDOG_PID", str(os.getpid()))
    if not limit_us.isdecimal() or int(limit_us) == 0 or watched != str(os.getpid()):
        return None
    return int(limit_us) * 1e-6 / FEEDS


class Watchdog:
    """The service manager's, which is fed as long as there is progress."""

    def __init__(self) -> None:
        self._period_s = watchdog_period_s()
        # The first step counts at once: after a reload it was last fed before the camera was opened.
        self._fed_s, self._fed_steps = -math.inf, 0

    def update(self, steps: int) -> None:
        """Sends `WATCHDOG=1` if it is time, and if more `steps` are done than when it was sent last."""
        now_s = time.monotonic()
        if self._period_s is not None and now_s - self._fed_s >= self._period_s and steps > self._fed_steps:
            notify("WATCHDOG=1")
            self._fed_s, self._fed_steps = now_s, steps


def is_service() -> bool:
    """Tells whether a service manager has started us, and its journal takes our lines."""
    return "NOTIFY_SOCKET" in os.environ


class _JournalFormatter(logging.Formatter):
    """sd-daemon(3): `<4>` at a line's start gives it its priority in the journal."""

    def format(self, record: logging.LogRecord) -> str:
        text = " ".join(super().format(record).split("\n"))
        return f"<{_PRIORITIES.get(record.levelno, 5)}>{text}"


class _NeverWaiting(logging.StreamHandler):  # type: ignore[type-arg]  # Python 3.10 has none at run time
    """Drops what nobody takes, as of a pager that waits or a terminal that was stopped with Ctrl-S.

    Else each thread that has something to say would wait, the heartbeat's and the watchdog's too, and SIGTERM end none.
    """

    def emit(self, record: logging.LogRecord) -> None:
        """A line is less than what a pipe or a socket has room for once it is ready."""
        if _is_ready(self.stream):
            super().emit(record)


def _is_ready(stream: TextIO) -> bool:
    """Tells whether it takes a line at once; a file always does."""
    try:
        poll = select.poll()
        poll.register(stream.fileno(), select.POLLOUT)
        return bool(poll.poll(0))
    except (OSError, ValueError, AttributeError):  # it is none of the system's, or none at all
        return True


def log_to_standard_error() -> None:
    """With the level as a word; in a service, as the journal's priority. Never waits for who reads it."""
    handler = _NeverWaiting(sys.stderr)
    handler.setFormatter(_JournalFormatter() if is_service() else logging.Formatter("%(levelname)s %(message)s"))
    logging.basicConfig(level=logging.INFO, handlers=[handler])


def event(name: str, **values: object) -> str:
    """A line such as `serial_lost port=/dev/ttyACM0 error="no such device"`; what is None is left out."""
    return " ".join([name, *(f"{key}={_quoted(value)}" for key, value in values.items() if value is not None)])


def _quoted(value: object) -> str:
    if isinstance(value, bool):
        return "yes" if value else "no"
    text = f"{value:.6g}" if isinstance(value, float) else str(value)
    return text if text and not set(text) & set(' "=\n') else json.dumps(text, ensure_ascii=False)
