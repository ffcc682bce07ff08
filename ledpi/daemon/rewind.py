"""Recordings beside the daemon's work: its last seconds (rewind), and what a client of the tap asks for (record).

A thread of its own writes; the decode thread only copies, where there is room.
"""

from __future__ import annotations

import logging
import os
import threading
import time
from collections import deque
from collections.abc import Iterator
from concurrent.futures import Future
from pathlib import Path
from typing import Any

from ledpi.config.settings import RewindSettings
from ledpi.core.errors import RecordingError
from ledpi.core.records import Decoded, Frame
from ledpi.daemon.kept_frames import MAX_BYTES, KeptFrame, RecordQueue, RewindRing
from ledpi.daemon.reporting import event
from ledpi.daemon.takes import RECORDED, Shown, Takes
from ledpi.daemon.tap.protocol import MAX_SECONDS, Request
from ledpi.pose.fix_history import CONTRADICTION

ASKED, CAMERA_LOST, CONTRADICTED = "asked", "camera_lost", "contradicted"
AGAIN_NS = 60_000_000_000  # a fault that comes back sooner is the same one
MEMORY_SHARE = 8  # of the machine's memory: one part in so many
OWN_BYTES = 305_000_000  # of what a service may take, that its work needs at most, a recording from the tap included
TOUCHED = 10  # pictures' memory in a tick: sooner than a camera needs it

_log = logging.getLogger("ledpi")


class Rewind:
    """A daemon's last seconds. `keep` is for its decode thread, `save` for any, `tick` for the one that watches."""

    def __init__(self, settings: RewindSettings, shown: Shown, period_ms: float) -> None:
        """`period_ms`: between two frames."""
        camera = shown.camera
        budget = _budget_bytes(settings)
        try:
            self._ring = RewindRing(camera.height, camera.width, period_ms, settings.seconds, budget)
        except MemoryError:  # poses need no past
            budget = 0
            self._ring = RewindRing(camera.height, camera.width, period_ms, settings.seconds, budget)
        self._takes = Takes("rewind", shown)
        # A replay has gaps between its rounds, and what it shows is recorded already.
        self._saves_faults = not shown.source.startswith("recording:")
        self._fault: str | None = None
        self._told_ns: dict[str, int] = {}  # when the last of each fault was seen
        self._is_lost = False
        holds_s = self._ring.frames * period_ms * 1e-3
        if holds_s < settings.seconds:
            _log.warning(
                event("rewind_short", seconds=round(holds_s, 1), wanted=settings.seconds, memory_mb=budget // 1_000_000)
            )

    @property
    def kept_s(self) -> float:
        """Tells how many seconds are kept now."""
        return self._ring.kept_s

    def keep(self, frame: Frame, decoded: Decoded, search_budget: int) -> None:
        """A frame that was just decoded, while its pixels are there, and what it might spend on searching."""
        self._ring.keep(frame, decoded, search_budget)
        if _contradicts(decoded) and self._is_new(CONTRADICTED, frame.row0_readout_ns):
            self._fault = CONTRADICTED

    def save(self, cause: str = ASKED) -> Future[Path]:
        """Writes what is kept; the folder once it is whole. From any thread.

        Raises RecordingError where nothing is kept yet, or too much is being written; so may the future.
        """
        kept = deque(self._ring.take())
        if not kept:
            raise RecordingError("rewind: nothing is kept yet; ask again in a second")
        try:
            return self._takes.submit(self._save, cause, kept)
        except RecordingError:
            self._give_back(kept)
            raise

    def tick(self, now_ns: int, *, lost: bool) -> None:
        """Saves where there is a new fault. `lost`: whether the camera is."""
        for _ in range(TOUCHED):
            self._ring.touch()
        fault, self._fault = self._fault, None
        nothing = self._ring.is_empty  # as at the start, where the first frame may be long in coming
        if lost and not self._is_lost and not nothing and self._is_new(CAMERA_LOST, now_ns):
            fault = CAMERA_LOST
        self._is_lost = lost
        if fault is not None and self._saves_faults and not nothing:
            try:
                self.save(fault)
            except RecordingError as error:
                _log.warning(event("rewind_failed", cause=fault, reason=str(error)))

    def stop(self) -> None:
        """Writes no further picture, while the rest of the daemon ends; what is being written stays as far as it is."""
        self._takes.stop()

    def close(self) -> None:
        """As `stop`, and waits for that, a moment at most."""
        self._takes.close()

    def _save(self, cause: str, kept: deque[KeptFrame]) -> Path:
        note, frames = f"the last seconds of {self._takes.shown.source}: {cause}", len(kept)
        camera = self._takes.shown.camera
        try:
            take = self._takes.write(
                cause, note, self._ring, self._until_stopped(kept), frames * camera.width * camera.height
            )
        finally:
            self._give_back(kept)
        _log.info(event("rewind_saved", cause=cause, frames=frames, path=take.path))
        return take.path

    def _until_stopped(self, left: deque[KeptFrame]) -> Iterator[KeptFrame]:
        while left:
            if self._takes.ends.is_set():
                raise RecordingError(f"the daemon ends, and {len(left)} frames more are not written")
            yield left.popleft()

    def _give_back(self, kept: deque[KeptFrame]) -> None:
        while kept:
            self._ring.give_back(kept.popleft())

    def _is_new(self, fault: str, now_ns: int) -> bool:
        before = self._told_ns.get(fault)
        self._told_ns[fault] = now_ns
        return before is None or now_ns - before > AGAIN_NS


def _contradicts(decoded: Decoded) -> bool:
    """Tells whether a panel of the map is not where the others say."""
    if decoded.robot is not None:
        return bool(decoded.robot.panels_rejected)
    return CONTRADICTION in decoded.rejected


def _budget_bytes(settings: RewindSettings) -> int:
    if settings.memory_mb is None:
        return default_budget_bytes()
    budget, spare = round(settings.memory_mb * 1e6), spare_bytes()
    if spare is not None and budget > spare:
        spare_mb = spare // 1_000_000
        _log.warning(event("rewind_memory", memory_mb=settings.memory_mb, spare_mb=spare_mb, remedy="raise MemoryMax="))
    return budget


def default_budget_bytes() -> int:
    """An eighth of the machine's memory, as far as this process's service may take it."""
    share = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // MEMORY_SHARE
    spare = spare_bytes()
    return share if spare is None else min(share, spare)


def spare_bytes() -> int | None:
    """Returns what this process may take beside its work; None where nothing limits it."""
    limit = limit_bytes()
    return None if limit is None else max(0, limit - OWN_BYTES)


def limit_bytes(own: Path = Path("/proc/self/cgroup"), groups: Path = Path("/sys/fs/cgroup")) -> int | None:
    """Returns what systemd's MemoryMax= allows this process's cgroup and those that it is in; None where nothing does.

    Only of cgroups' second version, the one that systemd limits memory by; `own`: as /proc/self/cgroup.
    """
    try:
        line = next(line for line in own.read_text(encoding="utf-8").splitlines() if line.startswith("0::/"))
    except (OSError, StopIteration):
        return None
    place = groups / line.removeprefix("0::/")
    limits = []
    for group in (place, *place.parents):
        if not group.is_relative_to(groups):
            break
        try:
            limits.append(int((group / "memory.max").read_text(encoding="ascii")))
        except (OSError, ValueError):  # `max`: no limit; the root has none to read
            continue
    return min(limits, default=None)


LAST_S = 0.3  # for what still waits when the daemon ends


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
