"""Units of systemd, as its own tools read them."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.builders import ROOT

ANALYZE = "systemd-analyze"
needs_systemd = pytest.mark.skipif(shutil.which(ANALYZE) is None, reason="systemd-analyze is not installed")


def said_of(unit: Path) -> str:
    """Returns what systemd has to say about a unit; nothing where all is well."""
    done = subprocess.run([ANALYZE, "verify", "--man=no", str(unit)], capture_output=True, text=True, check=False)
    assert done.returncode == 0 or done.stderr
    return done.stderr


def assert_closed_in(unit: Path) -> None:
    """systemd's own measure of what a service could do, from 0 to 10, is at most 2.5."""
    command = [ANALYZE, "security", "--offline=true", "--no-pager", "--threshold=25", str(unit)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout[-200:] + done.stderr


class Unit:
    """One of systemd/."""

    def __init__(self, name: str) -> None:
        self.path = ROOT / "systemd" / name
        self.text = self.path.read_text(encoding="utf-8")

    def values(self, key: str) -> list[str]:
        """Returns those of each line of that key."""
        return re.findall(rf"^{re.escape(key)}=(.*)$", self.text, re.MULTILINE)

    def copy_to(self, folder: Path) -> Path:
        """With a command that exists here in the place of the installed one."""
        assert self.text.count("/usr/local/bin/ledpi ") == 1
        copy = folder / self.path.name
        copy.write_text(self.text.replace("/usr/local/bin/ledpi ", f"{shutil.which('true')} "), encoding="utf-8")
        return copy
