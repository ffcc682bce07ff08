"""The service manager's watchdog: it restarts a daemon that makes no progress."""

from __future__ import annotations

import math
import os
import time

from ledpi.runtime.systemd import notify

# Of the watchdog, in the time that it allows: each 1.7 s of a WatchdogSec=10, and at least each 2 s where a tick and a
# frame have to be waited for.
FEEDS = 6


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
