"""Rewind: the last seconds, kept in memory, and written as a recording when they are asked for or something fails."""

from __future__ import annotations

import logging
from concurrent.futures import Future
from pathlib import Path

from ledpi.config.settings import RewindSettings
from ledpi.core.errors import RecordingError
from ledpi.core.records import CameraInfo, Decoded, Frame
from ledpi.pipeline.pipeline import Pipeline
from ledpi.pose.fix_history import CONTRADICTION
from ledpi.runtime.memory import default_budget_bytes, spare_bytes
from ledpi.runtime.reporting import event
from ledpi.runtime.rewind_ring import RewindRing
from ledpi.runtime.rewind_writer import RewindWriter
from ledpi.runtime.takes import Shown, takes_folder

ASKED, CAMERA_LOST, CONTRADICTED = "asked", "camera_lost", "contradicted"
AGAIN_NS = 60_000_000_000  # a fault that comes back sooner is the same one

_log = logging.getLogger("ledpi")


class Rewind:
    """A daemon's last seconds. `keep` is for its decode thread, `save` for any, `tick` for the one that watches."""

    def __init__(
        self, settings: RewindSettings, pipeline: Pipeline, camera: CameraInfo, period_ms: float, source: str
    ) -> None:
        """`camera`: with the lens that poses are solved with. `period_ms`: between two frames."""
        budget = _budget_bytes(settings)
        try:
            self._ring = RewindRing(camera.height, camera.width, period_ms, settings.seconds, budget)
        except MemoryError:  # poses need no past
            budget = 0
            self._ring = RewindRing(camera.height, camera.width, period_ms, settings.seconds, budget)
        shown = Shown(camera, pipeline.panels.dictionary, pipeline.panels.spec(), source)
        self._writer = RewindWriter(self._ring, takes_folder(), shown)
        # A replay has gaps between its rounds, and what it shows is recorded already.
        self._saves_faults = not source.startswith("recording:")
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

    def start(self) -> None:
        """Once, before anything is saved."""
        self._writer.start()

    def keep(self, frame: Frame, decoded: Decoded, search_budget: int) -> None:
        """A frame that was just decoded, while its pixels are there, and what it might spend on searching."""
        self._ring.keep(frame, decoded, search_budget)
        if _contradicts(decoded) and self._is_new(CONTRADICTED, frame.row0_readout_ns):
            self._fault = CONTRADICTED

    def save(self, cause: str = ASKED) -> Future[Path]:
        """Writes what is kept; the folder once it is whole. From any thread.

        Raises RecordingError where nothing is kept yet, or too much is being written; so may the future.
        """
        kept = self._ring.take()
        if not kept:
            raise RecordingError("rewind: nothing is kept yet; ask again in a second")
        return self._writer.write(cause, kept)

    def tick(self, now_ns: int, *, lost: bool) -> None:
        """Saves where there is a new fault. `lost`: whether the camera is."""
        fault, self._fault = self._fault, None
        nothing = self._ring.is_empty  # as at the start, where the first frame may be long in coming
        if lost and not self._is_lost and not nothing and self._is_new(CAMERA_LOST, now_ns):
            fault = CAMERA_LOST
        self._is_lost = lost
        if fault is not None and self._saves_faults and not nothing:
            self.save_if_any(fault)

    def save_if_any(self, cause: str) -> None:
        """As `save`, for those who wait for nothing; what hinders it is told in the journal."""
        try:
            self.save(cause)
        except RecordingError as error:
            _log.warning(event("rewind_failed", cause=cause, reason=str(error)))

    def stop(self) -> None:
        """Writes no further picture, while the rest of the daemon ends; what is being written stays as far as it is."""
        self._writer.stop()

    def close(self) -> None:
        """As `stop`, and waits for that, a moment at most."""
        self._writer.close()

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
