"""The bridges' unit, as systemd reads it."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from tests.builders import ROOT
from tests.builders.systemd import Unit, assert_closed_in, needs_systemd, said_of

UNIT = Unit("ledpi-bridge@.service")


@pytest.fixture
def unit(tmp_path: Path) -> Path:
    """The unit of the output `field`."""
    return UNIT.copy_to(tmp_path).rename(tmp_path / "ledpi-bridge@field.service")


@needs_systemd
def test_the_unit_is_clean(unit: Path) -> None:
    """systemd has nothing to say about it."""
    assert said_of(unit) == ""


@needs_systemd
def test_the_service_is_closed_in(unit: Path) -> None:
    """Leaves it little that it could do, by systemd's own measure."""
    assert_closed_in(unit)


@needs_systemd
def test_the_pages_lines_make_one_of_another_camera(unit: Path) -> None:
    """Clean, too; the last ExecStart counts."""
    (lines,) = re.findall(r"```ini\n(.*?)```", (ROOT / "docs/outputs.md").read_text(encoding="utf-8"), re.DOTALL)
    folder = unit.with_name(f"{unit.name}.d")
    folder.mkdir()
    (folder / "override.conf").write_text(lines.replace("/usr/local/bin/ledpi ", "/bin/true "), encoding="utf-8")
    assert said_of(unit) == ""
    assert "--config /etc/ledpi/front.yaml" in lines


def test_it_may_read_the_tap_and_is_never_in_the_daemons_way() -> None:
    """As a member of the group; an error of the owner's is not tried again."""
    assert (UNIT.values("DynamicUser"), UNIT.values("Group")) == (["yes"], ["ledpi"])
    assert int(*UNIT.values("Nice")) > 0
    assert (UNIT.values("Restart"), UNIT.values("RestartPreventExitStatus")) == (["on-failure"], ["2"])
