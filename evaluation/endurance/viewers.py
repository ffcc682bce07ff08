"""Fifty viewers of the live page for half an hour: its memory stays flat, and within what its unit allows.

A daemon that is made up shows pictures of 640 × 480. Each viewer asks for one kind of picture, one after the other; two
are more than there are places. The memory of the page's process (VmRSS) is looked at each second: after the warm-up the
medians of the first and of the last quarter may differ by --allow-mib. Exit status 1 where they do, where the page took
more than MemoryMax of ledpi-view.service, where it ended, or where a viewer that has a place got no picture.

    python -m evaluation.endurance viewers [--warm-up 2] [--minutes 30] [--viewers 50] [--allow-mib 2]
"""

from __future__ import annotations

import argparse
import re
import statistics
import sys
import tempfile
import threading
import time
from pathlib import Path

from evaluation import ROOT
from ledpi.view.connections import MOST
from tests.builders.made_up_daemon import LARGE, MadeUpDaemon
from tests.builders.view import view, watched
from tests.builders.waiting import wait_until

PAUSE_S = 0.1  # between two pictures of a viewer: with fifty, more than a processor can send
TOLD_S = 60.0  # between two lines that are printed on the way


def unit_limit_mb() -> float:
    """MemoryMax of the page's unit."""
    unit = (ROOT / "systemd" / "ledpi-view.service").read_text(encoding="utf-8")
    found = re.search(r"^MemoryMax=(\d+)M$", unit, re.MULTILINE)
    assert found is not None
    return float(found[1])


def judge(warm_up: float, minutes: float, viewers: int, allow_mib: float) -> list[str]:
    """Runs it, prints what came of it, and returns what is wrong with that."""
    with tempfile.TemporaryDirectory() as name:
        daemon = MadeUpDaemon(Path(name) / "tap.sock", hello=LARGE)
        with view(Path(name)) as page:
            wait_until(lambda: page.ask("/api/state")["link"]["state"] == "up", "the daemon")
            got: list[int] = []
            seconds = 60 * (warm_up + minutes)
            crowd = threading.Thread(target=lambda: got.extend(watched(page, viewers, seconds, PAUSE_S)))
            crowd.start()
            start_s, taken = time.monotonic(), []
            while crowd.is_alive() and page.process.poll() is None:
                taken.append((time.monotonic() - start_s, page.resident_mb))
                if len(taken) % TOLD_S == 0:
                    print(f"{taken[-1][1]:.1f} MiB", flush=True)
                time.sleep(1.0)
            crowd.join()
            ended = page.process.poll() is not None
        daemon.close()
    after = [mb for at_s, mb in taken if at_s >= 60 * warm_up]
    quarter = max(1, len(after) // 4)
    first, last = statistics.median(after[:quarter]), statistics.median(after[-quarter:])
    most, limit, served = max(mb for _, mb in taken), unit_limit_mb(), sum(count > 0 for count in got)
    print(
        f"{viewers} viewers, {minutes:g} minutes: {sum(got)} pictures to {served} of them; memory {first:.1f} MiB in "
        f"the first quarter, {last:.1f} MiB in the last: growth {last - first:+.1f} MiB; at most {most:.1f} MiB of "
        f"{limit:g}"
    )
    faults = {
        "the page ended": ended,
        f"memory has grown by {last - first:.1f} MiB": last - first > allow_mib,
        f"it took {most:.0f} MiB of {limit:g}": most > limit,
        f"{served} viewers got pictures": served < min(viewers, MOST),
    }
    return [fault for fault, holds in faults.items() if holds]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--warm-up", type=float, default=2.0, help="minutes before")
    parser.add_argument("--minutes", type=float, default=30.0)
    parser.add_argument("--viewers", type=int, default=50)
    parser.add_argument("--allow-mib", type=float, default=2.0, help="growth that is taken for none")
    arguments = parser.parse_args()
    faults = judge(arguments.warm_up, arguments.minutes, arguments.viewers, arguments.allow_mib)
    for fault in faults:
        print(f"viewers: {fault}", file=sys.stderr)
    sys.exit(1 if faults else 0)


if __name__ == "__main__":
    main()
