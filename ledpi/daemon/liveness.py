"""The pace of frames: a lost camera, told apart from a decoder that is behind, and the budget of a frame's search."""

from __future__ import annotations

import threading
import time
from dataclasses import dataclass

from ledpi.core.records import Frame

# Without a frame for so many ticks of 0.1 s the camera is lost: 0.2 s at least, six frame periods of the slowest camera
# in scope (33 ms). Ticks, as the clock also goes on while the whole process is held up, which is no camera's fault.
LOST_TICKS = 3
# While frames come late, it is the computer that is slow, and the next may come as late as the last did.
LOST_BEHIND_TICKS = 30
BEHIND_NS = 200_000_000
SHARE = 0.9  # of a frame period: the rest is for capture and publisher
# Budgets, in places (pipeline/likelihood.py): what a new panel takes, so that each has its turn at last; and what a
# picture full of texture can use.
MIN_BUDGET, MAX_BUDGET = 100_000, 2_000_000
PACE_MEMORY = 0.05  # weight of a new frame: speeds change as processors are throttled, within seconds


class Liveness:
    """Told by the capture thread, the decode worker and the main thread's ticks; read by any."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._said_lost = False
        self._ticks = 0  # since the camera delivered
        self._in_work_ns: int | None = None  # read-out of row 0 of the frame that is being decoded, CLOCK_MONOTONIC
        self._late = False  # whether the last frame that was decoded was late

    def delivers(self) -> bool:
        """A frame has come, or none is waited for. Returns whether the camera was lost before."""
        with self._lock:
            was_lost = self._is_lost()
            self._said_lost, self._ticks = False, 0
            return was_lost

    def loses(self) -> bool:
        """The camera says that it is lost. Returns whether it was not before."""
        with self._lock:
            was_lost, self._said_lost = self._is_lost(), True
            return not was_lost

    def tick(self) -> None:
        """A tenth of a second has passed for this process."""
        with self._lock:
            self._ticks += 1

    def begins(self, frame: Frame) -> None:
        """The decoder has taken a frame."""
        with self._lock:
            self._in_work_ns = frame.row0_readout_ns + frame.host_offset_ns

    def ends(self) -> None:
        """The frame is decoded."""
        with self._lock:
            self._late, self._in_work_ns = self._is_behind(), None

    @property
    def lost(self) -> bool:
        """Tells whether the camera delivers nothing."""
        with self._lock:
            return self._is_lost()

    @property
    def behind(self) -> bool:
        """Tells whether frames come, and are decoded more than 0.2 s after they were read out."""
        with self._lock:
            return self._late or self._is_behind()

    def _is_lost(self) -> bool:
        behind = self._late or self._is_behind()
        return self._said_lost or self._ticks >= (LOST_BEHIND_TICKS if behind else LOST_TICKS)

    def _is_behind(self) -> bool:
        return self._in_work_ns is not None and time.monotonic_ns() - self._in_work_ns > BEHIND_NS


@dataclass(slots=True)
class Pacing:
    """Pacing of one daemon. The decoder counts its work in places; only here is it known how long these take."""

    period_ms: float
    unit_ms: float = 0.0002  # that a place takes, all else counted in: before the first frame, a PC's; a Pi's is 0.001

    def budget_after(self, spent: int, took_ms: float) -> int:
        """For the next frame, after one that compared at so many places and took so long.

        One that has spent less than a new panel's tells the less of what a place takes.
        """
        if spent > 0:
            weight = PACE_MEMORY * min(spent / MIN_BUDGET, 1.0)
            self.unit_ms += weight * (took_ms / spent - self.unit_ms)
        return min(max(int(SHARE * self.period_ms / max(self.unit_ms, 1e-6)), MIN_BUDGET), MAX_BUDGET)
