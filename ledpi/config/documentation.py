"""The documentation of the configuration's keys: the rows of docs/configuration.md, which the package brings along."""

from __future__ import annotations

import re
from functools import cache
from typing import NamedTuple

from ledpi.config.shipped import key_tables

_LINK = r"\[([^]]*)\]\([^)]*\)"


class Documented(NamedTuple):
    """One row, as text."""

    unit: str
    default: str  # in YAML; `none` where the key must be given
    allowed: str
    meaning: str


@cache
def documented() -> dict[str, Documented]:
    """By dotted key, in the page's order. Raises InstallationError."""
    lines = [line for line in key_tables().splitlines() if line.startswith("| `")]
    rows = [[_plain(cell) for cell in re.split(r"\s*(?<!\\)\|\s*", line)[1:-1]] for line in lines]
    return {row[0]: Documented(*row[1:]) for row in rows if len(row) == 1 + len(Documented._fields)}


def _plain(cell: str) -> str:
    """The text of Markdown, without the marks of code; of a link what it is called, if that is part of a sentence."""
    text = re.sub(rf" \({_LINK}\)|(?<=\.) {_LINK}$", "", cell.replace(r"\|", "|"))
    return re.sub(r"\*(\w+)\*", r"\1", re.sub(_LINK, r"\1", text)).replace("`", "").removesuffix(".")
