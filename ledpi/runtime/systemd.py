"""What a service of Type=notify tells systemd: sd_notify(3) without its library. Elsewhere: nothing."""

from __future__ import annotations

import math
import os
import socket
import time

_TIMEOUT_S = 1.0  # systemd reads at once; the daemon does not hang on it if it should not
_FEEDS = 5  # of the watchdog, in the time that it allows


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
    """How often to send `WATCHDOG=1`: each 2 s of a WatchdogSec=10; None where no watchdog watches us."""
    limit_us, watched = os.environ.get("WATCHDOG_USEC", ""), os.environ.get("WATCHDOG_PID", str(os.getpid()))
    if not limit_us.isdecimal() or int(limit_us) == 0 or watched != str(os.getpid()):
        return None
    return int(limit_us) * 1e-6 / _FEEDS


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
