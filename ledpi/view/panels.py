"""The table of panels: each that was seen lately, with its place, age and rate. Pure; times are handed in."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field
from typing import Any

from ledpi.view.overlay import place_of

FORGOTTEN_NS = 30_000_000_000  # after so long unseen, a panel is no row any more
RATE_NS = 2_000_000_000  # that a rate is counted over


@dataclass(slots=True)
class _Seen:
    marker: dict[str, Any]
    exposed_ns: int
    times_ns: deque[int] = field(default_factory=deque)


class PanelTable:
    """Follows the lines `decoded`."""

    def __init__(self) -> None:
        self._seen: dict[int, _Seen] = {}

    def see(self, decoded: dict[str, Any]) -> None:
        """Takes in the markers of a frame."""
        now_ns = decoded["exposed_ns"]
        for marker in decoded["markers"]:
            seen = self._seen.setdefault(marker["id"], _Seen(marker, now_ns))
            seen.marker, seen.exposed_ns = marker, now_ns
            seen.times_ns.append(now_ns)
            while seen.times_ns[0] < now_ns - RATE_NS:
                seen.times_ns.popleft()

    def rows(self, now_ns: int) -> list[dict[str, Any]]:
        """By ID. `now_ns`: CLOCK_MONOTONIC; ages are since mid-exposure, rates of the two seconds before."""
        self._seen = {i: seen for i, seen in self._seen.items() if now_ns - seen.exposed_ns < FORGOTTEN_NS}
        return [_row(marker_id, seen, now_ns) for marker_id, seen in sorted(self._seen.items())]


def _row(marker_id: int, seen: _Seen, now_ns: int) -> dict[str, Any]:
    within = sum(1 for t in seen.times_ns if now_ns - t < RATE_NS)
    return {
        "id": marker_id,
        **place_of(seen.marker),
        "age_ms": round((now_ns - seen.exposed_ns) / 1e6, 1),
        "rate_hz": round(within / (RATE_NS / 1e9), 1),
        "margin": seen.marker["margin"],
        "ambiguous": seen.marker.get("alternate") is not None,
    }
