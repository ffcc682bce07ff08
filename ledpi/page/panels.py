"""Panels as the page shows them: the table of those seen lately, and the map from above. Pure; times are handed in."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ledpi.core.geometry import matrix_from_quaternion
from ledpi.page.overlay import place_of
from ledpi.workshop.monitor import heading_deg

FORGOTTEN_NS = 30_000_000_000  # after so long unseen, a panel is no row any more
RATE_NS = 2_000_000_000  # that a rate is counted over
SIGMAS = 2.0  # of the ellipse's half axes: it holds 86 %


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


def panels_from_above(hello: dict[str, Any]) -> list[dict[str, Any]]:
    """ID and corners (4, 2) of each panel of the daemon's map. A panel on a wall is a line from above."""
    panels = []
    for marker_id, panel in sorted((hello.get("map") or {}).items(), key=lambda item: int(item[0])):
        turn = matrix_from_quaternion(np.array(panel["quaternion_wxyz"], np.float64))
        half = (panel.get("side_m") or hello["panels"]["side_m"]) / 2
        corners = half * np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]]) @ turn.T
        corners += np.array(panel["position_m"])
        facing = turn[:2, 2].round(3).tolist()
        panels.append({"id": int(marker_id), "corners_m": corners[:, :2].round(3).tolist(), "facing": facing})
    return panels


def robot_from_above(robot: dict[str, Any] | None) -> dict[str, Any] | None:
    """Place, heading (rad, from x towards y) and error ellipse of a line's `robot`."""
    if robot is None:
        return None
    return {
        "position_m": robot["position_m"][:2],
        "heading_rad": round(math.radians(heading_deg(robot["quaternion_wxyz"])), 4),
        "ellipse": _ellipse(robot.get("covariance")),
        "panels_used": robot.get("panels_used", []),
    }


def _ellipse(covariance: list[float] | None) -> dict[str, float] | None:
    """Half axes (m) and the first one's angle (rad) of SIGMAS deviations; None where they are not known."""
    if covariance is None:
        return None
    spread, axes = np.linalg.eigh(np.array(covariance, np.float64).reshape(6, 6)[:2, :2])
    short, long = SIGMAS * np.sqrt(np.maximum(spread, 0.0))
    return {
        "long_m": round(float(long), 5),
        "short_m": round(float(short), 5),
        "angle_rad": round(math.atan2(axes[1, 1], axes[0, 1]), 4),
    }
