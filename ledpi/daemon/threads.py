"""Rules for the whole process of a daemon, its workers, and its end."""

from __future__ import annotations

import ctypes
import gc
import logging
import os
import sys
import threading
from collections.abc import Callable
from contextlib import suppress

from ledpi.core.errors import TransientError

# A thread that wants to run waits at most so long for one that computes in Python. The default is 5 ms: so long would
# poses that are ready wait, twice (woken, and before the packet is written), while the picture is searched; and so long
# would frames that are there, for each of the threads that decode, encode and write. Below 20 µs nothing more is won.
SWITCH_INTERVAL_S = 0.00002
# glibc's mallopt(3). What a frame needs is given back, and asked for again by the next; so it is neither mapped anew
# (from 128 KiB on, until glibc has learnt otherwise) nor returned to the system, which it was now and then, 2 MiB at a
# time: a long run's memory went up and down by as much.
_TRIM_THRESHOLD, _MMAP_THRESHOLD = -1, -3
_KEPT_BYTES, _MAPPED_BYTES = 1 << 26, 1 << 24
NO_THREAD = "the system gives this process no further thread; end others, or raise TasksMax= of the unit or ulimit -u"
JOIN_S = 0.4  # for each worker; the whole daemon ends within 1 s


def switch_promptly() -> None:
    """For the whole process, as only that can be set."""
    sys.setswitchinterval(SWITCH_INTERVAL_S)


def keep_memory() -> None:
    """For the whole process, before its threads begin; where the C library is another, nothing."""
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_MMAP_THRESHOLD, _MAPPED_BYTES)
        mallopt(_TRIM_THRESHOLD, _KEPT_BYTES)


def keep_for_good() -> None:
    """For what start-up has made, and stays: looking through it for garbage took 15 ms, now and then.

    What an earlier daemon of this process has left in a cycle would stay as well, so that goes first.
    """
    gc.unfreeze()
    gc.collect()
    gc.freeze()


def is_no_thread(error: BaseException) -> bool:
    """Tells whether Python could not start a thread, for which it has no exception of its own."""
    return isinstance(error, RuntimeError) and "start new thread" in str(error)


def end_threads(status: int, said: str = "") -> None:
    """Ends the process with this status, and these last words, where a thread of it still works; else nothing.

    A frame may be in work that takes longer than anybody waits for it, or a driver may hang. Python would kill such a
    thread as it comes back from C++ (OpenCV's or libcamera's), and C++ abort the process for that.
    """
    if threading.active_count() > 1:
        with suppress(OSError):
            print(said, end="", file=sys.stderr, flush=True)
        logging.shutdown()
        os._exit(status)


Loop = Callable[[], None]


class Workers:
    """A thread for each loop, which must end soon once `stop` is set. It is set, too, where one fails.

    A thread forgets its loop at its end, and nothing else here knows it: whoever's methods the loops are is free then.
    """

    def __init__(self, *loops: Loop) -> None:
        self.stop = threading.Event()
        self.failure: BaseException | None = None  # the first
        self._threads = {
            _name(loop): threading.Thread(target=self._guard, args=(loop,), name=_name(loop), daemon=True)
            for loop in loops
        }

    def start(self) -> None:
        """Once."""
        for thread in self._threads.values():
            thread.start()

    def join(self, loop: Loop) -> bool:
        """Waits for a worker, a moment at most, and tells whether it is at its end; one that never began is."""
        thread = self._threads[_name(loop)]
        if thread.ident is not None:
            thread.join(JOIN_S)
        return not thread.is_alive()

    def _guard(self, loop: Loop) -> None:
        try:
            loop()
        except OSError as error:  # what the system refuses for now; another process may fare better
            self._fail(TransientError(f"{_name(loop)}: {error}"))
        except BaseException as error:
            self._fail(error)

    def _fail(self, error: BaseException) -> None:
        self.failure = self.failure or error
        self.stop.set()


def _name(loop: Loop) -> str:
    return loop.__name__.strip("_")
