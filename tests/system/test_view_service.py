"""The live page's unit, as systemd reads it."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.builders import ROOT

UNIT = ROOT / "systemd" / "ledpi-view.service"
needs_systemd = pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")


def values(key: str) -> list[str]:
    return re.findall(rf"^{re.escape(key)}=(.*)$", UNIT.read_text(encoding="utf-8"), re.MULTILINE)


@pytest.fixture
def unit(tmp_path: Path) -> Path:
    """The unit with a command that exists here in the place of the installed one."""
    text = UNIT.read_text(encoding="utf-8")
    assert text.count("/usr/local/bin/ledpi ") == 1
    copy = tmp_path / UNIT.name
    copy.write_text(text.replace("/usr/local/bin/ledpi ", f"{shutil.which('true')} "), encoding="utf-8")
    return copy


@needs_systemd
def test_the_unit_is_clean(unit: Path) -> None:
    """systemd has nothing to say about it."""
    command = ["systemd-analyze", "verify", "--man=no", str(unit)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@needs_systemd
def test_the_service_is_closed_in(unit: Path) -> None:
    """systemd's own measure of what a service could do, from 0 to 10, is at most 2.5."""
    command = ["systemd-analyze", "security", "--offline=true", "--no-pager", "--threshold=25", str(unit)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-200:] + done.stderr


def test_it_is_neither_root_nor_the_daemon_and_never_in_its_way() -> None:
    """A user of its own, in the group that may read the tap; it runs when nothing else wants to."""
    assert (values("DynamicUser"), values("User"), values("Group")) == (["yes"], ["ledpi-view"], ["ledpi"])
    assert values("NoNewPrivileges") == ["yes"]
    assert values("CapabilityBoundingSet") == [""]
    assert int(*values("Nice")) > 0
    assert values("CPUSchedulingPolicy") == ["batch"]


def test_a_mistake_of_the_owner_is_not_tried_again() -> None:
    """Exit status 2 waits for a person."""
    assert (values("Restart"), values("RestartPreventExitStatus")) == (["on-failure"], ["2"])
