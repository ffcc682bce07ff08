"""The pictures of docs/frequencies.md, for the default camera and panels of 16 cm."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from ledpi.camera.simulate.scene import OV5647_ROW_TIME_US, SimulatedSensor
from ledpi.camera.simulate.scenes import ov5647_lens, whole_rows_us
from ledpi.core.shutter import phase_advance_cycles, row_weights
from ledpi.workshop.panel.design import Task, proposal_at, views_of
from ledpi.workshop.panel.design_plots import draw_contrast
from ledpi.workshop.panel.frequencies import Flicker, worthwhile_frequencies
from ledpi.workshop.panel.information import STREAM_FRAMES

PAIR = (1250.0, 2450.0)
COLOURS = {1250.0: "tab:blue", 2450.0: "tab:orange"}
NEAR_M, MIDDLE_M, FAR_M = 1.0, 2.0, 8.0


def default_task(*distances_m: float) -> Task:
    exposure_us = whole_rows_us(10_000.0, OV5647_ROW_TIME_US)
    return Task(
        sensor=SimulatedSensor(intrinsics=ov5647_lens(), exposure_us=exposure_us),
        period_given=False,
        side_m=0.16,
        cells=4,
        duty=0.5,
        distances_m=distances_m,
        tolerance=1e-4,
        flicker=Flicker.LOW_RISK,
    )


def draw_bands(task: Task, to: Path) -> None:
    """The share of the light that a row sees, at two exposures, and on a null."""
    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    rows = np.arange(80.0)
    exposures = (150.0, task.sensor.exposure_us)
    for axes, exposure_us in zip(figure.subplots(1, 2), exposures, strict=True):
        for hz, style in ((1250.0, "-"), (2450.0, "-"), (1000.0, "--")):
            share = row_weights(
                rows,
                frequency_hz=hz,
                phase_cycles=0.0,
                duty=0.5,
                exposure_us=exposure_us,
                row_time_us=OV5647_ROW_TIME_US,
            )
            axes.plot(rows, 200 * (share - 0.5), style, color=COLOURS.get(hz, "0.5"), label=f"{hz:g} Hz")
        axes.set(xlabel="row of the picture", title=f"exposure {exposure_us:.0f} µs")
        axes.grid(alpha=0.3)
        axes.legend(fontsize=8, loc="upper right")
    figure.axes[0].set_ylabel("light above the mean, %")
    figure.savefig(to, dpi=100)


def draw_second_frequency(task: Task, to: Path) -> None:
    """Draws what one frame tells of a cell, against the frequency of white, with black at 1253 Hz."""
    figure = Figure(figsize=(9.0, 3.6), layout="constrained")
    axes = figure.subplots()
    views = views_of(task)
    black_hz, *others = worthwhile_frequencies(task.sensor.exposure_us, task.flicker.lowest_hz)
    tried = [proposal_at(task, black_hz, hz, 504, views) for hz in others]
    for k, distance_m in enumerate(task.distances_m):
        axes.semilogy(others, [p.alone[k] for p in tried], "o-", ms=4, label=f"{distance_m:g} m")
    axes.axhline(20, color="0.5", lw=1, ls="--")
    axes.text(others[-1], 21, "enough", fontsize=8, color="0.4", ha="right", va="bottom")
    axes.set(xlabel=f"second frequency, Hz (the first is {black_hz:g})", ylabel="nats a cell, one frame")
    axes.grid(alpha=0.3)
    axes.legend(fontsize=8)
    figure.savefig(to, dpi=100)


def draw_period(task: Task, to: Path) -> None:
    """Draws what four frames tell of a cell, against the frame's period; and how far either class advances."""
    figure = Figure(figsize=(9.0, 5.0), layout="constrained")
    nats, advance = figure.subplots(2, 1, sharex=True)
    views = views_of(task)
    rows = range(504, 605)
    period_ms = np.array(rows) * OV5647_ROW_TIME_US * 1e-3
    nats.plot(period_ms, [proposal_at(task, *PAIR, r, views).stream[0] for r in rows], color="black", lw=1.2)
    nats.axhline(20, color="0.5", lw=1, ls="--")
    nats.set(ylabel=f"nats a cell at {task.distances_m[0]:g} m,\n{STREAM_FRAMES} frames", ylim=(0, None))
    for hz in PAIR:
        moved = [abs(phase_advance_cycles(hz, 1e3 * p)) for p in period_ms]
        advance.plot(period_ms, moved, color=COLOURS[hz], label=f"{hz:g} Hz")
    advance.axhspan(0, 0.05, color="0.9", label="frozen")
    advance.set(xlabel="frame period, ms", ylabel="advance a frame,\ncycles off a whole number", ylim=(0, 0.5))
    advance.legend(fontsize=8, loc="upper right", ncols=3)
    for axes in (nats, advance):
        axes.grid(alpha=0.3)
    figure.savefig(to, dpi=100)


def draw(to: Path) -> None:
    """All four, into a folder."""
    near_and_far = default_task(NEAR_M, MIDDLE_M, FAR_M)
    draw_bands(near_and_far, to / "frequencies-bands.png")
    far = default_task(FAR_M)
    draw_contrast(far, proposal_at(far, *PAIR, 504, views_of(far)), to / "frequencies-contrast.png")
    draw_second_frequency(default_task(NEAR_M, MIDDLE_M), to / "frequencies-second.png")
    draw_period(far, to / "frequencies-period.png")
