"""The map from above, in metres: panels, and the robot with its error ellipse. Pure."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ledpi.core.geometry import matrix_from_quaternion
from ledpi.tools.monitor.table import heading_deg

SIGMAS = 2.0  # of the ellipse's half axes: it holds 86 %


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
