"""The loop closed: the driver's program → its pins → light → rolling-shutter frames → `ledpi decode` → the same ID.

The cells are wired as the README beside the program says, and lit by the traced edges alone.
"""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ledpi.camera.recording.reader import load_recording
from ledpi.workshop.panel.firmware import Build
from tests.builders.panel import ANTIPHASE, CHIP_PINS, program, record_panel, spec_of, wired_pins
from tests.builders.simavr import ROOT, PinTrace, emulate, needs_simavr

pytestmark = needs_simavr

WIRED_IDS = [0, 4, 7, 12, 19, 20, 26, 34, 41, 48]  # by the wiring of the two-output build
TOLD_IDS = [1, 5, 9, 14, 23, 29, 36, 38, 44, 49]  # over the serial line of the sixteen-cell build
TRACED_S = 0.16
FRAMES = 2
PATHS = os.environ | {"PYTHONPATH": str(ROOT)}
UPRIGHT_PX = 1.0  # a corner of a marker read a quarter turn wrong would be a panel's side away


def traces(work: Path) -> dict[int, tuple[PinTrace, list[str]]]:
    """Records what the pins did for each ID, and which pin each of its cells is wired to."""
    found = {}
    for marker_id in WIRED_IDS:
        built = program(work / f"two{marker_id}", Build.TWO_OUTPUTS, marker_id)
        found[marker_id] = emulate(built, TRACED_S, work=work), wired_pins(built)
    built = program(work / "sixteen", Build.SIXTEEN_CELLS)
    for marker_id in TOLD_IDS:
        told = [(0.01, f"id {marker_id}\n".encode())]
        found[marker_id] = emulate(built, TRACED_S, work=work, arrivals=told), wired_pins(built)
    return found


def decoded(folder: Path) -> list[dict[str, Any]]:
    """Returns what `ledpi decode` says of each frame of the recordings there, each frame alone."""
    all_ids = f"panels.ids={list(range(50))}"  # also those that a part or a reflection of another panel can show
    command = [sys.executable, "-m", "ledpi", "decode", "--single-frame", "--set", all_ids, str(folder)]
    done = subprocess.run(command, cwd=folder, env=PATHS, capture_output=True, text=True, check=True)
    return [json.loads(line) for line in done.stdout.splitlines()]


@pytest.mark.slow
def test_twenty_panels_are_read_from_their_drivers_pins(tmp_path: Path) -> None:
    """Single frames, 0.6 to 1.4 m away, turned this way and that: the ID, and each corner where it belongs."""
    shown = tmp_path / "shown"
    for index, (marker_id, (trace, pins)) in enumerate(traces(tmp_path).items()):
        record_panel(
            shown / f"{marker_id:02d}",
            trace,
            pins,
            marker_id,
            begin_s=0.06,  # told its ID by then
            distance_m=0.6 + 0.8 * index / 19,
            turned_deg=([0.0, 30.0, -20.0, 10.0][index % 4], 18.0 * index),
            frames=FRAMES,
        )
    lines = decoded(shown)
    assert len(lines) == FRAMES * len(WIRED_IDS + TOLD_IDS)
    for line in lines:
        truth = load_recording(shown / Path(line["recording"]).name).truth
        assert truth is not None
        (expected,) = truth[line["seq"]]
        assert [marker["id"] for marker in line["markers"]] == [expected.id]
        corners_px = np.array(line["markers"][0]["corners_px"])
        assert np.abs(corners_px - expected.corners_px).max() < UPRIGHT_PX


@pytest.mark.slow
def test_a_grid_of_36_cells_is_read_from_two_pins(tmp_path: Path) -> None:
    """More cells than the chip has pins: the two-output build drives them as two groups."""
    built = program(tmp_path / "two", Build.TWO_OUTPUTS, 11, dictionary="DICT_6X6_50")
    trace = emulate(built, TRACED_S, work=tmp_path)
    record_panel(
        tmp_path / "shown/6x6",
        trace,
        wired_pins(built),
        11,
        begin_s=0.06,
        distance_m=0.6,
        frames=FRAMES,
        dictionary="DICT_6X6_50",
    )
    assert [[marker["id"] for marker in line["markers"]] for line in decoded(tmp_path / "shown")] == [[11], [11]]


@pytest.mark.slow
def test_antiphase_panels_are_read_from_their_drivers_pins(tmp_path: Path) -> None:
    """By the wiring, and by an ID told over the serial line; at 2.2 m, from one frame each."""
    wired = program(tmp_path / "two", Build.TWO_OUTPUTS, 7, pair=ANTIPHASE)
    told = program(tmp_path / "sixteen", Build.SIXTEEN_CELLS, pair=ANTIPHASE)
    arrivals: dict[int, list[tuple[float, bytes]]] = {7: [], 23: [(0.01, b"id 23\n")]}
    for marker_id, built in ((7, wired), (23, told)):
        trace = emulate(built, TRACED_S, work=tmp_path, arrivals=arrivals[marker_id])
        record_panel(
            tmp_path / f"shown/{marker_id:02d}",
            trace,
            wired_pins(built),
            marker_id,
            begin_s=0.06,
            distance_m=2.2,
            turned_deg=(0.0, 30.0),
            frames=FRAMES,
            spec=spec_of(ANTIPHASE),
        )
    read = [[marker["id"] for marker in line["markers"]] for line in decoded(tmp_path / "shown")]
    assert read == [[7], [7], [23], [23]]


@pytest.mark.slow
def test_the_panel_of_the_first_hour_is_read_from_its_pins(tmp_path: Path) -> None:
    """12 cm wide, wired as `ledpi panel sheet --direct` says, in antiphase; at a metre, from one frame each."""
    built = program(tmp_path / "direct", Build.SIXTEEN_CELLS, 7, pair=ANTIPHASE)
    record_panel(
        tmp_path / "shown/7",
        emulate(built, TRACED_S, work=tmp_path),
        [CHIP_PINS[pin] for row in sheet_rows(tmp_path / "sheet") for pin in row],
        7,
        begin_s=0.06,
        distance_m=1.0,
        turned_deg=(20.0, 5.0),
        frames=FRAMES,
        spec=replace(spec_of(ANTIPHASE), side_m=0.12),
    )
    assert [[marker["id"] for marker in line["markers"]] for line in decoded(tmp_path / "shown")] == [[7], [7]]


def sheet_rows(folder: Path) -> list[list[str]]:
    """The pins of the cells, row by row, by where the sheet's front page has them."""
    command = ["panel", "sheet", "7", "--direct", "--side", "0.12", "--out", str(folder)]
    subprocess.run([sys.executable, "-m", "ledpi", *command], cwd=folder.parent, env=PATHS, check=True)
    placed = [
        (float(y), float(x), pin)
        for pin, x, y in re.findall(
            r"<!-- ([AD]\d+) -->\s*<g [^>]*translate\(([\d.]+) ([\d.]+)\)", (folder / "panel-7-front.svg").read_text()
        )
    ]
    rows = sorted({round(y) for y, _, _ in placed})
    return [[pin for y, _, pin in sorted(placed, key=lambda p: p[1]) if round(y) == row] for row in rows]


@pytest.mark.slow
def test_swapped_outputs_do_not_show_the_id(tmp_path: Path) -> None:
    """Nothing but the pins tells the ID: black's cells on white's output and the reverse are another word, or none."""
    built = program(tmp_path / "two", Build.TWO_OUTPUTS, 7)
    swapped = [{"PB1": "PB2", "PB2": "PB1"}[pin] for pin in wired_pins(built)]
    trace = emulate(built, TRACED_S, work=tmp_path)
    record_panel(tmp_path / "shown/7", trace, swapped, 7, begin_s=0.06, distance_m=0.8, frames=FRAMES)
    assert [line["markers"] for line in decoded(tmp_path / "shown")] == [[], []]
