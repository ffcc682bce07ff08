"""What the daemon has done so far: counters by stage and reason, and how long the stages take."""

from __future__ import annotations

import threading
from collections import Counter, deque
from dataclasses import dataclass

from ledpi.records import Decoded, Rejected

RECENT = 512  # frames that the times are taken from: some 8 s of a 60 fps camera


@dataclass(frozen=True, slots=True, kw_only=True)
class HealthSnapshot:
    """Totals since the start; times of the recent frames in milliseconds."""

    decoded: int
    markers: int
    in_view: int  # panels in the newest decoded frame
    fixed: bool  # whether that gave the robot's place in the map
    no_fix: str | None  # and why it did not, where that was tried
    rejected: dict[str, int]
    stage_p50_ms: dict[str, float]
    decode_p50_ms: float | None
    decode_p99_ms: float | None
    newest_host_ns: int | None  # CLOCK_MONOTONIC at the newest decoded frame's row 0 read-out


class Health:
    """Written by the capture and decode threads, read by any."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._rejected: Counter[str] = Counter()
        self._recent: deque[dict[str, float]] = deque(maxlen=RECENT)
        self._decoded = self._markers = self._in_view = 0
        self._newest_host_ns: int | None = None
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
            self._newest_host_ns = decoded.row0_readout_ns + decoded.host_offset_ns

    def snapshot(self) -> HealthSnapshot:
        """A consistent picture of now."""
        with self._lock:
            recent, rejected = list(self._recent), dict(self._rejected)
            decoded, markers, in_view, newest = self._decoded, self._markers, self._in_view, self._newest_host_ns
            fixed, no_fix = self._fixed, self._no_fix
        totals = sorted(sum(stages.values()) for stages in recent)
        names = recent[-1] if recent else {}
        return HealthSnapshot(
            decoded=decoded,
            markers=markers,
            in_view=in_view,
            fixed=fixed,
            no_fix=no_fix,
            rejected=rejected,
            stage_p50_ms={name: sorted(s[name] for s in recent)[len(recent) // 2] for name in names},
            decode_p50_ms=totals[len(totals) // 2] if totals else None,
            decode_p99_ms=totals[int(0.99 * len(totals))] if totals else None,
            newest_host_ns=newest,
        )
