"""The plots of the source paper's Figure 12, ours beside its own figures. Needs matplotlib, the extra `evaluate`."""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from ledpi.workshop.evaluate.table import PAPER_ANGLES_AT_M, PLAIN, TableRow

if TYPE_CHECKING:
    from matplotlib.axes import Axes

LABELS = {
    "ledpi": "ledpi",
    "oracle": "true corners given",
    "uemura": "uemura (the paper's method)",
    "likelihood": "likelihood, one frame",
    "stream_4": "likelihood, 4th frame of a stream",
    "stream_12": "likelihood, 12th frame",
    "stream_all": "likelihood, every frame of a stream",
    "aruco": "printed ArUco, OpenCV",
    "apriltag": "printed AprilTag",
}
_STYLES = {
    "uemura": ("tab:brown", "v:"),
    "likelihood": ("tab:blue", "o-"),
    "stream_4": ("tab:cyan", "s-"),
    "stream_12": ("tab:green", "D-"),
    "aruco": ("tab:red", "^--"),
    "apriltag": ("tab:orange", "x--"),
}
# All that the paper prints of its Figure 12 as numbers, in its section 5.3: (from, to, per cent).
_PAPER_DISTANCE, _PAPER_ANGLE = (0.6, 0.8, 43.0), (-20.0, 20.0, 40.0)


def has_matplotlib() -> bool:
    """Tells whether plots can be drawn (an optional extra)."""
    return importlib.util.find_spec("matplotlib") is not None


def draw_rates(rows: Sequence[TableRow], path: Path) -> None:
    """Rate against distance and against angle, of rows of one exposure and tone, as one picture."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    plain = [r for r in rows if r.case == PLAIN and r.distance_m is not None and r.rate is not None]
    figure = Figure(figsize=(13, 5), layout="constrained")
    FigureCanvasAgg(figure)
    by_distance, by_angle = figure.subplots(1, 2)
    _plot(by_distance, [r for r in plain if r.angle_deg == 0], "distance_m")
    _quote(by_distance, _PAPER_DISTANCE, "the paper:\n“over 43 %”")
    by_distance.set_xscale("log")
    shown = sorted({r.distance_m for r in plain if r.angle_deg == 0 and r.distance_m is not None})
    by_distance.set_xticks(shown, [f"{d:g}" for d in shown], fontsize=8, rotation=45)
    by_distance.set_xticks([], minor=True)
    by_distance.set_xlabel("distance, m")
    _plot(by_angle, [r for r in plain if r.distance_m == PAPER_ANGLES_AT_M], "angle_deg")
    _quote(by_angle, _PAPER_ANGLE, "the paper: “above 40 %”")
    by_angle.set_xlabel(f"angle to the line of sight at {PAPER_ANGLES_AT_M:g} m, degrees")
    handles, labels = by_distance.get_legend_handles_labels()
    figure.legend(handles, labels, fontsize=9, loc="outside lower center", ncols=len(labels), frameon=False)
    figure.savefig(path, dpi=110, metadata={"Software": None})


def _plot(axes: Axes, rows: Sequence[TableRow], across: str) -> None:
    """One line a method, with 95 % intervals."""
    for method, (colour, style) in _STYLES.items():
        own = sorted((r for r in rows if r.method == method), key=lambda r: float(getattr(r, across)))
        if own:
            rates = [100 * (r.rate or 0) for r in own]
            down = [rate - 100 * (r.rate_low or 0) for rate, r in zip(rates, own, strict=True)]
            up = [100 * (r.rate_high or 0) - rate for rate, r in zip(rates, own, strict=True)]
            at = [getattr(r, across) for r in own]
            axes.errorbar(at, rates, (down, up), fmt=style, color=colour, label=LABELS[method], capsize=2, lw=1.2, ms=4)
    axes.set_ylim(-3, 103)
    axes.set_ylabel("recognised, %")
    axes.grid(alpha=0.3)


def _quote(axes: Axes, quoted: tuple[float, float, float], text: str) -> None:
    first, last, percent = quoted
    axes.plot([first, last], [percent, percent], color="black", lw=3)
    axes.annotate(
        text,
        ((first * last) ** 0.5 if first > 0 else (first + last) / 2, percent),
        (0, -4),
        fontsize=9,
        textcoords="offset points",
        ha="center",
        va="top",
    )
