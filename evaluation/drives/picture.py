"""Drives from above, and how all of them came out. Needs matplotlib, the extra `evaluate`.

python -m evaluation.drives.picture --out docking.png      # 100 starts into the dock
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from evaluation.drives.cases import CASES, Driven, drive_of, run
from evaluation.drives.docking import GOAL, Docked, Docking, dock
from evaluation.drives.measure import Row
from evaluation.drives.robot import PANELS

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


def draw_docking(docked: Sequence[Docked], path: Path) -> None:
    """The ways, those that backed up in another colour, and where the robots stand in the end."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from PIL import Image

    figure = Figure(figsize=(10, 4.6), dpi=90, layout="constrained")
    canvas = FigureCanvasAgg(figure)
    above, ends = figure.subplots(1, 2, width_ratios=(1.35, 1))
    for each in docked:
        x, y, _ = each.path.T
        above.plot(x, y, color="tab:orange" if each.backed else "tab:blue", lw=0.5, zorder=2 - each.backed)
        above.plot(x[0], y[0], ".", color="black", ms=2)
    above.plot([0, 0], [-0.08, 0.08], color="black", lw=4)
    above.plot(*GOAL[:2], "+", color="black", ms=9)
    above.set_xticks(np.arange(-2.5, 0.1, 0.5))
    above.set(xlabel="x, m (blue: at once; orange: backed up and came again)", ylabel="y, m", aspect="equal")
    for radius_mm in (5, 10):
        angle = np.linspace(0, math.tau, 90)
        ends.plot(radius_mm * np.cos(angle), radius_mm * np.sin(angle), color="black", lw=0.8)
    ends.plot(*(1e3 * np.array([each.error[:2] for each in docked]).T), ".", color="tab:blue")
    ends.set(xlabel="beside the goal: x, mm (circles: 5 and 10 mm)", ylabel="y, mm", aspect="equal")
    canvas.draw()
    Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB").quantize(16).save(path, optimize=True)


def main() -> None:
    parser = argparse.ArgumentParser(description="Docks with a gyro, and draws the ways.")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--starts", type=int, default=100)
    asked = parser.parse_args()
    with ProcessPoolExecutor(2) as pool:
        docked = list(pool.map(partial(dock, asked=Docking()), range(asked.starts)))
    draw_docking(docked, asked.out)
    off = [(1e3 * math.hypot(*each.error[:2]), math.degrees(abs(each.error[2]))) for each in docked]
    near = (sum(mm <= most and deg <= turned for mm, deg in off) for most, turned in ((10, 1.5), (5, 1)))
    told = "{} within 10 mm and 1.5°, {} within 5 mm and 1°".format(*near)
    most = f"{max(mm for mm, _ in off):.1f} mm and {max(deg for _, deg in off):.2f}° at most"
    touched, backed = sum(each.touched for each in docked), sum(each.backed for each in docked)
    print(f"of {len(docked)}: {told}; {most}; {backed} backed up; {touched} touched the wall")


if __name__ == "__main__":
    main()
