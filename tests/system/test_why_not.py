"""Why a panel is not read, as a person asks a running daemon: `monitor`, `doctor` and `snapshot` say it.

The page: test_view_chromium.py. All faults, and none: tests/unit/pipeline/diagnosis/test_why_not.py.
"""

from __future__ import annotations

import os
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.builders.faults import FAULTS
from tests.builders.view import COMMAND, ended, start_still_daemon
from tests.builders.waiting import limit_s, wait_until

pytestmark = [pytest.mark.slow, pytest.mark.alone]  # a daemon, and three commands beside it
TRIES = 4  # for longer each time: a guess takes some seconds, and not each frame shows a panel as it is


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The place of the tap of a daemon that sees swapped frequencies, as `auto` looks for it: FOLDER/ledpi/tap.sock."""
    folder = tmp_path_factory.mktemp("why") / "ledpi"
    folder.mkdir(mode=0o700)
    with ended(start_still_daemon(folder, "swapped")):
        wait_until(lambda: (folder / "tap.sock").exists(), "the daemon's tap")
        yield folder.parent


@pytest.mark.parametrize(
    ("command", "of_the_daemon"),
    [
        ("monitor --seconds {s}", "frames/s"),
        ("doctor --set panels.side_m=0.16 --set camera.source=simulated", "runs (pid "),
        ("snapshot --set panels.side_m=0.16 --out look.png", "running daemon"),
    ],
)
def test_a_command_says_it_of_the_daemons_frames(folder: Path, command: str, of_the_daemon: str) -> None:
    """Without stopping it."""
    environment = os.environ | {"XDG_RUNTIME_DIR": str(folder)}
    for tried in range(1, TRIES + 1):
        words = [*COMMAND, *command.format(s=4 * tried).split()]
        within = {"cwd": folder / "ledpi", "env": environment, "timeout": limit_s(30)}
        done = subprocess.run(words, capture_output=True, text=True, check=False, **within)  # type: ignore[call-overload]
        said = re.sub(r"\s+", " ", done.stdout)  # lines may be broken where a terminal's would
        if FAULTS["swapped"].says in said:
            break
    assert FAULTS["swapped"].says in said
    assert of_the_daemon in said
    assert "Traceback" not in done.stderr
