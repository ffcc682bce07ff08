"""The daemon's work so far: counters by stage and reason, and how long the stages take."""

from __future__ import annotations

import threading
from collections import Counter, deque
from dataclasses import dataclass, field

from ledpi.core.records import Decoded, Rejected

RECENT = 512  # frames that the times are taken from: some 8 s of a 60 fps camera


@dataclass(frozen=True, slots=True, kw_only=True)
class HealthSnapshot:
    """Totals since the start, and what the newest frame showed."""

    decoded: int
    markers: int
    in_view: int  # panels in the newest decoded frame
    fixed: bool  # whether that gave the robot's place in the map
    no_fix: str | None  # and why it did not, where that was tried
    rejected: dict[str, int]


@dataclass(frozen=True, slots=True, kw_only=True)
class StageTimes:
    """Times of the recent frames: median and 99th percentile in milliseconds."""

    decode_ms: tuple[float, float] | None = None  # find to pose; None before the first frame
    stages_ms: dict[str, tuple[float, float]] = field(default_factory=dict)  # in the order of the path

    @property
    def decode_us(self) -> tuple[int, int] | tuple[None, None]:
        """As the status message wants it."""
        if self.decode_ms is None:
            return None, None
        p50_ms, p99_ms = self.decode_ms
        return round(1e3 * p50_ms), round(1e3 * p99_ms)


class Health:
    """Written by the capture and decode threads, read by any."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._rejected: Counter[str] = Counter()
        self._recent: deque[dict[str, float]] = deque(maxlen=RECENT)
        self._decoded = self._markers = self._in_view = 0
        self._fixed = False
        self._no_fix: str | None = None

    def reject(self, rejected: Rejected) -> None:
        """Counts something that was dropped outside the decoder."""
        with self._lock:
            self._rejected[rejected.key] += 1

    def add(self, decoded: Decoded) -> None:
        """Counts a decoded frame."""
        with self._lock:
            self._decoded += 1
            self._markers += len(decoded.markers)
            self._in_view = len(decoded.markers)
            self._fixed = decoded.robot is not None
            self._no_fix = next((r.reason for r in decoded.rejected if r.stage == "fix"), None)
            self._rejected.update(rejected.key for rejected in decoded.rejected)
            self._recent.append(decoded.stage_ms)

    def snapshot(self) -> HealthSnapshot:
        """A consistent picture of now."""
        with self._lock:
            return HealthSnapshot(
                decoded=self._decoded,
                markers=self._markers,
                in_view=self._in_view,
                fixed=self._fixed,
                no_fix=self._no_fix,
                rejected=dict(self._rejected),
            )

    def times(self) -> StageTimes:
        """Apart from the snapshot, as it takes a millisecond: for once a second, not for each tick."""
        with self._lock:
            recent = list(self._recent)
        if not recent:
            return StageTimes()
        return StageTimes(
            decode_ms=_percentiles([sum(stages.values()) for stages in recent]),
            stages_ms={name: _percentiles([stages[name] for stages in recent]) for name in recent[-1]},
        )


def _percentiles(values: list[float]) -> tuple[float, float]:
    values.sort()
    return values[len(values) // 2], values[int(0.99 * len(values))]
