"""Commands of clients to the daemon. Each takes its time, and so runs in a thread of its own."""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Callable, Iterator
from typing import Any, TypeAlias

from ledpi.core.errors import LedpiError, TransientError, one_line
from ledpi.daemon.tap.follower import Follower
from ledpi.daemon.tap.protocol import AT_ONCE, NAMED, Do, Request, error

# Gives what the answer holds beside its type and id, and as `raw` the bytes that follow it. Raises LedpiError or
# OSError where it cannot be done.
Command: TypeAlias = Callable[[Request], dict[str, Any]]

MAY = "root, the daemon's own user and members of the group ledpi may"
_STARTING = "the daemon is starting or ending; ask again later"
_OFF: dict[Do, str] = {
    "save": "rewind is off: nothing is kept that could be saved",
    "odometry": "the daemon takes none; set odometry.source: tap",
}
_BUSY: dict[Do, str] = {
    "save": "the last one is not done yet; ask again later",
    "record": "a recording runs already; record_stop ends it",
    "record_stop": "the recording is ending already",
    **dict.fromkeys(("takes", "take", "take_delete", "reload"), "another client's is not done yet; ask again"),
}


class Commands:
    """Those that this daemon offers. One of each kind runs at a time."""

    def __init__(self, at_end: Callable[[], None]) -> None:
        """`at_end` is called, from the command's thread, when an answer is ready."""
        self._at_end = at_end
        self._offered: dict[Do, Command] = {}
        self._running: set[Do] = set()
        self._threads: dict[Do, threading.Thread] = {}  # the last one of each kind
        self._done: deque[tuple[Follower, dict[str, Any]]] = deque()

    def offer(self, do: Do, command: Command | None) -> None:
        """`None`: no longer."""
        if command is None:
            self._offered.pop(do, None)
        else:
            self._offered[do] = command

    def offered(self, follower: Follower) -> list[Do]:
        """Those that this client may give; who may `record` may also do what is not named."""
        return [do for do in NAMED if do in self._offered] if follower.may_command else []

    def wait(self, seconds: float) -> None:
        """For those that end with the daemon, so long at most for all together. From where `begin` is called."""
        until_s = time.monotonic() + seconds
        for thread in self._threads.values():
            thread.join(max(0.0, until_s - time.monotonic()))

    def begin(self, follower: Follower, request: Request) -> dict[str, Any] | None:
        """Starts it; or the answer, where it is done at once, not permitted, not offered, or already running."""
        do, command = request.do, self._offered.get(request.do)
        if not follower.may_command:
            return error(f"{do}: not permitted; {MAY}", request.id)
        if not self._offered:  # between two daemons, as of a reload
            return error(f"{do}: {_STARTING}", request.id, again=True)
        if command is None:
            return error(f"{do}: {_OFF.get(do, _STARTING)}", request.id)
        if do in AT_ONCE:
            return {"type": "done", "id": request.id, **command(request)}
        if do in self._running:
            return error(f"{do}: {_BUSY[do]}", request.id)
        thread = threading.Thread(target=self._run, args=(command, follower, request), name=f"tap {do}", daemon=True)
        self._running.add(do)
        try:
            thread.start()
        except RuntimeError:
            self._running.discard(do)
            return error(f"{do}: the system gives the daemon no further thread; ask again later", request.id)
        self._threads[do] = thread
        return None

    def done(self) -> Iterator[tuple[Follower, dict[str, Any]]]:
        """The answers that are ready, and whose they are."""
        while self._done:
            yield self._done.popleft()

    def _run(self, command: Command, follower: Follower, request: Request) -> None:
        try:
            answer = {"type": "done", "id": request.id, **command(request)}
        except (LedpiError, OSError) as failure:
            again = isinstance(failure, TransientError)
            answer = error(f"{request.do}: {one_line(str(failure))}", request.id, again=again)
        except Exception as failure:  # whatever it is, the one who asked must hear of it
            answer = error(f"{request.do}: {type(failure).__name__}: {one_line(str(failure))}", request.id)
        self._running.discard(request.do)
        self._done.append((follower, answer))
        self._at_end()
