"""Fifty clients of the tap, ten of them stalled, for minutes: the daemon's memory stays flat, and no packet is lost.

The daemon reads a recording, paced as its sensor, and keeps the last seconds. Of its clients two ask for pictures with
all reasons, ten ask and never read, and are there again as soon as they are parted with; the others read each line.
The memory of its own (RssAnon) is looked at each second: after the warm-up, in which ring, caches and heap fill, the
medians of the first and of the last quarter may differ by --allow-mib. Exit status 1 where they do, or where a packet
was lost or damaged, a client that reads was parted with, or the daemon ended.

    python -m evaluation.endurance crowd [--warm-up 5] [--minutes 10] [--clients 50] [--allow-mib 1]
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
import threading
import time
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from evaluation.endurance.soak import MIB, Sample, sample
from evaluation.speed.latency import latencies_ms, recording_in_memory
from ledpi.core.errors import TapError
from ledpi.tap.client import Client, connect
from tests.builders.daemon import controller, daemon
from tests.builders.tap import Raw, reach

RING_MB = 32
PICTURED, STALLED = 2, 10
TOLD_S = 60.0  # between two lines of the table that is printed on the way
STALLED_LOOK_S = 1.0  # between two looks whether one was parted with


class Crowd:
    """The clients, each in a thread of its own but for those that stall."""

    def __init__(self, path: Path, clients: int) -> None:
        self._path, self._ending = path, threading.Event()
        self._clients: list[Client] = []
        self.lines = self.pictures = self.parted_readers = self.parted_stalled = 0
        jobs = [self._watch] * PICTURED + [self._read] * (clients - PICTURED - STALLED) + [self._stall] * STALLED
        self._threads = [threading.Thread(target=job, daemon=True) for job in jobs]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        """All leave."""
        self._ending.set()
        for client in self._clients:
            client.close()
        for thread in self._threads:
            thread.join(5.0)

    def _read(self) -> None:
        client = connect(self._path)
        self._clients.append(client)
        for line in client.lines():
            self.lines += line["type"] == "decoded"
        self.parted_readers += not self._ending.is_set()

    def _watch(self) -> None:
        with connect(self._path) as client:
            while not self._ending.is_set():
                try:
                    client.picture("rejected", "evidence")
                except TapError:
                    self.parted_readers += not self._ending.is_set()
                    return
                self.pictures += 1

    def _stall(self) -> None:
        """Asks for more than it takes."""
        while not self._ending.is_set():
            client = Raw(self._path)
            try:
                while not self._ending.wait(STALLED_LOOK_S):
                    client.send({"do": "picture", "id": 1})
            except OSError:
                self.parted_stalled += 1
            finally:
                client.close()


def follow(pid: int, seconds: float) -> list[Sample]:
    """The process each second, with a line each minute."""
    samples: list[Sample] = []
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s and (now := sample(pid, 0)) is not None:
        samples.append(now)
        if len(samples) % TOLD_S == 0:
            print(f"{now.memory / MIB:.2f} MiB, {now.descriptors} descriptors", flush=True)
        time.sleep(1.0)
    return samples


def judge(warm_up: float, minutes: float, clients: int, allow_mib: float) -> list[str]:
    """Runs it, prints what came of it, and returns what is wrong with that."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        take, line = stack.enter_context(recording_in_memory()), stack.enter_context(controller())
        tap = folder / "tap.sock"
        settings = (f"camera.source=recording:{take}", f"serial.port={line.port}", f"tap.socket={tap}")
        started = daemon(
            *settings,
            f"rewind.memory_mb={RING_MB}",
            options=("--frames", "100000000"),
            life_s=60 * (warm_up + minutes) + 300,
        )
        process = stack.enter_context(started)
        reach(tap).close()
        crowd = Crowd(tap, clients)
        follow(process.pid, 60 * warm_up)
        first = len(line.markers)
        samples = follow(process.pid, 60 * minutes)
        lives, parted = process.poll() is None, crowd.parted_readers
        crowd.close()
        counters, latency_ms = line.receiver.counters, latencies_ms(line.markers[first:], take)
    quarter = max(1, len(samples) // 4)
    before, after = (
        statistics.median(s.memory for s in part) / MIB for part in (samples[:quarter], samples[-quarter:])
    )
    print(
        f"{clients} clients, {STALLED} of them stalled ({crowd.parted_stalled} were parted with), {minutes:g} minutes: "
        f"{crowd.lines} lines and {crowd.pictures} pictures were read; {counters.good} packets, {counters.lost} lost, "
        f"{sum(counters.bad.values())} bad; frame ready → first byte: median {np.median(latency_ms):.2f} ms, p99 "
        f"{np.percentile(latency_ms, 99):.2f} ms\n"
        f"memory {before:.2f} MiB in the first quarter, {after:.2f} MiB in the last: growth {after - before:+.2f} MiB; "
        f"descriptors {samples[0].descriptors} → {samples[-1].descriptors}, threads {samples[0].threads} → "
        f"{samples[-1].threads}"
    )
    faults = {
        "the daemon ended": not lives,
        f"memory has grown by {after - before:.2f} MiB": after - before > allow_mib,
        f"{counters.lost} packets were lost, {sum(counters.bad.values())} were bad": bool(
            counters.lost or counters.bad
        ),
        f"{parted} clients that read were parted with": bool(parted),
        "no client got a picture": not crowd.pictures,
        "no stalled client was parted with": not crowd.parted_stalled and minutes >= 1,
    }
    return [fault for fault, holds in faults.items() if holds]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--warm-up", type=float, default=5.0, help="minutes before, in which caches and heap fill")
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--clients", type=int, default=50)
    parser.add_argument("--allow-mib", type=float, default=1.0, help="growth that is taken for none")
    arguments = parser.parse_args()
    faults = judge(arguments.warm_up, arguments.minutes, arguments.clients, arguments.allow_mib)
    for fault in faults:
        print(f"crowd: {fault}", file=sys.stderr)
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
