"""Memory for what is only kept in case it is asked for: how much there is."""

from __future__ import annotations

import os
from pathlib import Path

SHARE = 8  # of the machine's memory: one part in so many
OWN_BYTES = 305_000_000  # of what a service may take, that its work needs at most, a recording from the tap included

_CGROUPS = Path("/sys/fs/cgroup")


def default_budget_bytes() -> int:
    """An eighth of the machine's memory, as far as this process's service may take it."""
    share = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") // SHARE
    spare = spare_bytes()
    return share if spare is None else min(share, spare)


def spare_bytes() -> int | None:
    """Returns what this process may take beside its work; None where nothing limits it."""
    limit = limit_bytes()
    return None if limit is None else max(0, limit - OWN_BYTES)


def limit_bytes(own: Path = Path("/proc/self/cgroup"), groups: Path = _CGROUPS) -> int | None:
    """Returns what systemd's MemoryMax= allows this process's cgroup and those that it is in; None where nothing does.

    Only of cgroups' second version, the one that systemd limits memory by; `own`: as /proc/self/cgroup.
    """
    try:
        line = next(line for line in own.read_text(encoding="utf-8").splitlines() if line.startswith("0::/"))
    except (OSError, StopIteration):
        return None
    place = groups / line.removeprefix("0::/")
    limits = []
    for group in (place, *place.parents):
        if not group.is_relative_to(groups):
            break
        try:
            limits.append(int((group / "memory.max").read_text(encoding="ascii")))
        except (OSError, ValueError):  # `max`: no limit; the root has none to read
            continue
    return min(limits, default=None)
