"""A drive from above, and how all of them came out. Needs matplotlib, the extra `evaluate`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from evaluation.drives.cases import CASES, Driven, drive_of, run
from evaluation.drives.measure import Row
from evaluation.drives.room import PANELS

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def draw(rows: Sequence[Row], path: Path) -> None:
    """The first plain drive, and each drive's RMS beside its raw fixes', and NEES."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    case = CASES["plain"]
    figure = Figure(figsize=(14, 4.6), layout="constrained")
    FigureCanvasAgg(figure)
    above, errors, honest = figure.subplots(1, 3, width_ratios=(1.5, 1, 1))
    _draw_drive(above, run(case, drive_of(case, 0)))
    plain = [row for row in rows if row["case"] == "plain"]
    raw, ours, nees = (np.array([float(row[name]) for row in plain]) for name in ("raw_mm", "rms_mm", "nees"))
    errors.plot(raw, ours, ".", color="tab:blue")
    errors.axhline(25, color="black", lw=0.8)
    errors.set(xlabel="raw fixes, RMS mm", ylabel="state, RMS mm", xlim=(0, None), ylim=(0, None))
    honest.hist(nees, bins=np.linspace(0, 6, 25).tolist(), color="tab:blue")
    honest.axvspan(1, 3.6, color="tab:green", alpha=0.15)
    honest.set(xlabel="NEES of a drive, 3 degrees of freedom", ylabel="drives")
    figure.savefig(path, dpi=110, metadata={"Software": None})


def _draw_drive(axes: Axes, driven: Driven) -> None:
    true, states = driven.drive.way.poses, np.array([m.state.pose for m in driven.messages])
    axes.plot(*true[:, :2].T, color="black", lw=2.5, alpha=0.3, label="true")
    axes.plot(*states[:, :2].T, color="tab:blue", lw=0.9, label="state")
    for panel, (x, y, _) in PANELS.items():
        axes.plot(x, y, "s", color="tab:orange")
        axes.annotate(str(panel), (x, y), (4, 4), textcoords="offset points")
    axes.set(xlabel="the first drive: x, m", ylabel="y, m", aspect="equal")
    axes.legend(loc="upper center", ncols=2)
