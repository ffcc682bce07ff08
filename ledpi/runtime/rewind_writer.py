"""What was kept, written as a recording: in a thread of its own, one picture at a time, with a rest after each."""

from __future__ import annotations

import json
import logging
import os
import queue
import re
import shutil
import threading
import time
from concurrent.futures import Future
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import NamedTuple

from ledpi.core.errors import LedpiError, RecordingError
from ledpi.core.records import CameraInfo, PanelSpec
from ledpi.pipeline.output import decoded_as_json
from ledpi.pipeline.state_file import STATE_FILE, as_bytes
from ledpi.recording.writer import RecordingWriter
from ledpi.runtime.recorder import LIVE_FILE
from ledpi.runtime.reporting import event
from ledpi.runtime.rewind_ring import Kept, RewindRing

PART = ".part"  # how the name of a recording ends until it is whole
AUTOMATIC = ("camera_lost", "contradicted")  # causes that nobody asked for
MOST_AUTOMATIC = 5  # recordings of these that stay
MOST_WAITING = 4
LEAST_FREE_BYTES = 100_000_000  # that a disk has left afterwards: a full one stops more than this
JOIN_S = 0.4
TOUCH_EVERY_S = 0.004  # a picture's memory: sooner than a camera needs it

_OLD = re.compile(rf"\d{{8}}T\d{{6}}Z-({'|'.join(AUTOMATIC)})(-\d+)?({re.escape(PART)})?")

_log = logging.getLogger("ledpi")


class Shown(NamedTuple):
    """What a recording says of its camera and its panels."""

    camera: CameraInfo
    dictionary: str
    panel: PanelSpec
    source: str


class _Job(NamedTuple):
    cause: str
    kept: list[Kept]
    path: Future[Path]


class RewindWriter:
    """Writes what is taken from a ring into folders of `folder`, one after the other.

    It rests as long as it works while frames come. It asks for no lower priority: whoever takes the interpreter must
    not be kept from giving it back, or the decoder would wait for both.
    """

    def __init__(self, ring: RewindRing, folder: Path, shown: Shown) -> None:
        self._ring, self._folder, self._shown = ring, folder, shown
        self._jobs: queue.SimpleQueue[_Job | None] = queue.SimpleQueue()
        self._stop = threading.Event()
        self._untouched = ring.frames
        self._thread = threading.Thread(target=self._run, name="rewind", daemon=True)

    def start(self) -> None:
        """Once, before anything is written."""
        self._thread.start()

    def write(self, cause: str, kept: list[Kept]) -> Future[Path]:
        """Soon; the recording's folder once it is whole, or LedpiError. Raises RecordingError where too many wait."""
        if self._stop.is_set() or self._jobs.qsize() >= MOST_WAITING:
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
            except (LedpiError, OSError) as error:
                said = str(error) if isinstance(error, LedpiError) else f"{error.filename}: {error.strerror or error}"
                _log.error(event("rewind_failed", cause=job.cause, reason=said))
                job.path.set_exception(RecordingError(f"rewind: {said}"))
            except Exception as error:  # whatever it is, the daemon goes on, and who asked hears of it
                _log.error(event("rewind_failed", cause=job.cause, reason=f"{type(error).__name__}: {error}"))
                job.path.set_exception(error)
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

    def _write(self, job: _Job, left: list[Kept]) -> Path:
        """`left`: what is not written yet, the oldest last."""
        self._make_room(job)
        path = self._new_path(job.cause)
        part = path.with_name(path.name + PART)
        try:
            self._write_into(part, path.name, job, left)
        except BaseException:
            if len(left) == len(job.kept):  # without a frame it is none
                shutil.rmtree(part, ignore_errors=True)
            raise
        part.rename(path)
        return path

    def _write_into(self, part: Path, name: str, job: _Job, left: list[Kept]) -> None:
        camera, dictionary, panel, source = self._shown
        note = f"the last seconds of {source}: {job.cause}"
        with RecordingWriter(part, camera=camera, dictionary=dictionary, panel=panel, note=note) as writer:
            state = job.kept[0].state
            assert state is not None
            (part / STATE_FILE).write_bytes(as_bytes(state))
            with (part / LIVE_FILE).open("x", encoding="utf-8", buffering=1) as live:
                while left:
                    if self._stop.is_set():
                        done = len(job.kept) - len(left)
                        raise RecordingError(f"{part}: cut off after {done} of {len(job.kept)} frames: the daemon ends")
                    began_s, seen = time.monotonic(), self._ring.seen
                    kept = left[-1]
                    frame = self._ring.picture_of(kept)
                    writer.write(frame, decoded=True, search_budget=kept.search_budget)
                    live.write(json.dumps(decoded_as_json(kept.decoded, name)) + "\n")
                    self._ring.give_back(left.pop())
                    if self._ring.seen > seen:
                        self._stop.wait(time.monotonic() - began_s)

    def _make_room(self, job: _Job) -> None:
        """Forgets the oldest of those that nobody asked for. Raises RecordingError where the disk is too full."""
        self._folder.mkdir(parents=True, exist_ok=True)
        if job.cause in AUTOMATIC:
            old = sorted(path for path in self._folder.iterdir() if _OLD.fullmatch(path.name) and path.is_dir())
            for path in old[: max(0, len(old) - MOST_AUTOMATIC + 1)]:
                shutil.rmtree(path, ignore_errors=True)
        picture = self._shown.camera.width * self._shown.camera.height
        status = os.statvfs(self._folder)
        free, wanted = status.f_bavail * status.f_frsize, len(job.kept) * picture + LEAST_FREE_BYTES
        if free < wanted:
            raise RecordingError(
                f"{self._folder}: the disk has {free / 1e6:.0f} MB left; {wanted / 1e6:.0f} MB are needed"
            )

    def _new_path(self, cause: str) -> Path:
        name = f"{datetime.now(UTC):%Y%m%dT%H%M%SZ}-{cause}"
        for number in range(1, 1000):
            path = self._folder / (name if number == 1 else f"{name}-{number}")
            if not path.exists() and not path.with_name(path.name + PART).exists():
                return path
        raise RecordingError(f"{self._folder / name}: is there a thousand times; is the clock stuck?")
