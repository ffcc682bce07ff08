"""Followers, viewers and recordings that come and go leave nothing behind: threads, descriptors, memory."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from ledpi.daemon.tap.client import connect
from tests.builders.daemon import SMALL
from tests.builders.tap import reach
from tests.builders.view import Page, ended, start_daemon, view
from tests.builders.waiting import wait_until

# Of a process, after the first quarter: a recording's queue may take 24 MB, and does where the machine is busy.
GROWTH_MB = 40


@pytest.mark.slow
@pytest.mark.parametrize("times", [60, pytest.param(200, marks=pytest.mark.nightly)])
def test_who_comes_and_goes_leaves_nothing_behind(tmp_path: Path, times: int) -> None:
    """Neither in the daemon nor in the page's server."""
    settings = (*SMALL, "rewind.seconds=0")
    with ended(start_daemon(tmp_path, *settings)) as daemon, view(tmp_path) as page:
        reach(tmp_path / "tap.sock").close()
        wait_until(lambda: page.ask("/api/state")["link"]["state"] != "down")
        for _ in range(times // 4):
            come_and_go(tmp_path, page)
        before = [held(process) for process in (daemon, page.process)]
        for _ in range(times):
            come_and_go(tmp_path, page)
        for process, (descriptors, threads, resident_mb) in zip((daemon, page.process), before, strict=True):
            wait_until(lambda p=process, d=descriptors, t=threads: held(p)[0] <= d + 1 and held(p)[1] <= t + 1)
            assert held(process)[2] < resident_mb + GROWTH_MB


def come_and_go(folder: Path, page: Page) -> None:
    """A page, which sees a picture and asks why; a follower that records, deletes that, and goes within an answer."""
    wait_until(lambda: page.asked("/api/frame?kind=plain"))  # empty until there is a picture
    page.ask("/api/takes")
    with connect(folder / "tap.sock") as follower, connect(folder / "tap.sock") as other:
        recording = follower.send("record", seconds=60)
        wait_until(lambda: any(take["written"] and take["frames"] for take in other.ask("takes")["takes"]))
        recorded = Path(other.ask("record_stop")["path"]).name
        assert any(line.get("id") == recording for line in follower.lines())
        other.ask("take_delete", name=recorded)
        follower.send("picture")


def held(process: subprocess.Popen[str]) -> tuple[int, int, float]:
    """Descriptors, threads, and MB of memory."""
    there = Path(f"/proc/{process.pid}")
    resident_kb = int((there / "status").read_text().split("VmRSS:")[1].split()[0])
    return len([*(there / "fd").iterdir()]), len([*(there / "task").iterdir()]), resident_kb / 1024
