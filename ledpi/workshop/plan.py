"""A plan: the map's panels from above, x to the right, y up, in metres, and the robot. Needs matplotlib."""

from __future__ import annotations

import math
from io import BytesIO
from typing import TYPE_CHECKING, Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Ellipse, Polygon

from ledpi.core.records import PanelMap

if TYPE_CHECKING:
    from ledpi.workshop.calibrate.map import MapCalibration

SHOWN_SIGMA = 3.0  # an ellipse of one deviation would be smaller than a line
ARROW = np.array([[1.4, 0.0], [-1.0, 0.9], [-0.5, 0.0], [-1.0, -0.9]])  # as the live page's, ahead is to the right
ARROW_SHARE = 0.02  # of the plan's longer side


def plan_of(panels: PanelMap, origin: int | None = None) -> Axes:
    """Axes with all panels: each a line, an arrow where it faces, and a circle of its deviation."""
    axes = Figure(figsize=(11, 7), layout="constrained").subplots()
    for marker_id, panel in panels.items():
        x, y = panel.map_from_marker[:2, 3]
        right, out = panel.map_from_marker[:2, 0], panel.map_from_marker[:2, 2]
        half = (panel.side_m or 0.0) / 2
        axes.plot([x - half * right[0], x + half * right[0]], [y - half * right[1], y + half * right[1]], "k-", lw=3)
        axes.annotate("", (x + 0.25 * out[0], y + 0.25 * out[1]), (x, y), arrowprops={"arrowstyle": "->"})
        axes.add_patch(Circle((x, y), SHOWN_SIGMA * panel.position_sigma_m, color="tab:red", alpha=0.3, lw=0))
        label = f"{marker_id}" + (" (origin)" if marker_id == origin else "")
        axes.annotate(label, (x, y), (6, 6), textcoords="offset points", fontsize=9)
    axes.set_aspect("equal")
    axes.grid(alpha=0.3)
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")
    return axes


def draw_robot(axes: Axes, robot: dict[str, Any], sigmas: float) -> None:
    """Adds an arrow, and the ellipse of SHOWN_SIGMA deviations. `robot`: as the live page has it, of `sigmas`."""
    (x, y), yaw, ellipse = robot["position_m"], robot["heading_rad"], robot["ellipse"]
    if ellipse is not None:
        across = [2 * SHOWN_SIGMA / sigmas * ellipse[key] for key in ("long_m", "short_m")]
        turned = math.degrees(ellipse["angle_rad"])
        axes.add_patch(Ellipse((x, y), *across, angle=turned, color="tab:blue", alpha=0.3, lw=0))
    axes.plot(x, y)  # so that it is in the plan
    size = ARROW_SHARE * max(np.ptp(axes.get_xlim()), np.ptp(axes.get_ylim()))
    turn = np.array([[math.cos(yaw), math.sin(yaw)], [-math.sin(yaw), math.cos(yaw)]])
    axes.add_patch(Polygon(size * ARROW @ turn + (x, y), color="tab:blue"))


def map_picture(result: MapCalibration) -> bytes:
    """A PNG of a map that was calibrated, with the way that was driven."""
    axes = plan_of(result.panels, result.origin)
    way = np.array([camera[:2, 3] for camera in result.adjusted.cameras])
    axes.plot(*way.T, ".", color="tab:blue", ms=2, label=f"camera, {result.views} frames")
    axes.set_title(f"{len(result.panels)} panels from above; red: {SHOWN_SIGMA:g} standard deviations")
    axes.legend(loc="best", fontsize=8)
    return png_of(axes)


def png_of(axes: Axes) -> bytes:
    """The whole figure."""
    figure, data = axes.figure, BytesIO()
    assert isinstance(figure, Figure)
    FigureCanvasAgg(figure)
    figure.savefig(data, format="png", dpi=110, bbox_inches="tight", metadata={"Software": None})
    return data.getvalue()
