"""The cost to the running daemon of three bridges whose targets are in trouble: packets, and their latency.

One daemon on a recording of 59 frames a second, paced as its sensor, in turns without bridges and with three: to a
server that vanishes and comes back, to a broker that takes nothing, to a server that sends garbage. Daemon and bridges
are scheduled as their units say, where this machine permits it. Each turn's 99th percentile of frame ready → first byte
is compared with that of the turn before, and those of all turns together. Exit status 1 where the median of the turns'
ratios is more than --allow, or where with bridges fewer packets came.

    python -m evaluation.speed bridges [--turns 4] [--seconds 12] [--allow 1.15]
"""

from __future__ import annotations

import argparse
import os
import statistics
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import numpy as np

from evaluation.running import end
from evaluation.speed.latency import WARM_UP, latencies_ms, recording_in_memory
from evaluation.speed.viewers import scheduled
from ledpi.core.records import Floats
from tests.builders.bridges import MOSQUITTO, Far, Mqtt, Tcp, bridge
from tests.builders.daemon import COMMAND, LIFE_S, Controller, controller, daemon
from tests.builders.waiting import wait_until

AS_UNIT = ["nice", "-n", "5"]  # ledpi-bridge@.service
SETTLE_S = 1.0  # after bridges have come or gone
AWAY_S = 2.0  # that a target is there, and that it is gone
GARBAGE_S = 0.02  # from one kilobyte to the next
LOST_SHARE = 0.01  # of packets, that one turn may have fewer than another by chance


@contextmanager
def repeated(work: Callable[[], None], every_s: float) -> Iterator[None]:
    """Does it in a thread, until the block is left."""
    ending = threading.Event()

    def loop() -> None:
        while not ending.wait(every_s):
            work()

    thread = threading.Thread(target=loop, daemon=True)
    thread.start()
    try:
        yield
    finally:
        ending.set()
        thread.join()


class Vanishing(Tcp):
    """A server that is there, and then is not."""

    def toggle(self) -> None:
        self.vanish() if self._alive else self.start()


@contextmanager
def in_trouble(folder: Path, before: list[str]) -> Iterator[None]:
    """Three bridges. `before`: what they are started with."""
    kinds: tuple[type[Far], ...] = (Vanishing, Tcp, Mqtt if MOSQUITTO is not None else Tcp)
    with ExitStack() as stack:
        ends: list[Far] = []
        for number, kind in enumerate(kinds):
            own = folder / str(number)
            own.mkdir(exist_ok=True)
            ends.append(far := kind(own))
            far.start()
            stack.callback(far.close)
            stack.enter_context(bridge(far.settings, folder / "tap.sock", own, before=before))
        wait_until(lambda: all(len(far.frames) > 5 for far in ends))
        vanishing, noisy, blocking = ends
        assert isinstance(vanishing, Vanishing)
        blocking.block()
        stack.callback(blocking.unblock)
        stack.enter_context(repeated(vanishing.toggle, AWAY_S))
        stack.enter_context(repeated(noisy.send_garbage, GARBAGE_S))
        yield


def phase(line: Controller, take: Path, seconds: float) -> Floats:
    """Latencies (ms) of the packets of so long, after those of the change."""
    time.sleep(SETTLE_S)
    first = len(line.markers)
    time.sleep(seconds)
    return latencies_ms(line.markers[first:], take)


def measured(turns: int, seconds: float) -> list[tuple[Floats, Floats]]:
    """Returns each turn's latencies, without and with bridges."""
    of_daemon, _ = scheduled()
    taken: list[tuple[Floats, Floats]] = []
    with tempfile.TemporaryDirectory() as name, recording_in_memory() as take, controller() as line:
        folder = Path(name)
        settings = (f"camera.source=recording:{take}", f"serial.port={line.port}", f"tap.socket={folder}/tap.sock")
        life_s = (turns + 1) * (LIFE_S + 2 * seconds)
        options, command = ("--frames", "1000000"), [*of_daemon, *COMMAND]
        with daemon(*settings, options=options, command=command, life_s=life_s):
            line.wait_for(lambda c: len(c.markers) > WARM_UP)
            for number in range(turns):
                without = phase(line, take, seconds)
                with in_trouble(folder, AS_UNIT if of_daemon else []):
                    beside = phase(line, take, seconds)
                taken.append((without, beside))
                print(f"turn {number + 1}: {told(without, beside)}", flush=True)
    return taken


def told(without: Floats, beside: Floats) -> str:
    """Both, and their ratio."""
    (p50, p99), (p50_beside, p99_beside) = (np.percentile(each, (50, 99)) for each in (without, beside))
    return (
        f"{len(without)} packets without bridges, {len(beside)} with; median {p50:.2f} → {p50_beside:.2f} ms, "
        f"p99 {p99:.2f} → {p99_beside:.2f} ms = {p99_beside / p99:.3f}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--turns", type=int, default=4)
    parser.add_argument("--seconds", type=float, default=12.0, help="of each turn, with and without")
    parser.add_argument("--allow", type=float, default=1.15)
    arguments = parser.parse_args()
    print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f} before")
    taken = measured(arguments.turns, arguments.seconds)
    without, beside = (np.concatenate(each) for each in zip(*taken, strict=True))
    ratio = statistics.median(float(np.percentile(b, 99) / np.percentile(a, 99)) for a, b in taken)
    print(f"together: {told(without, beside)}; median of the turns' ratios {ratio:.3f} (allowed {arguments.allow:g})")
    fewer = len(beside) < (1 - LOST_SHARE) * len(without)
    faults = {
        f"p99 is {ratio:.3f} times that without": ratio > arguments.allow,
        f"{len(beside)} packets came with bridges, {len(without)} without": fewer,
    }
    end("bridges", faults)


if __name__ == "__main__":
    main()
