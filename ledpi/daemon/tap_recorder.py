"""`record` and `record_stop` of the tap: from now on, what is decoded is written as a recording.

A thread of its own writes; the decode thread only copies, where there is room.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future
from typing import Any

from ledpi.core.errors import RecordingError
from ledpi.core.records import Decoded, Frame
from ledpi.daemon.kept_frames import MAX_BYTES, KeptFrame, RecordQueue
from ledpi.daemon.reporting import event
from ledpi.daemon.takes import RECORDED, Shown, Takes
from ledpi.daemon.tap.protocol import MAX_SECONDS, Request

LAST_S = 0.3  # for what still waits when the daemon ends

_log = logging.getLogger("ledpi")


class TapRecorder:
    """A daemon's recordings. `keep` is for its decode thread, `record` and `stop` for the tap's; else its main."""

    def __init__(self, shown: Shown) -> None:
        self._takes = Takes("record", shown)
        self._changing = threading.Lock()
        self._running: tuple[RecordQueue, Future[dict[str, Any]]] | None = None
        self._given_up_s = 0.0  # when the daemon ends: monotonic

    def keep(self, frame: Frame, decoded: Decoded, search_budget: int) -> None:
        """A frame that was just decoded, while its pixels are there, and what it might spend on searching."""
        running = self._running
        if running is not None:
            running[0].keep(frame, decoded, search_budget)

    def record(self, request: Request) -> dict[str, Any]:
        """Until the time is over, `stop`, or the end of the daemon. Returns where it is. Raises RecordingError."""
        camera = self._takes.shown.camera
        with self._changing:
            if self._running is not None:
                raise RecordingError("a recording runs already; record_stop ends it")
            if self._takes.ends.is_set():
                raise RecordingError("the daemon ends")
            queue = RecordQueue(camera.height, camera.width)
            try:
                running = queue, self._takes.submit(self._write, queue, request.seconds or MAX_SECONDS)
            except RecordingError:
                queue.close()
                raise
            self._running = running
        try:
            return running[1].result()
        finally:
            self._running = None

    def stop(self, request: Request) -> dict[str, Any]:
        """Ends what runs; as `record` returns and raises."""
        with self._changing:
            running = self._running
        if running is None:
            raise RecordingError("nothing is being recorded")
        running[0].close()
        return dict(running[1].result())

    def end(self) -> None:
        """The daemon ends: what waits is still written, as far as there is time."""
        with self._changing:
            self._given_up_s = time.monotonic() + LAST_S
            self._takes.stop()
        if (running := self._running) is not None:
            running[0].close()

    def close(self) -> None:
        """As `end`, and waits for it, a moment at most."""
        if not self._takes.ends.is_set():
            self.end()
        if not self._takes.close():
            _log.warning(event("record_failed", reason="the disk is too slow for the daemon's end"))

    def _write(self, queue: RecordQueue, seconds: float) -> dict[str, Any]:
        note = f"{self._takes.shown.source}: as a client of the tap asked"
        take = self._takes.write(RECORDED, note, queue, self._coming(queue, seconds), MAX_BYTES)
        answer = {"path": str(take.path), "frames": take.written, "dropped": queue.dropped}
        _log.info(event("record_saved", **answer))
        return answer

    def _coming(self, queue: RecordQueue, seconds: float) -> Iterator[KeptFrame]:
        """Until the time is over; once the daemon ends, as far as there is time."""
        until_s = time.monotonic() + seconds
        while (kept := queue.next(until_s)) is not None:
            yield kept
            if self._takes.ends.is_set() and time.monotonic() > self._given_up_s:
                queue.abandon()
                return
