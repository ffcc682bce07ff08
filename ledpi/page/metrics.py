"""The daemon's health as Prometheus' text format 0.0.4. Pure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

from ledpi import __version__

KIND = "text/plain; version=0.0.4; charset=utf-8"
# Name, type, help, and where the tap's `health` has it.
_PLAIN = (
    ("uptime_seconds", "gauge", "Since the daemon started", ("uptime_s",)),
    ("frames_total", "counter", "Frames that the camera gave", ("frames",)),
    ("decoded_frames_total", "counter", "Frames that were decoded", ("decoded",)),
    ("dropped_frames_total", "counter", "Frames that came too soon after one another", ("dropped_frames",)),
    ("panels_in_view", "gauge", "Panels in the newest frame", ("in_view",)),
    ("temperature_celsius", "gauge", "Of the processor", ("temperature_c",)),
    ("packets_total", "counter", "Packets on the serial line", ("wire", "packets")),
    ("dropped_poses_total", "counter", "Poses that did not reach the serial line", ("wire", "dropped")),
    ("serial_connected", "gauge", "1 where the serial port is open", ("wire", "connected")),
)


@dataclass(slots=True)
class Seen:
    """Counts of what the page has heard of since it began to follow: a daemon's line tells each frame once."""

    fixes: int = 0
    markers: Counter[int] = field(default_factory=Counter)  # by ID

    def see(self, decoded: dict[str, Any]) -> None:
        """Counts a frame."""
        self.fixes += decoded.get("robot") is not None
        self.markers.update(marker["id"] for marker in decoded["markers"])


def metrics(health: dict[str, Any] | None, seen: Seen, version: object) -> str:
    """All figures of a `health` line; without one (no daemon answers) those of the page. `version`: the daemon's."""
    built = f'{{version="{__version__}",daemon="{_quoted(version)}"}}'
    lines = _family("build_info", "gauge", "Versions of the page and of the daemon", [(built, 1)])
    lines += _family("fixes_total", "counter", "Frames with the robot's place, since the page runs", [("", seen.fixes)])
    by_id = [(f'{{id="{marker_id}"}}', count) for marker_id, count in sorted(seen.markers.items())]
    lines += _family("markers_total", "counter", "Detections by ID, since the page runs", by_id)
    lines += _family("up", "gauge", "1 where the daemon answers", [("", health is not None)])
    if health is None:
        return "\n".join(lines) + "\n"
    for name, kind, about, path in _PLAIN:
        lines += _family(name, kind, about, [("", _at(health, path))])
    latency = health.get("latency_ms") or {}
    seconds = [(f'{{of="{key}"}}', latency[key] / 1e3) for key in ("median", "worst") if key in latency]
    lines += _family("latency_seconds", "gauge", "Read-out to decoded, in the last second", seconds)
    rejected = [(f'{{reason="{_quoted(key)}"}}', count) for key, count in health.get("rejected", {}).items()]
    lines += _family("rejected_total", "counter", "By reason (docs/troubleshooting.md)", rejected)
    states = [(f'{{state="{_quoted(health.get("state"))}",no_fix="{_quoted(health.get("no_fix"))}"}}', 1)]
    lines += _family("state", "gauge", "What the daemon does, and why there is no fix", states)
    return "\n".join(lines) + "\n"


def _family(name: str, kind: str, about: str, samples: Iterable[tuple[str, Any]]) -> list[str]:
    """Nothing where no value is known."""
    known = [(labels, value) for labels, value in samples if isinstance(value, int | float)]
    if not known:
        return []
    head = [f"# HELP ledpi_{name} {about}", f"# TYPE ledpi_{name} {kind}"]
    return head + [f"ledpi_{name}{labels} {value + 0}" for labels, value in known]  # a truth value becomes a number


def _at(values: Any, path: tuple[str, ...]) -> Any:
    for key in path:
        values = values.get(key) if isinstance(values, dict) else None
    return values


def _quoted(value: object) -> str:
    return str(value).replace("\\", r"\\").replace('"', r"\"").replace("\n", r"\n")
