"""Fifty clients of the tap, or fifty viewers of the live page, for minutes: memory stays flat, and nobody is lost.

`tap`: the daemon reads a recording, paced as its sensor, and keeps the last seconds. Of its clients two ask for
pictures with all reasons, ten ask and never read, and are there again as soon as they are parted with; the others read
each line. No packet may be lost or damaged, and no client that reads parted with. `page`: a daemon that is made up
shows pictures of 640 × 480. Each viewer asks for one kind, one after the other; two are more than there are places. The
page may take no more than MemoryMax of ledpi-view.service, and each viewer that has a place must get pictures.

The memory of its own (RssAnon) is looked at each second: after the warm-up, in which ring, caches and heap fill, the
medians of the first and of the last quarter may differ by --allow-mib. Exit status 1 where one of this does not hold.

    python -m evaluation.endurance.crowd [tap|page] [--warm-up 5] [--minutes 10] [--clients 50] [--allow-mib 1]
"""

from __future__ import annotations

import argparse
import re
import tempfile
import threading
from contextlib import ExitStack
from pathlib import Path

import numpy as np

from evaluation import ROOT, end
from evaluation.endurance.process import MIB, follow, growth_mib
from evaluation.speed.latency import latencies_ms, recording_in_memory
from ledpi.core.errors import TapError
from ledpi.daemon.tap.client import Client, connect
from ledpi.page.connections import MOST
from tests.builders.daemon import controller, daemon
from tests.builders.made_up_daemon import LARGE, MadeUpDaemon
from tests.builders.tap import Raw, reach
from tests.builders.view import view, watched
from tests.builders.waiting import wait_until

RING_MB = 32
PICTURED, STALLED = 2, 10
STALLED_LOOK_S = 1.0  # between two looks whether one was parted with
PAUSE_S = 0.1  # between two pictures of a viewer: with fifty, more than a processor can send


class Crowd:
    """The tap's clients, each in a thread of its own."""

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


def of_tap(warm_up_s: float, seconds: float, clients: int, allow_mib: float) -> dict[str, bool]:
    """Runs it, prints what came of it, and returns which faults hold."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        take, line = stack.enter_context(recording_in_memory()), stack.enter_context(controller())
        tap = folder / "tap.sock"
        settings = (f"camera.source=recording:{take}", f"serial.port={line.port}", f"tap.socket={tap}")
        life_s, frames = warm_up_s + seconds + 300, ("--frames", "100000000")
        started = daemon(*settings, f"rewind.memory_mb={RING_MB}", options=frames, life_s=life_s)
        process = stack.enter_context(started)
        reach(tap).close()
        crowd = Crowd(tap, clients)
        follow(process.pid, warm_up_s)
        first = len(line.markers)
        samples = follow(process.pid, seconds)
        lives, parted = process.poll() is None, crowd.parted_readers
        crowd.close()
        counters, latency_ms = line.receiver.counters, latencies_ms(line.markers[first:], take)
    p50, p99 = np.percentile(latency_ms, (50, 99))
    print(
        f"{clients} clients, {STALLED} of them stalled ({crowd.parted_stalled} were parted with), {seconds / 60:g} "
        f"minutes: {crowd.lines} lines and {crowd.pictures} pictures were read; {counters.good} packets, "
        f"{counters.lost} lost, {sum(counters.bad.values())} bad; frame ready → first byte: median {p50:.2f} ms, p99 "
        f"{p99:.2f} ms"
    )
    growth = growth_mib(samples)
    return {
        "the daemon ended": not lives,
        f"memory has grown by {growth:.2f} MiB": growth > allow_mib,
        f"{counters.lost} packets were lost, {sum(counters.bad.values())} were bad": bool(
            counters.lost or counters.bad
        ),
        f"{parted} clients that read were parted with": bool(parted),
        "no client got a picture": not crowd.pictures,
        "no stalled client was parted with": not crowd.parted_stalled and seconds >= 60,
    }


def of_page(warm_up_s: float, seconds: float, clients: int, allow_mib: float) -> dict[str, bool]:
    """Runs it, prints what came of it, and returns which faults hold."""
    unit = (ROOT / "systemd" / "ledpi-view.service").read_text(encoding="utf-8")
    limit_mib = float(re.findall(r"^MemoryMax=(\d+)M$", unit, re.MULTILINE)[0])
    with tempfile.TemporaryDirectory() as name:
        made_up = MadeUpDaemon(Path(name) / "tap.sock", hello=LARGE)
        with view(Path(name)) as page:
            wait_until(lambda: page.ask("/api/state")["link"]["state"] == "up", "the daemon")
            got: list[int] = []
            crowd = threading.Thread(target=lambda: got.extend(watched(page, clients, warm_up_s + seconds, PAUSE_S)))
            crowd.start()
            before, samples = (follow(page.process.pid, each) for each in (warm_up_s, seconds))
            crowd.join()
            ended = page.process.poll() is not None
        made_up.close()
    most_mib, served = max(one.resident for one in before + samples) / MIB, sum(count > 0 for count in got)
    print(
        f"{clients} viewers, {seconds / 60:g} minutes: {sum(got)} pictures to {served} of them; at most "
        f"{most_mib:.1f} MiB of {limit_mib:g}"
    )
    growth = growth_mib(samples)
    return {
        "the page ended": ended,
        f"memory has grown by {growth:.2f} MiB": growth > allow_mib,
        f"it took {most_mib:.0f} MiB of {limit_mib:g}": most_mib > limit_mib,
        f"{served} viewers got pictures": served < min(clients, MOST),
    }


CROWDS = {"tap": (of_tap, 1.0), "page": (of_page, 2.0)}  # and the growth in MiB that is taken for none


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("of", nargs="?", choices=list(CROWDS), help="default: both, one after the other")
    parser.add_argument("--warm-up", type=float, default=5.0, help="minutes before, in which caches and heap fill")
    parser.add_argument("--minutes", type=float, default=10.0)
    parser.add_argument("--clients", type=int, default=50)
    parser.add_argument("--allow-mib", type=float, help="growth that is taken for none; default: tap 1, page 2")
    asked = parser.parse_args()
    faults: dict[str, bool] = {}
    for of in [asked.of] if asked.of else list(CROWDS):
        judge, allow_mib = CROWDS[of]
        faults |= judge(60 * asked.warm_up, 60 * asked.minutes, asked.clients, asked.allow_mib or allow_mib)
    end("crowd", faults)


if __name__ == "__main__":
    main()
