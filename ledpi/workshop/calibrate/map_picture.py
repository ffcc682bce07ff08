"""A map from above: each panel, where it faces, its deviation, and the way that was driven. Needs matplotlib."""

from __future__ import annotations

from io import BytesIO

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.patches import Circle

from ledpi.workshop.calibrate.map import MapCalibration

SHOWN_SIGMA = 3.0  # an ellipse of one deviation would be smaller than a line


def map_picture(result: MapCalibration) -> bytes:
    """A PNG: x to the right, y up, metres."""
    figure = Figure(figsize=(11, 7), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    way = np.array([camera[:2, 3] for camera in result.adjusted.cameras])
    axes.plot(*way.T, ".", color="tab:blue", ms=2, label=f"camera, {result.views} frames")
    for marker_id, panel in result.panels.items():
        x, y = panel.map_from_marker[:2, 3]
        right, out = panel.map_from_marker[:2, 0], panel.map_from_marker[:2, 2]
        half = (panel.side_m or 0.0) / 2
        axes.plot([x - half * right[0], x + half * right[0]], [y - half * right[1], y + half * right[1]], "k-", lw=3)
        axes.annotate("", (x + 0.25 * out[0], y + 0.25 * out[1]), (x, y), arrowprops={"arrowstyle": "->"})
        axes.add_patch(Circle((x, y), SHOWN_SIGMA * panel.position_sigma_m, color="tab:red", alpha=0.3, lw=0))
        label = f"{marker_id}" + (" (origin)" if marker_id == result.origin else "")
        axes.annotate(label, (x, y), (6, 6), textcoords="offset points", fontsize=9)
    axes.set_aspect("equal")
    axes.grid(alpha=0.3)
    axes.set_xlabel("x, m")
    axes.set_ylabel("y, m")
    axes.set_title(f"{len(result.panels)} panels from above; red: {SHOWN_SIGMA:g} standard deviations")
    axes.legend(loc="best", fontsize=8)
    data = BytesIO()
    figure.savefig(data, format="png", dpi=110, bbox_inches="tight", metadata={"Software": None})
    return data.getvalue()
