"""An hour of the daemon and a bridge of every kind: does the memory of any of them grow?

`ledpi run` on the simulated camera, and of each kind that has a connection two bridges: one whose far end is well, and
one whose far end, in the second third of the time, vanishes for a minute, is well for two, takes nothing for a minute,
is well for two, and so on. All far ends are real (mosquitto with TLS and a password, ntcore, a Zenoh router with a
participant). A process's own memory (RssAnon) and its resident memory are written each 10 s, as lines of JSON. Told at
the end: its own at four moments after the warm-up, and its slope over the last third, when all has been well for long.
Exit status 1 where that is more than --allow-kib an hour, or a process has ended.

    python -m evaluation.endurance bridge_memory [--minutes 60] [--keep memory.jsonl]
"""

from __future__ import annotations

import argparse
import json
import subprocess
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from evaluation import table
from evaluation.endurance.process import sample
from evaluation.running import end
from tests.builders.bridges import Far, Nt, Secure, Tcp, Udp, Zenoh, bridge, secrets
from tests.builders.daemon import SIMULATED, daemon
from tests.builders.waiting import wait_until

EACH_S = 10.0
WARM_UP_SHARE = 0.05  # three minutes of an hour
TROUBLE_SHARE = (1 / 3, 2 / 3)  # of the time
CYCLE_S = 60.0
CYCLE = ("vanish", "well", "well", "block", "well", "well")


class Broker(Secure):
    """One that keeps nothing of what its subscriber hears."""

    def _hear(self, message: Any) -> None:
        if message.topic == "ledpi/frame":
            self.take(message.payload)


KINDS: tuple[type[Far], ...] = (Broker, Nt, Zenoh, Tcp, Udp)


class Troubled:
    """A far end, by turns well, gone and deaf."""

    def __init__(self, far: Far) -> None:
        self.far, self._is = far, "well"

    def be(self, what: str) -> None:
        if what == self._is:
            return
        if self._is == "vanish":
            self.far.start()
        elif self._is == "block":
            self.far.unblock()
        if what == "vanish":
            self.far.vanish()
        elif what == "block":
            self.far.block()
        self._is = what


def memory_kib(pid: int) -> dict[str, int]:
    """Resident memory, and of it what is not of a file."""
    now = sample(pid)
    return {} if now is None else {"VmRSS": now.resident // 1024, "RssAnon": now.own // 1024}


def far_end(kind: type[Far], folder: Path) -> Far:
    """A new one, in a folder of its own."""
    folder.mkdir()
    if issubclass(kind, Secure):
        secrets(folder)
    far = kind(folder)
    far.start()
    return far


def started(stack: ExitStack, folder: Path) -> tuple[dict[str, int], list[Troubled]]:
    """Starts the daemon and all bridges. Returns the numbers of their processes, and the far ends to trouble."""
    settings = (*SIMULATED, "serial.port=null", f"tap.socket={folder}/tap.sock")
    run = stack.enter_context(daemon(*settings, life_s=1e6))
    assert run.stderr is not None
    stack.callback(subprocess.Popen(["cat"], stdin=run.stderr, stdout=subprocess.DEVNULL).kill)
    pids, troubled = {"daemon": run.pid}, []
    for kind in KINDS:
        for state in ("well", "troubled"):
            far = far_end(kind, own := folder / f"{kind.kind}-{state}")
            stack.callback(far.close)
            one = stack.enter_context(bridge(far.settings, folder / "tap.sock", own))
            pids[own.name] = one.process.pid
            wait_until(lambda one=one: "target_open" in one.log)  # type: ignore[misc]
            if state == "troubled":
                troubled.append(Troubled(far))
    return pids, troubled


def state_at(share: float, seconds: float) -> str:
    """Returns what the troubled far ends are, so far into the time."""
    begins, ends = TROUBLE_SHARE
    if not begins <= share < ends:
        return "well"
    return CYCLE[int((share - begins) * seconds / CYCLE_S) % len(CYCLE)]


def sampled(seconds: float, keep: Path) -> list[dict[str, Any]]:
    """Runs all of it. Returns what was written to `keep`."""
    samples: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as name, ExitStack() as stack, keep.open("w", encoding="utf-8") as out:
        pids, troubled = started(stack, Path(name))
        began_s = time.monotonic()
        while (at_s := time.monotonic() - began_s) <= seconds:
            for one in troubled:
                one.be(state_at(at_s / seconds, seconds))
                one.far.frames.clear()
            samples.append({"at_s": round(at_s, 1), **{name: memory_kib(pid) for name, pid in pids.items()}})
            out.write(json.dumps(samples[-1]) + "\n")
            out.flush()
            time.sleep(EACH_S)
        for one in troubled:
            one.be("well")
    return samples


def slope_kib_per_h(samples: list[dict[str, Any]], name: str) -> float:
    """The slope of a straight line through its own memory."""
    at_h = [sample["at_s"] / 3600 for sample in samples]
    return float(np.polyfit(at_h, [sample[name]["RssAnon"] for sample in samples], 1)[0])


def told(samples: list[dict[str, Any]]) -> tuple[str, dict[str, float]]:
    """A table, and each process's slope over the last third (KiB/h)."""
    seconds = samples[-1]["at_s"]
    shares = (WARM_UP_SHARE, 0.25, 0.5, 0.75, 1.0)
    at = [next(sample for sample in samples if sample["at_s"] >= share * seconds) for share in shares]
    last = [sample for sample in samples if sample["at_s"] >= TROUBLE_SHARE[1] * seconds]
    names = [name for name in samples[0] if name != "at_s"]
    slopes = {name: slope_kib_per_h(last, name) for name in names}
    warm = [sample for sample in samples if sample["at_s"] >= WARM_UP_SHARE * seconds]
    head = ["KiB", *(f"{sample['at_s'] / 60:.0f} min" for sample in at), "KiB/h, all", "KiB/h, last third"]
    lines = []
    for name in names:
        slopes_told = (f"{slope_kib_per_h(warm, name):+.0f}", f"{slopes[name]:+.0f}")
        lines.append([name, *(str(sample[name]["RssAnon"]) for sample in at), *slopes_told])
    return table(head, lines), slopes


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--keep", type=Path, default=Path("memory.jsonl"))
    parser.add_argument("--allow-kib", type=float, default=1024.0)
    asked = parser.parse_args()
    lines, slopes = told(sampled(60 * asked.minutes, asked.keep))
    print(lines)
    end(
        "bridge_memory",
        {f"{name} grows by {slope:.0f} KiB an hour": slope > asked.allow_kib for name, slope in slopes.items()},
    )


if __name__ == "__main__":
    main()
