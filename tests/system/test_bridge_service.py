"""The bridges' unit, as systemd reads it."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

from tests.builders import ROOT
from tests.builders.systemd import Unit, needs_systemd

UNIT = Unit("ledpi-bridge@.service")


@pytest.fixture
def unit(tmp_path: Path) -> Path:
    """Of the output `field`."""
    return UNIT.copy_to(tmp_path).rename(tmp_path / "ledpi-bridge@field.service")


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


@needs_systemd
def test_the_pages_lines_make_one_of_another_camera(unit: Path) -> None:
    """Clean, too; the last ExecStart counts."""
    (lines,) = re.findall(r"```ini\n(.*?)```", (ROOT / "docs/outputs.md").read_text(encoding="utf-8"), re.DOTALL)
    folder = unit.with_name(f"{unit.name}.d")
    folder.mkdir()
    (folder / "override.conf").write_text(lines.replace("/usr/local/bin/ledpi ", "/bin/true "), encoding="utf-8")
    done = subprocess.run(
        ["systemd-analyze", "verify", "--man=no", str(unit)], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    assert "--config /etc/ledpi/front.yaml" in lines


def test_it_may_read_the_tap_and_is_never_in_the_daemons_way() -> None:
    """As a member of the group; an error of the owner's is not tried again."""
    assert (UNIT.values("DynamicUser"), UNIT.values("Group")) == (["yes"], ["ledpi"])
    assert int(*UNIT.values("Nice")) > 0
    assert (UNIT.values("Restart"), UNIT.values("RestartPreventExitStatus")) == (["on-failure"], ["2"])
