"""Why a panel is not read, as a person asks a running daemon: the page, `monitor`, `doctor` and `snapshot` say it."""

from __future__ import annotations

import os
import re
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.builders.faults import FAULTS, RIGHT, Fault
from tests.builders.view import COMMAND, ended, start_still_daemon, view
from tests.builders.waiting import limit_s, wait_until

pytestmark = [pytest.mark.slow, pytest.mark.alone]  # a daemon, and three commands beside it
TRIES = 4  # of `monitor`, for longer each time: on a busy machine a guess takes some seconds


@pytest.fixture(scope="module", params=["swapped", "nothing"])
def fault(request: pytest.FixtureRequest) -> Fault:
    """One, and none; all of them: tests/unit/pipeline/diagnosis/test_why_not.py."""
    return FAULTS.get(request.param, RIGHT)


@pytest.fixture(scope="module")
def folder(fault: Fault, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The place of the tap of a daemon that sees it, as `auto` looks for it: FOLDER/ledpi/tap.sock."""
    folder = tmp_path_factory.mktemp("why") / "ledpi"
    folder.mkdir(mode=0o700)
    name = next((name for name, one in FAULTS.items() if one is fault), "nothing")
    with ended(start_still_daemon(folder, name)):
        wait_until(lambda: (folder / "tap.sock").exists(), "the daemon's tap")
        yield folder.parent


def ledpi(folder: Path, *arguments: str) -> str:
    """Returns what a command says; its lines may be broken where a terminal's would."""
    environment = os.environ | {"XDG_RUNTIME_DIR": str(folder)}
    command = [*COMMAND, *arguments]
    done = subprocess.run(
        command, cwd=folder / "ledpi", env=environment, capture_output=True, text=True, check=False, timeout=limit_s(30)
    )
    assert "Traceback" not in done.stderr
    return re.sub(r"\s+", " ", done.stdout)


def is_told(said: str, fault: Fault) -> bool:
    """Its words; of nothing wrong, that no panel is told to be not read."""
    return fault.says in said if fault.says else "is not read" not in said and "if it is a panel" not in said


def test_the_page_says_it(fault: Fault, folder: Path) -> None:
    """In the view `why not`."""
    with view(folder / "ledpi") as page:
        end_s, told = time.monotonic() + limit_s(), []
        while time.monotonic() < end_s:
            told = [one["says"] for one in page.frame("whynot")["why_not"] if one["kind"] != "shape"]
            if not fault.says or any(fault.says in says for says in told):
                break
        assert any(fault.says in says for says in told) if fault.says else told == []


def asked_again(fault: Fault, folder: Path, *command: str) -> str:
    """Returns what a command says in the first try that tells what is wrong: not each frame shows a panel as it is."""
    said = ""
    for _ in range(TRIES):
        said = ledpi(folder, *command)
        if is_told(said, fault):
            return said
    raise AssertionError(said)


def test_monitor_says_it(fault: Fault, folder: Path) -> None:
    """Below its table."""
    said = ""
    for tried in range(1, TRIES + 1):
        said = ledpi(folder, "monitor", "--seconds", str(4 * tried))
        if is_told(said, fault):
            break
    assert is_told(said, fault), said


def test_doctor_says_it(fault: Fault, folder: Path) -> None:
    """Asks the daemon that has the camera, without stopping it."""
    said = asked_again(fault, folder, "doctor", "--set", "panels.side_m=0.16", "--set", "camera.source=simulated")
    assert "runs (pid " in said


def test_snapshot_says_it(fault: Fault, folder: Path) -> None:
    """Takes the daemon's frame."""
    said = asked_again(fault, folder, "snapshot", "--set", "panels.side_m=0.16", "--out", "look.png")
    assert "running daemon" in said
    assert (folder / "ledpi/look.png").exists()
