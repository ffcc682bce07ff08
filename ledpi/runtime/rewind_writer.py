"""The last seconds, written as a recording: in a thread of its own, a picture at a time, with a rest after each."""

from __future__ import annotations

import logging
import queue
import threading
from collections.abc import Iterator
from concurrent.futures import Future
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

from ledpi.core.errors import RecordingError
from ledpi.runtime.frame_buffers import KeptFrame
from ledpi.runtime.reporting import event
from ledpi.runtime.rewind_ring import RewindRing
from ledpi.runtime.takes import Shown, failure_of, make_room, new_take, said_of, write_take

MAX_WAITING = 4
JOIN_S = 0.4
TOUCH_EVERY_S = 0.004  # a picture's memory: sooner than a camera needs it

_log = logging.getLogger("ledpi")


class _Job(NamedTuple):
    cause: str
    kept: list[KeptFrame]
    path: Future[Path]


class RewindWriter:
    """Writes what is taken from a ring into folders of `folder`, one after the other."""

    def __init__(self, ring: RewindRing, folder: Path, shown: Shown) -> None:
        self._ring, self._folder, self._shown = ring, folder, shown
        self._jobs: queue.SimpleQueue[_Job | None] = queue.SimpleQueue()
        self._stop = threading.Event()
        self._untouched = ring.frames
        self._thread = threading.Thread(target=self._run, name="rewind", daemon=True)

    def start(self) -> None:
        """Once, before anything is written."""
        self._thread.start()

    def write(self, cause: str, kept: list[KeptFrame]) -> Future[Path]:
        """Soon; the recording's folder once it is whole, or LedpiError. Raises RecordingError where too many wait."""
        if self._stop.is_set() or self._jobs.qsize() >= MAX_WAITING:
            for each in kept:
                self._ring.give_back(each)
            raise RecordingError("rewind: others are still being written; ask again later")
        job = _Job(cause, kept, Future())
        self._jobs.put(job)
        return job.path

    def stop(self) -> None:
        """Ends after the picture in work. What is being written stays as far as it is: its name ends in `.part`."""
        self._stop.set()
        self._jobs.put(None)

    def close(self) -> None:
        """As `stop`, and waits for that, a moment at most."""
        self.stop()
        if self._thread.is_alive():
            self._thread.join(JOIN_S)

    def _run(self) -> None:
        while (job := self._next()) is not None:
            left = list(reversed(job.kept))
            try:
                path = self._write(job, left)
            except Exception as error:  # whatever it is, the daemon goes on, and who asked hears of it
                said = said_of(error)
                _log.error(event("rewind_failed", cause=job.cause, reason=said))
                job.path.set_exception(failure_of(error, f"rewind: {said}"))
            else:
                _log.info(event("rewind_saved", cause=job.cause, frames=len(job.kept), path=path))
                job.path.set_result(path)
            for each in left:
                self._ring.give_back(each)

    def _next(self) -> _Job | None:
        """Waits for it, and meanwhile sees to the ring's memory."""
        while self._untouched:
            with suppress(queue.Empty):
                return self._jobs.get(timeout=TOUCH_EVERY_S)
            self._ring.touch()
            self._untouched -= 1
        return self._jobs.get()

    def _write(self, job: _Job, left: list[KeptFrame]) -> Path:
        """`left`: what is not written yet, the oldest last."""
        camera = self._shown.camera
        make_room(self._folder, job.cause, len(job.kept) * camera.width * camera.height)
        note = f"the last seconds of {self._shown.source}: {job.cause}"
        begun = new_take(self._folder, self._shown, job.cause, note)
        return write_take(begun, self._ring, self._until_stopped(left), self._stop).path

    def _until_stopped(self, left: list[KeptFrame]) -> Iterator[KeptFrame]:
        while left:
            if self._stop.is_set():
                raise RecordingError(f"the daemon ends, and {len(left)} frames more are not written")
            yield left.pop()
