"""Units of systemd, as its own tools read them."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import pytest

from tests.builders import ROOT

needs_systemd = pytest.mark.skipif(shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed")


class Unit:
    """One of systemd/."""

    def __init__(self, name: str) -> None:
        self.path = ROOT / "systemd" / name
        self.text = self.path.read_text(encoding="utf-8")

    def values(self, key: str) -> list[str]:
        """Of each line of that key."""
        return re.findall(rf"^{re.escape(key)}=(.*)$", self.text, re.MULTILINE)

    def copy_to(self, folder: Path) -> Path:
        """With a command that exists here in the place of the installed one."""
        assert self.text.count("/usr/local/bin/ledpi ") == 1
        copy = folder / self.path.name
        copy.write_text(self.text.replace("/usr/local/bin/ledpi ", f"{shutil.which('true')} "), encoding="utf-8")
        return copy
