"""The live page's unit, as systemd reads it."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from tests.builders.systemd import Unit, needs_systemd

UNIT = Unit("ledpi-view.service")


@pytest.fixture
def unit(tmp_path: Path) -> Path:
    return UNIT.copy_to(tmp_path)


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
    assert (UNIT.values("DynamicUser"), UNIT.values("User"), UNIT.values("Group")) == (
        ["yes"],
        ["ledpi-view"],
        ["ledpi"],
    )
    assert UNIT.values("NoNewPrivileges") == ["yes"]
    assert UNIT.values("CapabilityBoundingSet") == [""]
    assert int(*UNIT.values("Nice")) > 0
    assert UNIT.values("CPUSchedulingPolicy") == ["batch"]


def test_a_mistake_of_the_owner_is_not_tried_again() -> None:
    """Exit status 2 waits for a person."""
    assert (UNIT.values("Restart"), UNIT.values("RestartPreventExitStatus")) == (["on-failure"], ["2"])
