"""Instructions of a frame on 64-bit ARM and on x86-64, and what they make a Raspberry Pi's frames a second.

Of frames without a panel, of those until a panel is first read, and of frames in which one and four are followed, at
10 ms and at 150 µs. The wheel for ARM is run in an emulator (scripts/emulated-aarch64), and built first where none is
given; ten minutes. `--renew` keeps the figures, and writes the tables in docs/ anew.

    python -m evaluation.speed.arm [--wheel dist/ledpi-*_aarch64.whl] [--renew]
"""

from __future__ import annotations

import argparse
import json
import os
import pickle
import subprocess
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from evaluation import ROOT, table
from evaluation.speed import counting
from evaluation.speed.panels import WARM_UP_FRAMES, frames_of, pipeline_of, scene_of
from ledpi.core.records import Frame

FIGURES = Path(__file__).with_name("arm.json")
MACHINES = ("aarch64", "x86_64")
EXPOSURES_US = {"10 ms": 9966.0, "150 µs": 150.0}
FIRST = "first ID"  # from a stream's first frame on, until there is one
PANELS = {"searching": 0, FIRST: 1, "following one": 1, "following four": 4}  # by kind
KINDS, RATES = tuple(PANELS), ("following one", "following four", "searching")
MORE = 6  # frames that count: a stream searches the whole picture in every third

Figures: TypeAlias = dict[str, dict[str, dict[str, int]]]  # by machine, exposure and kind: thousands of instructions


@dataclass(frozen=True)
class Board:
    """A Raspberry Pi, and what is assumed of it: docs/raspberry-pi.md has the sources."""

    name: str
    core: str
    clock_ghz: float
    coremark_ipc: float  # instructions a cycle of CoreMark


BOARDS = (
    Board("Zero 2 W", "Cortex-A53", 1.0, 0.98),
    Board("3 B", "Cortex-A53", 1.2, 0.98),
    Board("4 B", "Cortex-A72", 1.5, 1.70),
    Board("5", "Cortex-A76", 2.4, 2.36),
)
SHARES = (0.5, 1.0)  # of CoreMark's instructions a cycle, that ledpi's code is taken to have


def decode(pictures: Path) -> None:
    """Runs what is counted: a stretch for each exposure and kind, once all is warm."""
    drawn: dict[tuple[str, str], list[Frame]] = pickle.loads(pictures.read_bytes())
    for (exposure, kind), frames in drawn.items():
        scene, count = scene_of(PANELS[kind], EXPOSURES_US[exposure]), PANELS[kind]
        pipeline = pipeline_of(scene, stream=True)
        for frame in frames[:WARM_UP_FRAMES]:
            pipeline.decode(frame)
        if kind == FIRST:
            pipeline = pipeline_of(scene, stream=True)
        counting.mark()
        for frame in frames[WARM_UP_FRAMES:]:
            read = len(pipeline.decode(frame).markers)
            if kind == FIRST and read:
                break
        counting.mark()
        assert read == count, f"{exposure}, {kind}: {read} read"


def drawn() -> dict[tuple[str, str], list[Frame]]:
    """The frames, by exposure and kind."""
    return {
        (exposure, kind): frames_of(scene_of(count, us), WARM_UP_FRAMES + MORE)
        for exposure, us in EXPOSURES_US.items()
        for kind, count in PANELS.items()
    }


def thousands_a_frame(wheel: Path) -> Figures:
    frames = drawn()
    with counting.program_of(__spec__.name, frames) as program:
        counts = {"aarch64": counting.on_aarch64(wheel, program), "x86_64": counting.on_x86_64(program)}
    return {
        machine: {
            exposure: {kind: round(of[exposure, kind] / (1 if kind == FIRST else MORE) / 1e3) for kind in KINDS}
            for exposure in EXPOSURES_US
        }
        for machine in MACHINES
        for of in [dict(zip(frames, counts[machine], strict=True))]
    }


def kept() -> Figures:
    """The figures of the last `--renew`."""
    figures: Figures = json.loads(FIGURES.read_text(encoding="utf-8"))
    return figures


def counts_table(figures: Figures) -> str:
    """Millions of instructions a frame, on ARM and on x86-64."""
    lines = (
        [f"{kind}, {exposure}", *(f"{figures[machine][exposure][kind] / 1e3:.1f}" for machine in MACHINES)]
        for exposure in EXPOSURES_US
        for kind in KINDS
    )
    return table(["millions of instructions a frame", "64-bit ARM", "x86-64"], lines)


def boards_table(figures: Figures) -> str:
    """Frames a second of one core, and milliseconds until a first ID, of each board: from low to high."""
    lines = []
    for board in BOARDS:
        for exposure, counts in figures["aarch64"].items():
            at_most = board.coremark_ipc * board.clock_ghz * 1e6  # thousands of instructions a second
            rates = {kind: [share * at_most / count for share in SHARES] for kind, count in counts.items()}
            shown = [_between(rates[kind]) for kind in RATES]
            first_ms = _between([1e3 / rate for rate in reversed(rates[FIRST])])
            lines.append([board.name, f"{board.core}, {board.clock_ghz:g} GHz", exposure, *shown, f"{first_ms} ms"])
    return table(["Raspberry Pi", "processor", "exposure", *RATES, FIRST], lines)


def _between(values: Sequence[float]) -> str:
    """Two figures of each, as none is known better."""
    return " to ".join(f"{float(f'{value:.2g}'):g}" for value in values)


def tables(figures: Figures) -> Mapping[Path, str]:
    """By the page that each stands on."""
    docs = ROOT / "docs"
    return {docs / "raspberry-pi.md": boards_table(figures), docs / "results.md": counts_table(figures)}


def with_table(page: str, new: str) -> str:
    """The page, with the table instead of the one that has the same first line."""
    head = new.partition("\n")[0]
    before, found, after = page.partition(head)
    if not found:
        raise SystemExit(f"no table with the head {head}")
    rest = after.split("\n")[1:]
    left = next((number for number, line in enumerate(rest) if not line.startswith("|")), len(rest))
    return before + new + "\n" + "\n".join(rest[left:])


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--wheel", type=Path, help="for 64-bit ARM; by default one is built")
    parser.add_argument("--renew", action="store_true", help="keep the figures, and write the tables in docs/ anew")
    parser.add_argument("--pictures", type=Path, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.pictures is not None:
        decode(arguments.pictures)
        return
    with tempfile.TemporaryDirectory() as folder:
        if (wheel := arguments.wheel) is None:
            subprocess.run([ROOT / "scripts" / "wheels", folder], cwd=ROOT, check=True, capture_output=True)
            wheel = next(Path(folder).glob("ledpi-*_aarch64.whl"))
        figures = thousands_a_frame(wheel)
    print(counts_table(figures), boards_table(figures), sep="\n\n")
    if not arguments.renew:
        return
    FIGURES.write_text(json.dumps(figures, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")
    for page, new in tables(figures).items():
        page.write_text(with_table(page.read_text(encoding="utf-8"), new), encoding="utf-8")


if __name__ == "__main__":
    main()
