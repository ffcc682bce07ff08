"""`record` and `record_stop` of the tap: from now on, what is decoded is written as a recording.

The thread in which the tap runs the command writes; the decode thread only copies, where there is room.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator
from concurrent.futures import Future, wait
from typing import Any

from ledpi.core.errors import RecordingError
from ledpi.core.records import CameraInfo, Decoded, Frame
from ledpi.pipeline.pipeline import Pipeline
from ledpi.runtime.frame_buffers import KeptFrame
from ledpi.runtime.record_queue import MAX_BYTES, RecordQueue
from ledpi.runtime.reporting import event
from ledpi.runtime.takes import Shown, failure_of, make_room, new_take, said_of, takes_folder, write_take
from ledpi.tap.protocol import MAX_SECONDS, Request

RECORDED = "recorded"  # in the name
LAST_S = 0.3  # for what still waits when the daemon ends
JOIN_S = 0.4

_log = logging.getLogger("ledpi")


class _Recording:
    """One that runs."""

    def __init__(self, height: int, width: int) -> None:
        self.queue = RecordQueue(height, width)
        self.result: Future[dict[str, Any]] = Future()


class TapRecorder:
    """A daemon's recordings. `keep` is for its decode thread, `record` and `stop` for the tap's; else its main."""

    def __init__(self, pipeline: Pipeline, camera: CameraInfo, source: str) -> None:
        """`camera`: with the lens that poses are solved with."""
        self._shown = Shown(camera, pipeline.panels.dictionary, pipeline.panels.spec(), source)
        self._folder = takes_folder()
        self._changing = threading.Lock()
        self._running: _Recording | None = None
        self._ends = threading.Event()  # the daemon
        self._given_up_s = 0.0  # then: monotonic

    def keep(self, frame: Frame, decoded: Decoded, search_budget: int) -> None:
        """A frame that was just decoded, while its pixels are there, and what it might spend on searching."""
        running = self._running
        if running is not None:
            running.queue.keep(frame, decoded, search_budget)

    def record(self, request: Request) -> dict[str, Any]:
        """Until the time is over, `stop`, or the end of the daemon. Returns where it is. Raises RecordingError."""
        running = self._begin()
        try:
            answer = self._write(running.queue, request.seconds or MAX_SECONDS)
        except Exception as error:  # whatever it is, whoever asked must hear of it
            failure = failure_of(error, said_of(error))
            _log.error(event("record_failed", reason=failure))
            self._running = None
            running.result.set_exception(failure)
            raise failure from None
        _log.info(event("record_saved", **answer))
        self._running = None
        running.result.set_result(answer)
        return answer

    def stop(self, request: Request) -> dict[str, Any]:
        """Ends what runs; as `record` returns and raises."""
        running = self._running
        if running is None:
            raise RecordingError("nothing is being recorded")
        running.queue.close()
        return dict(running.result.result())

    def end(self) -> None:
        """The daemon ends: what waits is still written, as far as there is time."""
        with self._changing:
            self._given_up_s = time.monotonic() + LAST_S
            self._ends.set()
        if (running := self._running) is not None:
            running.queue.close()

    def close(self) -> None:
        """As `end`, and waits for it, a moment at most."""
        if not self._ends.is_set():
            self.end()
        if (running := self._running) is not None:
            done, _ = wait([running.result], JOIN_S)
            if not done:
                _log.warning(event("record_failed", reason="the disk is too slow for the daemon's end"))

    def _begin(self) -> _Recording:
        if self._running is not None:
            raise RecordingError("a recording runs already; record_stop ends it")
        try:
            make_room(self._folder, RECORDED, MAX_BYTES)
        except OSError as error:
            raise failure_of(error, said_of(error)) from None
        made = _Recording(self._shown.camera.height, self._shown.camera.width)
        with self._changing:
            if self._ends.is_set():
                raise RecordingError("the daemon ends")
            self._running = made
        return made

    def _write(self, queue: RecordQueue, seconds: float) -> dict[str, Any]:
        begun = new_take(self._folder, self._shown, RECORDED, f"{self._shown.source}: as a client of the tap asked")
        take = write_take(begun, queue, self._coming(queue, seconds), self._ends)
        return {"path": str(take.path), "frames": take.written, "dropped": queue.dropped}

    def _coming(self, queue: RecordQueue, seconds: float) -> Iterator[KeptFrame]:
        """Until the time is over; once the daemon ends, as far as there is time."""
        until_s = time.monotonic() + seconds
        while (kept := queue.next(until_s)) is not None:
            yield kept
            if self._ends.is_set() and time.monotonic() > self._given_up_s:
                queue.abandon()
                return
