"""scripts/install, as far as it goes without changing this machine."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
INSTALL = ROOT / "scripts/install"


def test_it_is_a_valid_script() -> None:
    """As bash reads it."""
    subprocess.run(["bash", "-n", str(INSTALL)], check=True)


@pytest.mark.skipif(os.geteuid() != 0, reason="needs root")
def test_an_argument_that_is_not_known_changes_nothing() -> None:
    """The message says what there is."""
    done = subprocess.run([str(INSTALL), "--purge"], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "--purge: must be --uninstall, or nothing" in done.stderr


def test_every_system_that_is_named_has_constraints() -> None:
    """The script takes the file of the system's name."""
    assert {path.stem for path in (ROOT / "constraints").glob("*.txt")} == {"bookworm", "trixie"}
