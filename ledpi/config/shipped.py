"""Files that come with ledpi and are no program: the commented configuration, tables of its pages, examples, units."""

from __future__ import annotations

import re
import shutil
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import NamedTuple

from ledpi.core.errors import ConfigError, InstallationError

_VALUE = r"[A-Za-z0-9_.:/+-]{1,100}"  # of what a udev rule compares
FOLDER = Path(__file__).parents[1] / "shipped-files"
_FOLDERS = ("examples", "systemd")
_LINK = r"\[([^]]*)\]\([^)]*\)"


def example() -> str:
    """The text of config.yaml: every key with its default and a comment. Raises InstallationError."""
    return _text("config.yaml")


def udev_rule() -> str:
    """The text of 61-ledpi.rules. Raises InstallationError."""
    return _text("systemd/61-ledpi.rules")


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


class Documented(NamedTuple):
    """One row, as text."""

    unit: str
    default: str  # in YAML; `none` where the key must be given
    allowed: str
    meaning: str


@cache
def documented() -> dict[str, Documented]:
    """By dotted key, in the page's order. Raises InstallationError."""
    return {row[0]: Documented(*row[1:]) for row in table_rows("configuration.md", 1 + len(Documented._fields))}


@cache
def reasons() -> dict[str, tuple[str, str]]:
    """By key, as `find.too_small`: what it means, and what helps. Raises InstallationError."""
    return {key: (means, helps) for key, means, helps in table_rows("troubleshooting.md", 3)}


def table_rows(page: str, columns: int) -> list[list[str]]:
    """The rows of so many columns of which the first is code, as text. Raises InstallationError."""
    lines = [line for line in _text(page).splitlines() if line.startswith("| `")]
    rows = [[_plain(cell) for cell in re.split(r"\s*(?<!\\)\|\s*", line)[1:-1]] for line in lines]
    return [row for row in rows if len(row) == columns]


def _plain(cell: str) -> str:
    """The text of Markdown, without the marks of code; of a link what it is called, if that is part of a sentence."""
    text = re.sub(rf" \({_LINK}\)|(?<=\.) {_LINK}$", "", cell.replace(r"\|", "|"))
    return re.sub(r"\*(\w+)\*", r"\1", re.sub(_LINK, r"\1", text)).replace("`", "").removesuffix(".")


def foreign_line(content: bytes) -> int | None:
    """Number of the first line of a udev rule that is not one of ledpi's own, counted from 1; None where all are."""
    try:
        lines = content.decode("utf-8").split("\n")
    except UnicodeDecodeError:
        return 1
    return next((number for number, line in enumerate(lines, 1) if not _is_own(line)), None)


def _is_own(line: str) -> bool:
    if "\\" in line or not line.replace("\t", " ").isprintable():  # one at its end would join the next line
        return False
    text = line.strip()
    return not text or text[0] == "#" or any(form.fullmatch(text) for form in _forms())


@cache
def _forms() -> tuple[re.Pattern[str], ...]:
    return tuple(map(re.compile, _written(udev_rule())))


def _written(template: str) -> Iterator[str]:
    """A pattern for each rule of the template, active or an example: what is compared may have any value."""
    for line in template.splitlines():
        rule = line.removeprefix("# ")
        if re.match(r'[A-Z]+(\{\w+\})?[!=]?="', rule):
            yield re.sub(r'==""', lambda _: f'=="{_VALUE}"', re.escape(re.sub(r'=="[^"]*"', '==""', rule)))
