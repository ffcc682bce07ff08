"""The folder that a run's results are kept in: a broken-off run goes on where it stopped.

settings.json says what was asked for, units.jsonl holds a line for each unit that is finished.
"""

from __future__ import annotations

import hashlib
import json
import os
from functools import cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np

import ledpi
from ledpi.core.errors import ConfigError

SETTINGS_FILE, UNITS_FILE = "settings.json", "units.jsonl"
SOURCES = (".py", ".c", ".h")


@cache
def code_version(*further: Path) -> str:
    """Returns what results depend on: the sources of ledpi and of `further` packages; numpy, OpenCV."""
    digests = [source_digest(package)[:12] for package in (Path(ledpi.__file__).parent, *further)]
    return f"{'+'.join(digests)}, numpy {np.__version__} OpenCV {cv2.__version__}"


def source_digest(package: Path) -> str:
    """SHA-256 of a package's sources, those of its compiled loops too, and of their names; in hexadecimal."""
    digest = hashlib.sha256()
    for path in sorted(path for path in package.rglob("*") if path.suffix in SOURCES):
        digest.update(str(path.relative_to(package)).encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()


class ResultsFolder:
    """Raises ConfigError where the folder is of another run, holds something else, or cannot be used."""

    def __init__(self, path: Path, settings: dict[str, Any]) -> None:
        self.path = path
        self.finished: dict[str, dict[str, Any]] = {}  # records by their unit's key
        try:
            path.mkdir(parents=True, exist_ok=True)
            self._claim(json.loads(json.dumps(settings)))  # as it comes back from the file
            self._read_units()
        except OSError as error:
            raise ConfigError(f"--out {path}: cannot be used: {error.strerror}") from None

    def add(self, record: dict[str, Any]) -> None:
        """Keeps a finished unit's record, also when the run ends with the next breath."""
        with (self.path / UNITS_FILE).open("a", encoding="utf-8") as file:
            file.write(json.dumps(record) + "\n")
        self.finished[record["unit"]] = record

    def _claim(self, settings: dict[str, Any]) -> None:
        path = self.path / SETTINGS_FILE
        if not path.exists():
            if any(self.path.iterdir()):
                raise ConfigError(f"--out {self.path}: holds other things; must be new, empty, or of a run like this")
            path.write_text(json.dumps(settings, indent=1) + "\n", encoding="utf-8")
            return
        try:
            there = json.loads(path.read_text(encoding="utf-8"))
        except ValueError:
            raise ConfigError(f"{path}: is no JSON; remove the folder, or give another --out") from None
        if not isinstance(there, dict):
            raise ConfigError(f"{path}: must be settings; remove the folder, or give another --out")
        if there.keys() == settings.keys() and [*self.path.iterdir()] == [path]:  # it ended before its first unit
            path.write_text(json.dumps(settings, indent=1) + "\n", encoding="utf-8")
            return
        for key in settings:
            if there.get(key) != settings[key]:
                raise ConfigError(
                    f"{path}: {key}: the results here are of {there.get(key)!r}, asked for is {settings[key]!r}; "
                    "give another --out, or remove the folder"
                )

    def _read_units(self) -> None:
        path = self.path / UNITS_FILE
        if not path.exists():
            return
        content = path.read_bytes()
        whole = content.rfind(b"\n") + 1
        if whole < len(content):  # the run was broken off in the middle of this line
            os.truncate(path, whole)
        for number, line in enumerate(content[:whole].splitlines(), start=1):
            try:
                record = json.loads(line)
                self.finished[record["unit"]] = record
            except (ValueError, KeyError, TypeError):
                raise ConfigError(f"{path}: line {number}: is no unit's record; remove that line") from None
