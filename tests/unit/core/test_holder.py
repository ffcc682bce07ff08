"""Which process holds a device, and how to stop it: a real one, with a real lock."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from ledpi.core.linux import locker_in, who_holds
from tests.builders.daemon import holder


@pytest.mark.parametrize("lock", ["fcntl.lockf(f, fcntl.LOCK_EX)", "pass"])
def test_the_holder_and_how_to_stop_it_are_named(tmp_path: Path, lock: str) -> None:
    """A process that has locked the file, as libcamera locks /dev/media*, or that just has it open."""
    device = tmp_path / "media0"
    device.touch()
    with holder(device, lock) as pid:
        said = who_holds(str(tmp_path / "media*"))
    assert said is not None
    assert said.startswith("held by python")
    assert f"(process {pid}); stop it with: sudo " in said


def test_a_free_device_has_no_holder(tmp_path: Path) -> None:
    """Nor has one that is not there."""
    (tmp_path / "media0").touch()
    assert who_holds(str(tmp_path / "media*")) is None
    assert who_holds(str(tmp_path / "video*")) is None


def test_the_kernel_s_list_of_locks_names_the_holder() -> None:
    """By device and inode, as the kernel writes them; who only waits for the lock does not hold it."""
    media0 = os.stat_result((0, 433, os.makedev(0, 0x1F), 1, 0, 0, 0, 0, 0, 0))
    locks = """\
1: POSIX  ADVISORY  WRITE 700 00:05:433 0 EOF
2: FLOCK  ADVISORY  WRITE 701 00:1f:432 0 EOF
3: POSIX  ADVISORY  WRITE 812 00:1f:433 0 EOF
3: -> POSIX  ADVISORY  WRITE 813 00:1f:433 0 EOF
"""
    assert locker_in(locks, [media0]) == 812
    assert locker_in("", [media0]) is None
