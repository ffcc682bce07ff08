"""Drivers of panels, built and measured: what their tests and their benchmark share."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np

from evaluation.simulated import TracedWave
from ledpi.camera.recording.writer import RecordingWriter
from ledpi.camera.simulate.scene import OV5647_ROW_TIME_US, Panel, Scene, SimulatedSensor
from ledpi.camera.simulate.scenes import ov5647_lens, whole_rows_us
from ledpi.camera.simulate.trajectory import Still, facing_camera
from ledpi.camera.simulated import SimulatedCamera
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.records import PanelSpec
from ledpi.workshop.panel.firmware import Build, plan_firmware, write_firmware
from tests.builders.simavr import CLOCK_HZ, Cycles, PinTrace, build_with_make

WORDS = load_dictionary("DICT_4X4_50").codewords
EXPOSURE_US, SCAN_TIME_S = 9966.3, 0.0162
SPEC = PanelSpec(side_m=0.16, black_hz=1250.0, white_hz=2450.0)
USUAL_PAIR = (1250.0, 2450.0)
ANTIPHASE = (1253.33, 1253.33)
PAIRS = [USUAL_PAIR, (1262.0, 2350.0), (1450.0, 2949.85), (1656.0, 3951.0), (16000.0, 20000.0)]
IDS = [0, 7, 9, 13, 17, 23, 31, 37, 44, 49]
# Cycles. The emulator counts neither the 4 in which a chip wakes from sleep nor the 4 in which it enters an interrupt.
MAX_JITTER = 4e-6 * CLOCK_HZ - 8

# Cell by cell, row by row, as in firmware/panel/sixteen_cells.c.
CELL_PINS = [f"PD{n}" for n in range(2, 8)] + [f"PB{n}" for n in range(6)] + [f"PC{n}" for n in range(4)]

CHIP_PINS = {f"D{n}": pin for n, pin in enumerate([f"PD{n}" for n in range(8)] + [f"PB{n}" for n in range(6)])}
CHIP_PINS |= {f"A{n}": f"PC{n}" for n in range(6)}


def spec_of(pair: tuple[float, float]) -> PanelSpec:
    """The panel of a pair of frequencies; the antiphase panel of one frequency twice."""
    return replace(SPEC, black_hz=pair[0], white_hz=pair[1], phase="antiphase" if pair[0] == pair[1] else "free")


def program(
    folder: Path,
    build: Build,
    marker_id: int = 7,
    *,
    pair: tuple[float, float] = USUAL_PAIR,
    dictionary: str = "DICT_4X4_50",
) -> Path:
    """The .hex of one panel, as `ledpi panel firmware` writes its sources and `make` builds them; of a pair of one
    frequency twice, in antiphase.
    """
    spec = spec_of(pair)
    planned = plan_firmware(
        build, load_dictionary(dictionary), marker_id, spec, exposure_us=EXPOSURE_US, scan_time_s=SCAN_TIME_S
    )
    write_firmware(planned, folder)
    return build_with_make(folder)


def defined(hex_file: Path, name: str) -> int:
    """A half period in cycles, as the generated settings.h has it."""
    found = re.search(rf"^#define {name}_HALF_PERIOD_CYCLES (\d+)u", (hex_file.parent / "settings.h").read_text(), re.M)
    assert found
    return int(found[1])


def jitter(edges: Cycles, half_period: int) -> int:
    """Cycles between the earliest and the latest edge, against a clock that ticks every half period exactly."""
    return int(np.ptp(edges - half_period * np.arange(len(edges))))


def duty(edges: Cycles) -> float:
    """Share of the whole periods from the first rising edge to the last in which the pin is high."""
    rising, falling = edges[0::2], edges[1::2]
    periods = len(rising) - 1
    return float((falling[:periods] - rising[:periods]).sum() / (rising[periods] - rising[0]))


def shown_word(trace: PinTrace, black_cycles: int, white_cycles: int, begin: int, end: int) -> list[str]:
    """The class of each of 16 cells, by how long its pin keeps a level between two cycles; "?" for neither."""
    halves = {"black": black_cycles, "white": white_cycles}
    word = []
    for pin in CELL_PINS:
        edges = trace.edges[pin]
        lengths = np.diff(edges[(edges >= begin) & (edges < end)])
        word.append(next((name for name, half in halves.items() if _all_near(lengths, half)), "?"))
    return word


def _all_near(lengths: Cycles, half_period: int) -> bool:
    return len(lengths) > 0 and int(np.abs(lengths - half_period).max()) <= MAX_JITTER


def classes(marker_id: int) -> list[str]:
    """The class of each of an ID's 16 cells, row by row."""
    return ["white" if bit else "black" for bit in WORDS[marker_id].ravel()]


def wired_pins(hex_file: Path) -> list[str]:
    """The chip's pin of each cell, row by row, as the README beside the program shows them from the front."""
    page = (hex_file.parent / "README.md").read_text(encoding="utf-8")
    front = page.split("seen from the front")[1].split("**Seen from the back**")[0]
    return [CHIP_PINS[pin] for pin in re.findall(r"\b[AD]\d+\b", front)]


def record_panel(
    folder: Path,
    trace: PinTrace,
    pins: list[str],
    marker_id: int,
    *,
    begin_s: float,
    distance_m: float,
    turned_deg: tuple[float, float] = (0.0, 0.0),
    frames: int,
    dictionary: str = "DICT_4X4_50",
    spec: PanelSpec = SPEC,
) -> None:
    """Photographs a panel whose cells are lit by these pins, from `begin_s` of the trace on; yaw and roll.

    The panel's own word is left empty: nothing of the ID is in the pictures but what the pins bring there.
    """
    sensor = SimulatedSensor(intrinsics=ov5647_lens(), exposure_us=whole_rows_us(1e4, OV5647_ROW_TIME_US))
    shift_s = sensor.exposure_start_s(0) - begin_s
    end_s = trace.end / CLOCK_HZ + shift_s
    waves = {
        pin: TracedWave.from_edges(trace.edges[pin] / CLOCK_HZ + shift_s, begin_s=shift_s, end_s=end_s)
        for pin in set(pins)
    }
    side = math.isqrt(len(pins))
    pose = facing_camera(np.array([0.0, 0.0, distance_m]), yaw_deg=turned_deg[0], roll_deg=turned_deg[1])
    shown = Panel(
        codeword=np.zeros((side, side), bool),
        spec=spec,
        motion=Still(pose),
        marker_id=marker_id,
        cell_waves=tuple(waves[pin] for pin in pins),
    )
    camera = SimulatedCamera(Scene(sensor=sensor, panels=(shown,)), seed=marker_id, paced=False, frames=frames)
    pixels = np.empty((camera.info.height, camera.info.width), np.uint8)
    with RecordingWriter(folder, camera=camera.info, dictionary=dictionary, panel=spec) as writer:
        while (frame := camera.read(pixels)) is not None:
            writer.write(frame, camera.truth(frame.seq))
