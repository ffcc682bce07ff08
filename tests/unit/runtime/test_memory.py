"""Memory for the last seconds: the machine's, and what the service may take of it."""

from __future__ import annotations

from pathlib import Path

import pytest

from ledpi.runtime import memory
from ledpi.runtime.memory import OWN_BYTES, default_budget_bytes, limit_bytes


@pytest.fixture
def own(tmp_path: Path) -> Path:
    """A service's cgroup, as /proc/self/cgroup and /sys/fs/cgroup show it; limited by nothing."""
    group = tmp_path / "groups" / "system.slice" / "ledpi.service"
    group.mkdir(parents=True)
    (group / "memory.max").write_text("max\n")
    (group.parent / "memory.max").write_text("max\n")
    (tmp_path / "own").write_text("0::/system.slice/ledpi.service\n")
    return tmp_path / "own"


def limit(own: Path) -> int | None:
    return limit_bytes(own, own.parent / "groups")


def test_nothing_limits_a_service_without_a_limit(own: Path) -> None:
    """`max` is none."""
    assert limit(own) is None


def test_the_service_s_own_limit_counts(own: Path) -> None:
    """MemoryMax=510M, as the kernel has it."""
    (own.parent / "groups/system.slice/ledpi.service/memory.max").write_text(f"{510 << 20}\n")
    assert limit(own) == 510 << 20


def test_so_does_that_of_what_it_is_in(own: Path) -> None:
    """The smallest of them holds."""
    (own.parent / "groups/system.slice/ledpi.service/memory.max").write_text("900000000\n")
    (own.parent / "groups/system.slice/memory.max").write_text("600000000\n")
    assert limit(own) == 600_000_000


def test_other_systems_have_no_limit_that_is_known(tmp_path: Path) -> None:
    """Without /proc, or with cgroups of the first version."""
    assert limit_bytes(tmp_path / "nothing", tmp_path) is None
    (tmp_path / "own").write_text("9:memory:/here\n")
    assert limit_bytes(tmp_path / "own", tmp_path) is None


def test_the_budget_is_an_eighth_and_never_what_the_work_needs(monkeypatch: pytest.MonkeyPatch) -> None:
    """Takes an eighth of the machine's; what a limit leaves beside the daemon's own work; nothing where that is nil."""
    monkeypatch.setattr(memory, "limit_bytes", lambda: None)
    eighth = default_budget_bytes()
    total_kb = int(Path("/proc/meminfo").read_text().split()[1])
    assert eighth == pytest.approx(total_kb * 1024 / 8, rel=0.01)
    monkeypatch.setattr(memory, "limit_bytes", lambda: OWN_BYTES + 5_000_000)
    assert default_budget_bytes() == min(eighth, 5_000_000)
    monkeypatch.setattr(memory, "limit_bytes", lambda: 100_000_000)
    assert default_budget_bytes() == 0
