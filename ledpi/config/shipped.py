"""Files that come with ledpi and are no program: the commented configuration, examples, the service, the udev rule."""

from __future__ import annotations

import shutil
from pathlib import Path

from ledpi.core.errors import ConfigError, InstallationError

FOLDER = Path(__file__).parents[1] / "shipped-files"
_FOLDERS = ("examples", "systemd")


def example() -> str:
    """The text of config.yaml: every key with its default and a comment. Raises InstallationError."""
    return _text("config.yaml")


def udev_rule() -> str:
    """The text of 61-ledpi.rules. Raises InstallationError."""
    return _text("systemd/61-ledpi.rules")


def key_tables() -> str:
    """The text of docs/configuration.md. Raises InstallationError."""
    return _text("configuration.md")


def _text(name: str) -> str:
    try:
        return (FOLDER / name).read_text(encoding="utf-8")
    except OSError as error:
        raise InstallationError(f"{error.filename}: {error.strerror}; install ledpi again") from None


def copy_files(to: Path) -> None:
    """Makes the folder, with the examples and the files of systemd and udev in it. Raises ConfigError."""
    try:
        to.mkdir(parents=True)
        for name in _FOLDERS:
            shutil.copytree(FOLDER / name, to / name, ignore=shutil.ignore_patterns("__pycache__"))
    except OSError as error:
        raise ConfigError(f"--files {to}: {error.strerror}; must be a new folder") from None
