"""Waits for another thread or process: each ends, and says what did not come."""

from __future__ import annotations

import inspect
import os
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, partial
from typing import TypeVar

IDLE_S = 10.0  # on an idle machine
REFERENCE_S = 0.02  # what the fixed computation takes on a usual one

T = TypeVar("T")


def limit_s(idle_s: float = IDLE_S) -> float:
    """Returns how long it may take: the slower the machine, and the more others want of it, the longer."""
    return idle_s * machine() * (1.0 + os.getloadavg()[0] / (os.cpu_count() or 1))


@cache
def machine() -> float:
    """Returns how many times as long as on a usual one a fixed computation takes; what others take does not count."""
    began_s = time.thread_time()
    sum(number * number for number in range(300_000))
    return max(1.0, (time.thread_time() - began_s) / REFERENCE_S)


def pause() -> None:
    """Lets others work."""
    time.sleep(0.005)


def wait_until(there: Callable[[], T], what: str = "", meanwhile: Callable[[], object] = pause) -> T:
    """Returns what `there` gives as soon as it is true; `meanwhile` is called as often as it is not."""
    began_s = time.monotonic()
    while not (found := there()):
        waited_s = time.monotonic() - began_s
        if waited_s > limit_s():
            raise AssertionError(f"did not come within {waited_s:.0f} s: {what or _source(there)}")
        meanwhile()
    return found


def _source(there: Callable[[], object]) -> str:
    """Returns the line that says what is waited for."""
    try:
        return inspect.getsource(there.func if isinstance(there, partial) else there).strip()
    except (OSError, TypeError):  # typed in, or of C
        return repr(there)


@contextmanager
def killed_if_late(process: subprocess.Popen[str], idle_s: float = IDLE_S) -> Iterator[None]:
    """Whoever reads what it says is not held for ever by one that says nothing."""
    late = threading.Timer(limit_s(idle_s), process.kill)
    late.start()
    try:
        yield
    finally:
        late.cancel()
