"""The live page's unit, as systemd reads it."""

from __future__ import annotations

from pathlib import Path

import pytest

from tests.builders.systemd import Unit, assert_closed_in, needs_systemd, said_of

UNIT = Unit("ledpi-view.service")


@pytest.fixture
def unit(tmp_path: Path) -> Path:
    return UNIT.copy_to(tmp_path)


@needs_systemd
def test_the_unit_is_clean(unit: Path) -> None:
    """systemd has nothing to say about it."""
    assert said_of(unit) == ""


@needs_systemd
def test_the_service_is_closed_in(unit: Path) -> None:
    """Leaves it little that it could do, by systemd's own measure."""
    assert_closed_in(unit)


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
