"""The plots of a design: what the exposure leaves of each frequency, and how far pairs carry."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from ledpi.core.shutter import contrast
from ledpi.workshop.panel.design import Proposal, Task
from ledpi.workshop.panel.information import STREAM_FRAMES
from ledpi.workshop.panel.reach import Reach

_BLACK, _WHITE = "tab:blue", "tab:orange"  # as the snapshot draws the classes
_MAX_NULLS = 40  # that are marked: more would be a grey area


def draw_contrast(task: Task, chosen: Proposal, path: Path) -> None:
    """Contrast against frequency, with the nulls, the flicker limit, and a pair. The legend covers no curve."""
    figure = Figure(figsize=(11, 4.6), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    exposure_us = task.sensor.exposure_us
    highest = 1.25 * max(chosen.black_hz, chosen.white_hz, 2 * task.flicker.lowest_hz)
    hz = np.linspace(0.3 * task.flicker.lowest_hz, highest, 6000)
    axes.plot(hz, [100 * contrast(f, exposure_us, task.duty) for f in hz], color="black", lw=1)
    nulls = np.arange(math.ceil(hz[0] * exposure_us * 1e-6), int(highest * exposure_us * 1e-6) + 1) / exposure_us * 1e6
    if len(nulls) <= _MAX_NULLS:
        axes.plot(nulls, np.zeros_like(nulls), "v", color="tab:red", ms=5, clip_on=False, label="nulls: whole cycles")
    axes.axvspan(hz[0], task.flicker.lowest_hz, color="0.9", label=f"flicker that is not {task.flicker.value}")
    for name, f, colour in (("black", chosen.black_hz, _BLACK), ("white", chosen.white_hz, _WHITE)):
        axes.axvline(f, color=colour, lw=1.5, label=f"{name}: {f:.2f} Hz, {100 * contrast(f, exposure_us):.1f} %")
    axes.set_xlim(hz[0], hz[-1])
    axes.set_ylim(bottom=0)
    axes.set_xlabel("frequency, Hz")
    axes.set_ylabel("depth of the bands, % of the light")
    axes.set_title(f"What an exposure of {exposure_us:.0f} µs leaves", fontsize=11)
    axes.grid(alpha=0.3)
    figure.legend(fontsize=9, loc="outside lower center", ncols=4)
    figure.savefig(path, dpi=110, metadata={"Software": None})


def draw_reach(rows: Sequence[tuple[str, Proposal, Reach]], path: Path) -> None:
    """The chance of being read against distance, of one frame and of a short stream. The legend covers no curve."""
    figure = Figure(figsize=(11, 5.2), layout="constrained")
    FigureCanvasAgg(figure)
    alone, stream = figure.subplots(1, 2, sharey=True)
    for name, proposal, reach in rows:
        label = f"{name}: {proposal.black_hz:g} and {proposal.white_hz:g} Hz, {proposal.frame_length_rows} rows"
        style = "k--" if name == "present" else "-"
        for axes, chances in ((alone, reach.alone), (stream, reach.stream)):
            axes.plot(reach.distances_m, [100 * chance for chance in chances], style, lw=1.3, label=label)
    for axes, title in ((alone, "one frame alone"), (stream, f"{STREAM_FRAMES} frames")):
        axes.set_xscale("log")
        shown = rows[0][2].distances_m[::2]
        axes.set_xticks(shown, [f"{d:.2g}" for d in shown])
        axes.set_xticks([], minor=True)
        axes.set_xlabel("distance, m")
        axes.set_title(title, fontsize=11)
        axes.grid(alpha=0.3)
    alone.set_ylabel("read, % (the decoder's error model)")
    figure.legend(*alone.get_legend_handles_labels(), fontsize=8, loc="outside lower center", ncols=2)
    figure.savefig(path, dpi=110, metadata={"Software": None})
