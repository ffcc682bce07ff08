"""The other direction of the line: a thread that reads what a controller says, while the port is open."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Protocol

from ledpi.core.errors import WireError
from ledpi.wire.line import SerialLine

LOOK_S = 0.1  # after which the thread looks whether it is to end


class Ear(Protocol):
    """Whoever hears what comes in. Called from the publisher's threads; must not wait."""

    def opened(self) -> None:
        """The port is open, anew: what was heard of a message is none."""

    def asked(self, number: int, first_byte_ns: int) -> None:
        """A question for the controller's clock has left."""

    def heard(self, data: bytes, now_ns: int) -> None:
        """Bytes have just come."""


@contextmanager
def listening(line: SerialLine, hear: Callable[[bytes, int], None] | None) -> Iterator[None]:
    """Reads, in a thread of its own, as long as the context lasts; or until the port is lost, which writing shows.

    `hear` takes what has come, and when; None: nothing is read.
    """
    if hear is None:
        yield
        return
    ends = threading.Event()

    def listen() -> None:
        with suppress(WireError):
            while not ends.is_set():
                data = line.read(LOOK_S)
                if data:
                    hear(data, time.monotonic_ns())

    thread = threading.Thread(target=listen, name="ear", daemon=True)
    thread.start()
    try:
        yield
    finally:
        ends.set()
        thread.join()
