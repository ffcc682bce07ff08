"""Processor time of the state for a second of 60 frames, 100 messages of odometry and 50 of the state.

Pictures are late. Instructions are counted by valgrind's callgrind, so what else the machine does changes nothing.

    python -m evaluation.drives.cost [--many 1000000]      # also: so many messages, and the memory that they leave
"""

from __future__ import annotations

import argparse
import os
import resource
import sys
import time

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from evaluation.drives.cases import ODOMETRY_LATE_NS, PICTURE_LATE_NS, Case, drive_of, estimator_of
from evaluation.speed import counting
from ledpi.state.estimator import Estimator
from ledpi.state.inputs import Look, Odometry

WARM_UP_S, COUNTED_S = 4, 4
FRAMES_HZ, REPORTED_NS = 60.0, 20_000_000


def arrivals(seconds: float) -> list[tuple[int, list[Look] | Odometry]]:
    """Inputs of a controller and a camera of 60 Hz, as they arrive."""
    drive = drive_of(Case(name="cost", seconds=seconds), 3, FRAMES_HZ)
    frames = [(frame[0].t_ns + PICTURE_LATE_NS, frame) for _, frame in drive.frames if frame]
    return sorted([*frames, *((o.t_ns + ODOMETRY_LATE_NS, o) for o in drive.odometry)], key=lambda each: each[0])


def add(estimator: Estimator, what: list[Look] | Odometry, now_ns: int) -> None:
    if isinstance(what, Odometry):
        estimator.add_odometry(what, now_ns)
    else:
        estimator.add_looks(what, now_ns)


def counted() -> float:
    """Runs what is counted; returns the milliseconds of a second."""
    inputs = arrivals(WARM_UP_S + COUNTED_S)
    estimator = estimator_of(Case(name="cost"), drive_of(Case(name="cost", seconds=1), 3))
    begun, due_ns = 0.0, 0
    for now_ns, what in inputs:
        if now_ns >= WARM_UP_S * 1e9 and not begun:
            counting.mark()
            begun = time.process_time()
        add(estimator, what, now_ns)
        if now_ns >= due_ns:
            due_ns = now_ns + REPORTED_NS
            estimator.at(now_ns)
    counting.mark()
    return (time.process_time() - begun) * 1e3 / COUNTED_S


def many(messages: int) -> None:
    """Repeats a drive, later each time, and tells the memory after a tenth and after all."""
    inputs = arrivals(10)
    estimator = estimator_of(Case(name="cost"), drive_of(Case(name="cost", seconds=1), 3))
    from dataclasses import replace

    for number in range(messages):
        turn, k = divmod(number, len(inputs))
        later = turn * 10_000_000_000
        now_ns, what = inputs[k]
        if isinstance(what, Odometry):
            moved = replace(what, t_ns=what.t_ns + later, restarted=k < 2)
        else:
            moved = [replace(look, t_ns=look.t_ns + later) for look in what]
        add(estimator, moved, now_ns + later)
        if number in (messages // 10, messages - 1):
            print(f"{number + 1} messages: {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.1f} MiB at most")


def main() -> int:
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--many", type=int, default=0)
    parser.add_argument("--counted", action="store_true", help=argparse.SUPPRESS)
    asked = parser.parse_args()
    if asked.counted:
        counted()
        return 0
    if asked.many:
        many(asked.many)
        return 0
    print(f"{min(counted() for _ in range(5)):.1f} ms of a second on this machine")
    (count,) = counting.on_x86_64(["-m", "evaluation.drives.cost", "--counted"])
    print(f"{count / COUNTED_S / 1e6:.1f} million instructions a second")
    return 0


if __name__ == "__main__":
    sys.exit(main())
