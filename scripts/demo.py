"""The whole path live, without hardware: `ledpi run` on the simulated camera, `ledpi monitor` at the other end.

Two ptys and a cable between them stand for the serial line. What the monitor prints is set beside the truth: a packet
carries its pose's age, the cable knows when the packet passed, and the daemon's log when the simulated scene began. So
it is known which picture a pose is from, and the simulator, asked here a second time, where the panels are in it.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import re
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
import tty
from collections import Counter, deque
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

from ledpi.camera.recording.reader import TruthMarker
from ledpi.camera.simulated import open_simulated, simulated_sensor
from ledpi.config.settings import Config, load_config
from ledpi.core.records import Floats
from ledpi.wire import MarkerMessage, Receiver

ROOT = Path(__file__).resolve().parents[1]
CONFIG, SOURCE = "config.yaml", "camera.source=simulated"
NEXT = """
Next, in this folder:
    source .venv/bin/activate       # then `ledpi` is a command
    ledpi simulate take; ledpi decode take
    ledpi --help
README.md goes on with a panel, a Pi, and your own program."""
OPTIONS = ("--config", CONFIG, "--set", SOURCE)
PICTURE_SEQ = 236  # the robot at its nearest
SHOW_EVERY_S = 0.5  # of each panel
STOP_S = 5.0  # that a process may take to end
START_S = 20.0  # that it may take to start, on a slow machine
# The sender reckons with a line of 115200 baud, so that on a pty a packet may come up to a FIFO's time before its first
# byte is due. It may come late by a frame's period less this, and is still known to be of its picture.
EARLY_NS = 2_000_000
SILENT_S = 5.0  # so long nothing but poses that were too old to be sent
STILL_TOO_SLOW = (
    f"for {SILENT_S:.0f} s every pose was older than serial.max_age_ms when it was ready, and not sent: this computer "
    "is busy, or too slow to draw the simulated camera's pictures; the demo goes on"
)
TOO_SLOW = (
    "no pose arrived: this computer is busy, or too slow to draw the simulated camera's pictures; each pose was "
    "older than serial.max_age_ms when it was ready, and not sent; the daemon's log counts them as `stale`"
)
HEADING = f"{'time':>7}  {'ID':>4}     {'decoded x, y, z':24}     {'true x, y, z':24}   {'off by':>8}  {'age':>8}"


class Truth:
    """The panels' true places."""

    def __init__(self, config: Config) -> None:
        self._camera = open_simulated(config, paced=False)
        self._sensor = simulated_sensor(config.camera, config.panels)

    def nearest(self, position_m: Floats, exposed_ns: int) -> TruthMarker | None:
        """Returns, of the panels in a picture, the one that is nearest to the pose's direction.

        The picture is the one that was mid-exposed, at the pose's row, at or just before `exposed_ns` of the scene's
        clock.
        """
        sensor, lens = self._sensor, self._sensor.intrinsics
        row = lens.fy * position_m[1] / position_m[2] + lens.cy
        period_ns = sensor.row0_readout_ns(1) - sensor.row0_readout_ns(0)
        seq = int((exposed_ns - 1e9 * sensor.mid_exposure_s(0, row)) // period_ns)
        return min(self._camera.truth(seq), key=lambda m: _apart(m, position_m), default=None)


def _apart(marker: TruthMarker, position_m: Floats) -> float:
    true_m = marker.camera_from_marker.position_m
    return float(np.linalg.norm(true_m / np.linalg.norm(true_m) - position_m / np.linalg.norm(position_m)))


@dataclass(slots=True)
class Tally:
    """Counts of what came out."""

    frames: int = 0
    right: Counter[int] = field(default_factory=Counter)
    wrong: int = 0
    errors_m: list[float] = field(default_factory=list)
    shares: list[float] = field(default_factory=list)  # of the errors in the distance

    def summary(self, packets: str) -> str:
        error = "unknown"
        if self.errors_m:
            error_mm, percent = 1e3 * statistics.median(self.errors_m), 100 * statistics.median(self.shares)
            error = f"{error_mm:.1f} mm ({percent:.2f} % of the distance)"
        right = self.right.total()
        return (
            f"{self.frames} frames, {right + self.wrong} markers, {right} right IDs, {self.wrong} wrong IDs, "
            f"median position error {error}, {packets}"
        )


@dataclass(slots=True)
class Pace:
    """Notices where no pose comes: what is dropped though the line is free was too old."""

    since_s: float | None = None  # of the newest pose, or of the first status
    dropped_before: int = 0
    dropped: int = 0
    told: bool = False

    def is_too_slow(self, message: dict[str, Any], now_s: float) -> bool:
        """Takes each message of the monitor; true once in each time without a pose that was new enough."""
        if message["message"] == "marker":
            self.since_s, self.dropped_before, self.told = now_s, self.dropped, False
        elif message["message"] == "status":
            self.dropped = message["packets_dropped"] or 0
            self.since_s = now_s if self.since_s is None else self.since_s
            if not self.told and now_s - self.since_s >= SILENT_S and self.dropped > self.dropped_before:
                self.told = True
                return True
        return False


@dataclass(frozen=True, slots=True)
class Cable:
    """Two serial ports: what is written to the first can be read from the second."""

    sender: str
    receiver: str
    passed: deque[tuple[int, int, int]]  # ID, age in µs and CLOCK_MONOTONIC of each marker's packet, oldest first

    def passed_ns(self, marker_id: int, age_us: int) -> int:
        """When the next such packet passed. Those that the monitor has missed are forgotten."""
        while True:
            passed_id, passed_age_us, passed_ns = self.passed.popleft()
            if (passed_id, passed_age_us) == (marker_id, age_us):
                return passed_ns


@contextmanager
def cable() -> Iterator[Cable]:
    """Carries bytes until the block is left."""
    (source, source_port), (sink, sink_port) = os.openpty(), os.openpty()
    for port in (source_port, sink_port):
        tty.setraw(port)

    passed: deque[tuple[int, int, int]] = deque()

    def carry() -> None:
        packets = Receiver()
        with suppress(OSError):  # nobody holds the port any more
            while data := os.read(source, 4096):
                now_ns = time.monotonic_ns()
                messages = [m for m in packets.feed(data) if isinstance(m, MarkerMessage)]
                passed.extend((message.id, message.age_us, now_ns) for message in messages)
                os.write(sink, data)

    thread = threading.Thread(target=carry, daemon=True)
    thread.start()
    try:
        yield Cable(sender=os.ttyname(source_port), receiver=os.ttyname(sink_port), passed=passed)
    finally:
        os.close(source_port)
        thread.join(STOP_S)
        for descriptor in (source, sink, sink_port):
            os.close(descriptor)


@contextmanager
def running(log: Path, *arguments: str) -> Iterator[subprocess.Popen[str]]:
    """A ledpi command with its standard error in a file. Ended as by Ctrl-C when the block is left."""
    print("$ ledpi", *arguments, flush=True)
    command = [sys.executable, "-m", "ledpi", *arguments]
    with (
        log.open("w") as errors,
        subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE, stderr=errors, text=True) as process,
    ):
        try:
            yield process
        finally:
            process.send_signal(signal.SIGINT)
            try:
                process.wait(STOP_S)
            except subprocess.TimeoutExpired:
                process.kill()


def watch(
    monitor: subprocess.Popen[str], run: subprocess.Popen[str], run_log: Path, line: Cable, seconds: float
) -> Tally:
    """Reads what the monitor prints until the daemon, ended `seconds` after its first pose, has had its last word."""
    assert monitor.stdout is not None
    truth, tally = Truth(load_config(ROOT / CONFIG, (SOURCE,))), Tally()
    pace = Pace()
    threading.Thread(target=_hang_up, args=(monitor, run, START_S + seconds + STOP_S), daemon=True).start()
    begin_s, end_s = math.inf, time.monotonic() + START_S
    shown_s: dict[int, float] = {}
    for printed in monitor.stdout:
        now_s = time.monotonic()
        message = json.loads(printed)
        if pace.is_too_slow(message, now_s):
            print(STILL_TOO_SLOW, flush=True)
        if message["message"] == "status":
            tally.frames = message["frames"] or tally.frames
        elif message["message"] == "marker" and message["position_m"] and not message["alternate"]:
            if not shown_s:
                begin_s, end_s = now_s, now_s + seconds
                print(HEADING, flush=True)
            passed_ns = line.passed_ns(message["id"], message["age_us"])
            text = judge(message, passed_ns - scene_start_ns(run_log), truth, tally)
            if "WRONG" in text or now_s >= shown_s.get(message["id"], -math.inf) + SHOW_EVERY_S:
                shown_s[message["id"]] = now_s
                print(f"{now_s - begin_s:5.1f} s  {text}", flush=True)
        if now_s >= end_s:
            run.send_signal(signal.SIGINT)
            end_s = math.inf
    return tally


def judge(message: dict[str, Any], passed_ns: int, truth: Truth, tally: Tally) -> str:
    """Counts a marker's pose, passed at a time of the scene's clock, as right or wrong; a line that sets it beside
    the truth.
    """
    marker_id, position_m = message["id"], np.array(message["position_m"])
    true = truth.nearest(position_m, passed_ns - 1000 * message["age_us"] + EARLY_NS)
    x, y, z = position_m
    text = f"{marker_id:4d}     {x:+6.3f}  {y:+6.3f}  {z:6.3f} m"
    if true is None or true.id != marker_id:
        tally.wrong += 1
        return f"{text}     WRONG, " + ("there is no panel" if true is None else f"this is {true.id}")
    true_m = true.camera_from_marker.position_m
    off_m = float(np.linalg.norm(position_m - true_m))
    tally.right[marker_id] += 1
    tally.errors_m.append(off_m)
    tally.shares.append(off_m / float(np.linalg.norm(true_m)))
    x, y, z = true_m
    return f"{text}     {x:+6.3f}  {y:+6.3f}  {z:6.3f} m   {1e3 * off_m:5.1f} mm  {message['age_us'] / 1e3:5.1f} ms"


@cache
def scene_start_ns(run_log: Path) -> int:
    """CLOCK_MONOTONIC at time 0 of the scene's clock. The daemon says so before it sends its first pose."""
    found = re.search(r"time 0 of its scene is (-?\d+) ns", run_log.read_text())
    if found is None:
        sys.exit(f"{run_log}: does not say when the simulated scene began")
    return int(found[1])


def _hang_up(monitor: subprocess.Popen[str], run: subprocess.Popen[str], limit_s: float) -> None:
    """Ends the monitor when the daemon has ended and all that it sent is through, or at the latest after `limit_s`."""
    with suppress(subprocess.TimeoutExpired):
        run.wait(limit_s)
    time.sleep(0.5)
    monitor.send_signal(signal.SIGINT)


@contextmanager
def live_page(log: Path, tap: str) -> Iterator[None]:
    """Shows what the daemon sees, to a browser on this machine, until the block is left."""
    with running(log, "view", "--config", CONFIG, "--set", tap, "--set", "view.listen=127.0.0.1:0") as view:
        if (said := next(iter(view.stdout or ()), "").strip()).startswith("open "):
            print(f"{said} in a browser on this machine to see it live; --seconds 600 gives more time", flush=True)
        yield


def draw_picture(out: Path) -> bool:
    """An annotated picture of one simulated frame."""
    command = ["snapshot", *OPTIONS, "--frame", str(PICTURE_SEQ), "--out", str(out)]
    print("$ ledpi", *command, flush=True)
    return subprocess.run([sys.executable, "-m", "ledpi", *command], cwd=ROOT, check=False).returncode == 0


def main() -> int:
    """Exit status: 0 if panels were read, none of them wrongly, and everything ended as it should."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--seconds", type=float, default=10.0, help="of poses to show (default: 10)")
    parser.add_argument("--out", type=Path, default=ROOT / "demo-out", help="folder for the picture and the logs")
    arguments = parser.parse_args()
    out: Path = arguments.out.absolute()
    out.mkdir(parents=True, exist_ok=True)
    for number in (signal.SIGTERM, signal.SIGINT):  # a shell's background jobs, and what these start, ignore SIGINT
        signal.signal(number, signal.default_int_handler)
    run_log, monitor_log = out / "run.log", out / "monitor.log"
    with (
        tempfile.TemporaryDirectory() as folder,
        cable() as line,
        live_page(out / "view.log", f"tap.socket={folder}/tap.sock"),
        running(monitor_log, "monitor", line.receiver, "--json") as monitor,
    ):
        own = ("--set", f"serial.port={line.sender}", "--set", f"tap.socket={folder}/tap.sock")
        with running(run_log, "run", *OPTIONS, *own) as run:
            tally = watch(monitor, run, run_log, line, arguments.seconds)
        monitor.wait(STOP_S)
    drawn = draw_picture(out / "snapshot.png")
    print(tally.summary((monitor_log.read_text().splitlines() or ["no packets"])[-1]))
    ended = run.returncode == 0 and monitor.returncode == 0
    if not ended:
        print(f"ledpi run or ledpi monitor failed: see {run_log} and {monitor_log}", file=sys.stderr)
    elif not tally.right.total() + tally.wrong:
        print(f"{TOO_SLOW} ({run_log})", file=sys.stderr)
    good = ended and drawn and tally.right and not tally.wrong
    if good:
        print(NEXT)
    return 0 if good else 1


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
