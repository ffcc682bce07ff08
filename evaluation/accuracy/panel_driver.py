"""The panel's driver in the emulator simavr, at length: what its tests do for a moment, for five pairs and ten IDs.

For each pair of frequencies and either build, the pins are traced, the sixteen cells for ten IDs one after the other,
told over the serial line. The table has, of each class, the frequency from first edge to last and how far it is off
what was asked for, the worst duty of any pin, and the widest any pin's edges stray from an exact clock. simavr counts
neither the 4 cycles in which a chip wakes from sleep nor the 4 in which it enters an interrupt: where one class's edge
waits for the other's interrupt, a chip adds up to 0.5 µs.

    python -m evaluation.accuracy.panel_driver [--seconds 1]     # a trace, per ID

Needs make, gcc, gcc-avr, avr-libc, libsimavr-dev.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

import numpy as np

from ledpi.workshop.panel.firmware import Build
from tests.builders.panel import CELL_PINS, IDS, PAIRS, classes, defined, duty, jitter, program, shown_word
from tests.builders.simavr import CLOCK_HZ, MISSING, Cycles, emulate

_TELLING_S = 0.03  # a line of eight characters, and the EEPROM


def main() -> None:
    """Prints the table."""
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("--seconds", type=float, default=1.0, help="traced for each ID")
    seconds = arguments.parse_args().seconds
    if MISSING:
        sys.exit(f"not installed: {', '.join(MISSING)}")
    print("| asked, Hz | build | black | white | worst duty | jitter | words right |")
    print("|---|---|---|---|---|---|---|")
    for pair in PAIRS:
        for build in Build:
            with tempfile.TemporaryDirectory() as work:
                row = _two_outputs if build is Build.TWO_OUTPUTS else _sixteen_cells
                print(f"| {pair[0]:g} / {pair[1]:g} | {build} | {row(pair, seconds, Path(work))} |", flush=True)


def _two_outputs(pair: tuple[float, float], seconds: float, work: Path) -> str:
    built = program(work / "sources", Build.TWO_OUTPUTS, pair=pair)
    trace = emulate(built, seconds * len(IDS), work=work)
    classes_edges = [trace.edges["PB1"]], [trace.edges["PB2"]]
    return f"{_measured(built, pair, *classes_edges)} | by wiring"


def _sixteen_cells(pair: tuple[float, float], seconds: float, work: Path) -> str:
    built = program(work / "sources", Build.SIXTEEN_CELLS, pair=pair)
    starts = [_TELLING_S + n * (seconds + 2 * _TELLING_S) for n in range(len(IDS))]
    told = [
        (start - _TELLING_S / 2, f"id {marker_id}\n".encode()) for start, marker_id in zip(starts, IDS, strict=True)
    ]
    trace = emulate(built, starts[-1] + 2 * _TELLING_S + seconds, work=work, arrivals=told)
    by_class: dict[str, list[Cycles]] = {"black": [], "white": []}
    right = 0
    for start, marker_id in zip(starts, IDS, strict=True):
        begin, end = (int((start + t) * CLOCK_HZ) for t in (_TELLING_S, _TELLING_S + seconds))
        word = shown_word(trace, defined(built, "BLACK"), defined(built, "WHITE"), begin, end)
        right += word == classes(marker_id)
        for pin, name in zip(CELL_PINS, classes(marker_id), strict=True):
            first = int(np.searchsorted(trace.edges[pin], begin))
            first += first % 2  # from a rising edge on
            by_class[name].append(trace.edges[pin][first : np.searchsorted(trace.edges[pin], end)])
    return f"{_measured(built, pair, by_class['black'], by_class['white'])} | {right} of {len(IDS)}"


def _measured(built: Path, pair: tuple[float, float], black: list[Cycles], white: list[Cycles]) -> str:
    columns, worst_duty, widest = [], 0.5, 0
    for asked_hz, name, pins in ((pair[0], "BLACK", black), (pair[1], "WHITE", white)):
        longest = max(pins, key=lambda edges: int(np.ptp(edges)))
        made_hz = (len(longest) - 1) / 2 * CLOCK_HZ / float(np.ptp(longest))
        columns.append(f"{made_hz:.3f} Hz, {(made_hz / asked_hz - 1) * 1e6:+.1f} ppm")
        worst_duty = max((worst_duty, *map(duty, pins)), key=lambda share: abs(share - 0.5))
        widest = max(widest, *(jitter(edges, defined(built, name)) for edges in pins))
    return " | ".join([*columns, f"{100 * worst_duty:.3f} %", f"{widest / CLOCK_HZ * 1e6:.2f} µs"])


if __name__ == "__main__":
    main()
