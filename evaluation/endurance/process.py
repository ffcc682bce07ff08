"""A process as /proc shows it, and whether its memory grows."""

from __future__ import annotations

import re
import statistics
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

MIB = 2**20
TOLD_EACH = 60  # samples, between two lines that are printed on the way


@dataclass(frozen=True, slots=True)
class Sample:
    """The process at one moment. Memory in bytes."""

    own: int  # RssAnon: of the files that it has mapped the kernel keeps more or less as it likes
    resident: int  # VmRSS
    threads: int
    descriptors: int


def sample(pid: int) -> Sample | None:
    """None where the process has ended, or is about to."""
    place = Path(f"/proc/{pid}")
    try:
        memory = dict(re.findall(r"(RssAnon|VmRSS):\s+(\d+) kB", (place / "status").read_text(encoding="ascii")))
        threads = len(list((place / "task").iterdir()))
        descriptors = len(list((place / "fd").iterdir()))
    except OSError:
        return None
    if len(memory) < 2:
        return None
    return Sample(1024 * int(memory["RssAnon"]), 1024 * int(memory["VmRSS"]), threads, descriptors)


def follow(pid: int, seconds: float) -> list[Sample]:
    """The process each second, for so long or until it ends, with a line each minute."""
    samples: list[Sample] = []
    end_s = time.monotonic() + seconds
    while time.monotonic() < end_s and (now := sample(pid)) is not None:
        samples.append(now)
        if len(samples) % TOLD_EACH == 0:
            print(f"{now.own / MIB:.2f} MiB, {now.descriptors} descriptors", flush=True)
        time.sleep(1.0)
    return samples


def growth_mib(samples: Sequence[Sample]) -> float:
    """The median of the last quarter beyond that of the first, as it goes up and down within a frame; printed."""
    quarter, first, last = max(1, len(samples) // 4), samples[0], samples[-1]
    before, after = (statistics.median(s.own for s in part) / MIB for part in (samples[:quarter], samples[-quarter:]))
    print(
        f"memory {before:.2f} MiB in the first quarter, {after:.2f} MiB in the last: growth {after - before:+.2f} MiB; "
        f"threads {first.threads} → {last.threads}, descriptors {first.descriptors} → {last.descriptors}"
    )
    return after - before
