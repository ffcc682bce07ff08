"""Bridges for minutes: replayed taps at 60 frames a second into one mosquitto, and one into an ntcore server.

The broker wants TLS and a password. Told for each: how long after the tap had it a frame arrives (ms), how much memory
the bridges gain, and after the broker or the server was killed half-way and started again 5 s later, how soon frames
come and whether one of them is old. All is on one machine, so one clock judges. Exit status 1 where an old frame came,
or none. `--renew` keeps the figures, and writes the table in docs/results.md anew.

    python -m evaluation.endurance.bridges [--minutes 10] [--taps 10] [--renew]
"""

from __future__ import annotations

import argparse
import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from evaluation import ROOT, table
from evaluation.endurance.process import sample
from evaluation.speed.arm import with_table
from tests.builders.bridges import Far, Nt, Secure, bridge, secrets
from tests.builders.made_up_daemon import MadeUpDaemon
from tests.builders.waiting import wait_until

FRAME_S = 1 / 60
AWAY_S = 5.0
FIGURES = Path(__file__).with_name("bridges.json")
OLD_US = 300_000  # serial.max_age_ms, and 0.2 s that a busy machine may take to deliver


@dataclass(frozen=True)
class Figures:
    """Figures of one kind of far end."""

    kind: str
    minutes: float
    taps: int
    frames: int
    late_ms: float  # median, from when the tap had a frame
    late_p99_ms: float
    back_s: float  # median of the taps, from the far end's start
    back_worst_s: float
    old: int
    gained_kib: int  # the bridge that has gained most
    load: float  # of the machine, in processes that would run, in the last 15 minutes
    processors: int


class Robots(Secure):
    """A broker, and the frames of each robot: when it came, and when the tap had it (CLOCK_MONOTONIC, ns)."""

    def __init__(self, folder: Path, robots: int) -> None:
        super().__init__(folder)
        self.came: list[list[tuple[int, int]]] = [[] for _ in range(robots)]

    def prepare(self, client: Any) -> None:
        super().prepare(client)
        client.on_connect = lambda *_: client.subscribe("+/frame")

    def _hear(self, message: Any) -> None:
        robot = int(message.topic.partition("/")[0].removeprefix("robot"))
        self.came[robot].append((time.monotonic_ns(), json.loads(message.payload)["decoded_ns"]))


def memory_kib(process: subprocess.Popen[bytes]) -> int:
    """Resident."""
    now = sample(process.pid)
    assert now is not None, "a bridge has ended"
    return now.resident // 1024


def through_an_outage(far: Far, seconds: float) -> int:
    """Returns when the far end was back (CLOCK_MONOTONIC, ns); half of the time is over then."""
    time.sleep(max(0.0, seconds / 2 - AWAY_S))
    far.vanish()
    time.sleep(AWAY_S)
    far.start()
    back_ns = time.monotonic_ns()
    time.sleep(seconds / 2)
    return back_ns


def mqtt(seconds: float, taps: int, folder: Path) -> Figures:
    """Measures a bridge of each tap, into one broker."""
    secrets(folder)
    far = Robots(folder, taps)
    far.start()
    with ExitStack() as stack:
        stack.callback(far.close)
        bridges = []
        for robot in range(taps):
            own = folder / str(robot)
            own.mkdir()
            stack.callback(MadeUpDaemon(own / "tap.sock", numbered=True, frame_s=FRAME_S).close)
            settings = far.settings | {"topic": f"robot{robot}"}
            bridges.append(stack.enter_context(bridge(settings, own / "tap.sock", own)))
        wait_until(lambda: all(far.came))
        before = [memory_kib(one.process) for one in bridges]
        back_ns = through_an_outage(far, seconds)
        gained = [memory_kib(one.process) - old for one, old in zip(bridges, before, strict=True)]
    late_ms = [(came - had) / 1e6 for robot in far.came for came, had in robot]
    after = [[frame for frame in robot if frame[0] > back_ns] for robot in far.came]
    back_s = [(robot[0][0] - back_ns) / 1e9 for robot in after if robot]
    old = sum(came - had > 1000 * OLD_US for robot in after for came, had in robot)
    assert len(back_s) == taps, "a robot was not heard of again"
    return figures_of("mqtt", seconds, late_ms, back_s, old, gained)


def nt(seconds: float, folder: Path) -> Figures:
    """Measures one bridge into a server."""
    far = Nt(folder)
    far.start()
    with ExitStack() as stack:
        stack.callback(far.close)
        stack.callback(MadeUpDaemon(folder / "tap.sock", numbered=True, frame_s=FRAME_S).close)
        one = stack.enter_context(bridge(far.settings, folder / "tap.sock", folder))
        wait_until(lambda: bool(far.frames))
        before = memory_kib(one.process)
        back_ns = through_an_outage(far, seconds)
        gained = memory_kib(one.process) - before
    after = [frame for frame in far.frames if frame[0] > back_ns]
    old = sum(age_us > OLD_US for _, _, age_us in after)
    late_ms = [age_us / 1e3 for _, _, age_us in far.frames]
    return figures_of("nt", seconds, late_ms, [(after[0][0] - back_ns) / 1e9], old, [gained])


def figures_of(
    kind: str, seconds: float, late_ms: list[float], back_s: list[float], old: int, gained_kib: list[int]
) -> Figures:
    """Sums them up."""
    median, p99 = np.percentile(late_ms, (50, 99))
    return Figures(
        kind=kind,
        minutes=seconds / 60,
        taps=len(back_s),
        frames=len(late_ms),
        late_ms=round(float(median), 1),
        late_p99_ms=round(float(p99)),
        back_s=round(statistics.median(back_s), 2),
        back_worst_s=round(max(back_s), 2),
        old=old,
        gained_kib=max(gained_kib),
        load=round(os.getloadavg()[2], 1),
        processors=os.cpu_count() or 1,
    )


def kept() -> list[Figures]:
    """The figures of the last `--renew`."""
    return [Figures(**values) for values in json.loads(FIGURES.read_text(encoding="utf-8"))]


def figures_table(figures: list[Figures]) -> str:
    """A line for each kind of far end."""
    head = ["far end", "taps", "minutes", "frames", "late", "late, 99 %", "back after", "old frames", "memory", "load"]
    lines = [
        [
            one.kind,
            str(one.taps),
            f"{one.minutes:g}",
            str(one.frames),
            f"{one.late_ms:.1f} ms",
            f"{one.late_p99_ms:.0f} ms",
            f"{one.back_s:.2f} s, at most {one.back_worst_s:.2f} s",
            str(one.old),
            f"{one.gained_kib:+} KiB",
            f"{one.load:g} on {one.processors}",
        ]
        for one in figures
    ]
    return table(head, lines)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--taps", type=int, default=10)
    parser.add_argument("--renew", action="store_true", help="keep the figures, and write the table in docs/ anew")
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as other:
        figures = [mqtt(60 * asked.minutes, asked.taps, Path(one)), nt(60 * asked.minutes, Path(other))]
    print(figures_table(figures))
    if asked.renew:
        FIGURES.write_text(json.dumps([asdict(one) for one in figures], indent=1) + "\n", encoding="utf-8")
        page = ROOT / "docs" / "results.md"
        page.write_text(with_table(page.read_text(encoding="utf-8"), figures_table(figures)), encoding="utf-8")
    return 1 if any(one.old for one in figures) else 0


if __name__ == "__main__":
    sys.exit(main())
