"""The pictures of docs/first-panel.md: the driver's program is built, run in simavr, and photographed.

Needs make, gcc, gcc-avr, avr-libc, libsimavr-dev and poppler-utils.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np
from matplotlib.figure import Figure

from evaluation.simulated import TracedWave
from ledpi.camera.simulate.scene import OV5647_ROW_TIME_US
from ledpi.camera.simulate.scenes import whole_rows_us
from ledpi.workshop.panel.firmware import Build
from tests.builders.panel import program, record_panel, wired_pins
from tests.builders.simavr import CLOCK_HZ, ROOT, PinTrace, emulate

MARKER_ID = 7
OUTPUTS = {"PB1": ("D9, class black", "#3c8ceb"), "PB2": ("D10, class white", "#faaf32")}
ANTIPHASE = ("phase=antiphase", "black_hz=1253.33", "white_hz=1253.33")
DIRECT = ["--direct", "--side", "0.12", *(word for key in ANTIPHASE for word in ("--set", f"panels.{key}"))]
TRACED_S, SETTLED_S = 0.12, 0.01
EXPOSURE_S = whole_rows_us(1e4, OV5647_ROW_TIME_US) * 1e-6


def draw_waves(trace: PinTrace, to: Path) -> None:
    """Draws what the pins do, and what an exposure of 10 ms leaves of it in a column of pixels."""
    figure = Figure(figsize=(8.0, 5.2), layout="constrained")
    pins, rows = figure.subplots(2, 1)
    y = np.arange(80)
    for index, (pin, (name, colour)) in enumerate(OUTPUTS.items()):
        edges_s = trace.edges[pin] / CLOCK_HZ
        times_ms = np.concatenate([[SETTLED_S], edges_s[edges_s > SETTLED_S]]) * 1e3
        levels = [trace.is_high(pin, round(t * 1e-3 * CLOCK_HZ)) for t in times_ms]
        pins.step(times_ms - SETTLED_S * 1e3, np.array(levels) * 0.8 - 1.2 * index, where="post", color=colour)
        wave = TracedWave.from_edges(edges_s, begin_s=0.0, end_s=trace.end / CLOCK_HZ)
        share = wave.share_on(SETTLED_S + y * OV5647_ROW_TIME_US * 1e-6, EXPOSURE_S)
        rows.plot(y, 100 * (share / share.mean() - 1), color=colour, label=name)
    pins.set(xlim=(0, 3), xlabel="ms", title="The driver's pins, traced in an emulator", yticks=[0.4, -0.8])
    pins.set_yticklabels([name for name, _ in OUTPUTS.values()])
    rows.set(xlim=(0, 79), ylim=(-4.5, 6.5), xlabel="row of the picture", ylabel="% of the cell's light")
    rows.set_title(f"What the camera's rows see of it, exposed for {EXPOSURE_S * 1e3:.2f} ms each")
    rows.legend(loc="upper right", ncols=2)
    figure.savefig(to, dpi=100)


def draw_sheets(work: Path, to: Path) -> None:
    """The first page of either build sheet, and the circuit of the second; each without its empty lower part."""
    for options, name in (([], "first-panel-sheet.png"), (DIRECT, "first-hour-sheet.png")):
        command = [sys.executable, "-m", "ledpi", "panel", "sheet", str(MARKER_ID), "--out", str(work), *options]
        subprocess.run(command, cwd=ROOT, check=True)
        pages = work / Path(name).stem
        subprocess.run(["pdftoppm", "-png", "-r", "90", work / f"panel-{MARKER_ID}.pdf", pages], check=True)
        overview, drawings = (cv2.imread(f"{pages}-{number}.png") for number in (1, 2))
        written = np.flatnonzero(overview.min(axis=(1, 2)) < 255)
        cv2.imwrite(str(to / name), overview[: written[-1] + 20])
        if not options:
            cv2.imwrite(str(to / "first-panel-circuit.png"), drawings[: int(0.47 * len(drawings))])


def take_snapshot(trace: PinTrace, pins: list[str], work: Path, to: Path) -> None:
    """A panel lit by these pins, 0.9 m away, as `ledpi snapshot` shows it."""
    record_panel(
        work / "first-panel",
        trace,
        pins,
        MARKER_ID,
        begin_s=SETTLED_S,
        distance_m=0.9,
        turned_deg=(20.0, 0.0),
        frames=1,
    )
    command = [sys.executable, "-m", "ledpi", "snapshot", str(work / "first-panel"), "--out", str(to)]
    subprocess.run(command, cwd=ROOT, check=True)


def draw(to: Path) -> None:
    """All five, into a folder."""
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        built = program(work / "driver", Build.TWO_OUTPUTS, MARKER_ID)
        trace = emulate(built, TRACED_S, work=work)
        draw_waves(trace, to / "driver-waves.png")
        draw_sheets(work, to)
        take_snapshot(trace, wired_pins(built), work, to / "first-panel.jpg")
