"""The cost of two viewers and of the last seconds to the running daemon: latency and memory; the page's age.

One daemon after the other on a recording, paced as its sensor, in turns: without followers and `rewind.seconds: 0`; and
with its ring of the last seconds and `ledpi view`, of which two pages ask for pictures and state as a browser does.
Daemon and page are scheduled as their units say, where this machine permits it. Of all turns together the 99th
percentile of frame ready → first byte is compared; and of the last turn the memory of its own (RssAnon), which may grow
by the ring's budget and 10 MB. Then headless Chromium opens the page and says how old its pictures are, from the middle
of the exposure until they are drawn. Exit status 1 where one of the figures is more than --allow, 10 MB or 250 ms.

    python -m evaluation.speed.viewers [--turns 6] [--seconds 20] [--allow 1.15]
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from evaluation import end
from evaluation.endurance.process import sample
from evaluation.speed.latency import WARM_UP, latencies_ms, recording_in_memory
from ledpi.core.records import Floats
from tests.builders.daemon import COMMAND, LIFE_S, controller, daemon
from tests.builders.view import CHROMIUM, DRIVER, Page, browser, view
from tests.builders.waiting import wait_until

RING_MB, MORE_MB = 64, 10  # of the last seconds, and besides
LATE_MS = 250.0
VIEWERS = 2
STATE_PAUSE_S = 0.2  # as the page's own
AGE_EVERY_S = 0.1  # that the browser is asked
AS_UNIT = (["chrt", "-f", "10"], ["chrt", "-b", "0", "nice", "-n", "10"])  # ledpi.service, ledpi-view.service


@dataclass(frozen=True, slots=True)
class Turn:
    """One daemon."""

    latency_ms: Floats
    memory_mb: float
    pictures: int  # that viewers got


def scheduled() -> tuple[list[str], list[str]]:
    """Returns what daemon and page are started with."""
    try:
        if subprocess.run([*AS_UNIT[0], "true"], check=False, capture_output=True).returncode == 0:
            return AS_UNIT
    except OSError:
        pass
    print("chrt is refused here: daemon and page are not scheduled as their units say")
    return [], []


@contextmanager
def running(
    take: Path, folder: Path, seconds: float, *settings: str, watched: bool
) -> Iterator[tuple[subprocess.Popen[str], Page | None]]:
    """A daemon on the recording, and its page where it is watched, scheduled as their units say."""
    of_daemon, of_page = scheduled()
    fixed, endless = (f"camera.source=recording:{take}", f"tap.socket={folder}/tap.sock"), ("--frames", "1000000")
    started = daemon(*fixed, *settings, options=endless, command=[*of_daemon, *COMMAND], life_s=LIFE_S + seconds)
    with started as process, ExitStack() as stack:
        yield process, stack.enter_context(view(folder, before=of_page)) if watched else None


def turn(take: Path, seconds: float, *, watched: bool) -> Turn:
    """A daemon for so long after its warm-up, and after its ring is full."""
    ring = f"rewind.memory_mb={RING_MB}" if watched else "rewind.seconds=0"
    with (
        tempfile.TemporaryDirectory() as name,
        controller() as line,
        running(take, Path(name), seconds, f"serial.port={line.port}", ring, watched=watched) as (process, page),
    ):
        pages = _Pages(page)
        line.wait_for(lambda c: len(c.markers) > 2 * WARM_UP)
        first, before = len(line.markers), pages.pictures
        time.sleep(seconds)
        pictures, memory = pages.pictures - before, sample(process.pid)
        latency_ms = latencies_ms(line.markers[first:], take)
        pages.close()
    assert memory is not None, "the daemon ended"
    return Turn(latency_ms, memory.own / 1e6, pictures)


class _Pages:
    """Two browsers' questions; none where there is no page."""

    def __init__(self, page: Page | None) -> None:
        self.pictures = 0
        self._ending = threading.Event()
        loops = (self._look, self._ask) * VIEWERS if page else ()
        self._threads = [threading.Thread(target=loop, args=(page,), daemon=True) for loop in loops]
        for thread in self._threads:
            thread.start()

    def close(self) -> None:
        self._ending.set()
        for thread in self._threads:
            thread.join()

    def _look(self, page: Page) -> None:
        number = -1
        while not self._ending.is_set():
            data = page.asked(f"/api/frame?kind=plain&after={number}")
            if data:
                number = json.loads(data[4 : 4 + int.from_bytes(data[:4], "big")])["number"]
                self.pictures += 1

    def _ask(self, page: Page) -> None:
        version = -1
        while not self._ending.is_set():
            version = page.ask(f"/api/state?after={version}")["version"]
            time.sleep(STATE_PAUSE_S)


def cost(turns: int, seconds: float, allow: float) -> dict[str, bool]:
    """Prints latency and memory; returns what may be too much."""
    taken: dict[bool, list[Turn]] = {False: [], True: []}
    with recording_in_memory() as take:
        for number in range(turns):
            for watched in (False, True):
                one = turn(take, seconds, watched=watched)
                taken[watched].append(one)
                p50, p99 = np.percentile(one.latency_ms, [50, 99])
                print(
                    f"turn {number + 1} {'with   ' if watched else 'without'}: {len(one.latency_ms)} packets, median "
                    f"{p50:.2f} ms, p99 {p99:.2f} ms; {one.memory_mb:.1f} MB; {one.pictures / seconds:.0f} pictures/s",
                    flush=True,
                )
    both = {watched: np.concatenate([one.latency_ms for one in of]) for watched, of in taken.items()}
    p50, p99 = ({watched: float(np.percentile(of, q)) for watched, of in both.items()} for q in (50, 99))
    ratio = p99[True] / p99[False]
    growth_mb = taken[True][-1].memory_mb - taken[False][-1].memory_mb
    print(
        f"frame ready → first byte, two viewers and the last seconds, over neither: median {p50[True]:.2f} / "
        f"{p50[False]:.2f} ms, p99 {p99[True]:.2f} / {p99[False]:.2f} ms = {ratio:.3f} (allowed {allow:g})\n"
        f"memory: {growth_mb:.1f} MB more, of which the last seconds may take {RING_MB} (allowed {RING_MB + MORE_MB})"
    )
    return {
        f"p99 is {ratio:.3f} times that without": ratio > allow,
        f"memory has grown by {growth_mb:.1f} MB": growth_mb > RING_MB + MORE_MB,
        "the viewers got no pictures": not all(one.pictures for one in taken[True]),
    }


def ages_ms(seconds: float) -> Floats:
    """Ages of the pictures that Chromium has drawn, by the page's own measure."""
    read = "return ['figure', 'age'].map(id => ({...document.getElementById(id).dataset})).map(d => d.seq || d.ms)"
    ages: dict[str, float] = {}
    with (
        tempfile.TemporaryDirectory() as name,
        recording_in_memory() as take,
        running(take, Path(name), 9 * LIFE_S + seconds, f"serial.port={name}/none", watched=True) as (_, page),
        browser() as chromium,
    ):
        assert page is not None
        chromium.get(page.address)
        wait_until(lambda: chromium.execute_script(read)[1], "a picture")
        time.sleep(5.0)  # until all is loaded, and clocks are compared
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            seq, age_ms = chromium.execute_script(read)
            ages.setdefault(seq, float(age_ms))
            time.sleep(AGE_EVERY_S)
    return np.array(list(ages.values()))


def age(seconds: float) -> dict[str, bool]:
    """Prints how old the page's pictures are; returns what may be too much."""
    if CHROMIUM is None or DRIVER is None:
        print("the page's age: left out, Debian's chromium and chromium-driver are not here")
        return {}
    ages = ages_ms(seconds)
    p50, p95 = np.percentile(ages, [50, 95])
    late = float(np.mean(ages > LATE_MS))
    print(
        f"the page's picture in Chromium on this machine: {len(ages)} looked at, age median {p50:.0f} ms, "
        f"p95 {p95:.0f} ms, largest {ages.max():.0f} ms; {100 * late:.1f} % above {LATE_MS:.0f} ms"
    )
    return {f"the page's pictures are {p95:.0f} ms old (p95)": bool(p95 > LATE_MS)}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--turns", type=int, default=6, help="of each kind")
    parser.add_argument("--seconds", type=float, default=20.0, help="of each turn, and that the page is watched")
    parser.add_argument("--allow", type=float, default=1.15)
    arguments = parser.parse_args()
    print(f"{os.cpu_count()} processors, load {os.getloadavg()[0]:.1f} before")
    end("viewers", cost(arguments.turns, arguments.seconds, arguments.allow) | age(arguments.seconds))


if __name__ == "__main__":
    main()
