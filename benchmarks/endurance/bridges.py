"""Bridges for minutes: replayed taps at 60 frames a second into one mosquitto, and one into an ntcore server.

Told for each: how long after the tap had it a frame arrives (ms), how much memory the bridges gain, and after the
broker or the server was killed half-way and started again 5 s later, how soon frames come and whether one of them is
old. All is on one machine, so one clock judges. Exit status 1 where an old frame came, or none.

    python -m benchmarks.endurance bridges [--minutes 10] [--taps 10]
"""

from __future__ import annotations

import argparse
import json
import statistics
import subprocess
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from tests.builders.bridges import Far, Mqtt, Nt, bridge
from tests.builders.made_up_daemon import MadeUpDaemon
from tests.builders.tap import wait_until

FRAME_S = 1 / 60
AWAY_S = 5.0
OLD_US = 300_000  # serial.max_age_ms, and 0.2 s that a busy machine may take to deliver


class Robots(Mqtt):
    """A broker, and the frames of each robot: when it came, and when the tap had it (CLOCK_MONOTONIC, ns)."""

    def __init__(self, folder: Path, robots: int) -> None:
        super().__init__(folder)
        self.came: list[list[tuple[int, int]]] = [[] for _ in range(robots)]

    def prepare(self, client: Any) -> None:
        client.on_connect = lambda *_: client.subscribe("+/frame")

    def _hear(self, message: Any) -> None:
        robot = int(message.topic.partition("/")[0].removeprefix("robot"))
        self.came[robot].append((time.monotonic_ns(), json.loads(message.payload)["decoded_ns"]))


def memory_kib(process: subprocess.Popen[bytes]) -> int:
    """Resident."""
    return int(Path(f"/proc/{process.pid}/statm").read_text(encoding="ascii").split()[1]) * 4


def through_an_outage(far: Far, seconds: float) -> int:
    """Returns when the far end was back (CLOCK_MONOTONIC, ns); half of the time is over then."""
    time.sleep(max(0.0, seconds / 2 - AWAY_S))
    far.vanish()
    time.sleep(AWAY_S)
    far.start()
    back_ns = time.monotonic_ns()
    time.sleep(seconds / 2)
    return back_ns


def mqtt(seconds: float, taps: int, folder: Path) -> bool:
    """Returns whether nothing old came."""
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
    tell("mqtt", late_ms, back_s, old, gained)
    return old == 0 and len(back_s) == taps


def nt(seconds: float, folder: Path) -> bool:
    """Returns whether nothing old came."""
    far = Nt(folder)
    far.start()
    made_up = MadeUpDaemon(folder / "tap.sock", numbered=True, frame_s=FRAME_S)
    try:
        with bridge(far.settings, folder / "tap.sock", folder) as one:
            wait_until(lambda: bool(far.frames))
            before = memory_kib(one.process)
            back_ns = through_an_outage(far, seconds)
            gained = memory_kib(one.process) - before
    finally:
        made_up.close()
        far.close()
    after = [frame for frame in far.frames if frame[0] > back_ns]
    old = sum(age_us > OLD_US for _, _, age_us in after)
    tell("nt", [age_us / 1e3 for _, _, age_us in far.frames], [(after[0][0] - back_ns) / 1e9], old, [gained])
    return old == 0


def tell(kind: str, late_ms: list[float], back_s: list[float], old: int, gained_kib: list[int]) -> None:
    """One line."""
    median, p99 = np.percentile(late_ms, (50, 99))
    print(
        f"{kind}: {len(late_ms)} frames, {median:.1f} ms after the tap (p99 {p99:.0f}); back after "
        f"{statistics.median(back_s):.2f} s (worst {max(back_s):.2f}), {old} old frames; memory +{max(gained_kib)} KiB",
        flush=True,
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--taps", type=int, default=10)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as one, tempfile.TemporaryDirectory() as other:
        whole = mqtt(60 * asked.minutes, asked.taps, Path(one))
        whole &= nt(60 * asked.minutes, Path(other))
    return 0 if whole else 1


if __name__ == "__main__":
    sys.exit(main())
