"""A command that runs where a folder is a disk of its own, which is soon full."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import pytest

from tests.builders import ROOT
from tests.builders.waiting import limit_s

LEDPI = (sys.executable, "-m", "ledpi")
# A folder, what it may hold and what lies in it already (kB), and the command.
WITHIN = """
set -e
mount -t tmpfs -o size="$2"k none "$1"
head -c "$3"k /dev/zero > "$1/full"
shift 3
exec "$@"
"""
# As root; others may be root within a namespace of their own.
ALONE = ("unshare", "-m") if os.geteuid() == 0 else ("unshare", "-r", "-m")


def works() -> bool:
    """Tells whether this system lets us mount one."""
    try:
        mounts = subprocess.run([*ALONE, "mount", "-t", "tmpfs", "none", "/mnt"], check=False, capture_output=True)
    except FileNotFoundError:
        return False
    return mounts.returncode == 0


needs_small_disk = pytest.mark.skipif(not works(), reason="needs leave to mount a disk in a namespace")


def on_a_small_disk(
    folder: Path, *arguments: object, has_kb: int, full_kb: int = 0, command: Sequence[str] = LEDPI
) -> subprocess.CompletedProcess[str]:
    """`ledpi ARGUMENTS`, to which `folder` is a disk of so many kB."""
    folder.mkdir(exist_ok=True)
    sizes = (str(has_kb), str(full_kb))
    within = [*ALONE, "/bin/sh", "-c", WITHIN, "within", str(folder), *sizes, *command, *map(str, arguments)]
    return subprocess.run(within, cwd=ROOT, capture_output=True, text=True, timeout=limit_s(30), check=False)
