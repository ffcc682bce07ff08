"""A daemon's workers: threads that end together, and the failure that ended them."""

from __future__ import annotations

import threading
from collections.abc import Callable

from ledpi.core.errors import TransientError

JOIN_S = 0.4  # for each worker; the whole daemon ends within 1 s

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
