"""Measurements, by what they measure: `accuracy`, `speed`, `endurance`, and `drives` of a robot."""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import NoReturn

ROOT = Path(__file__).resolve().parents[1]


def table(head: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """In Markdown."""
    return "\n".join("| " + " | ".join(line) + " |" for line in (head, ["---"] * len(head), *lines))


def end(name: str, faults: Mapping[str, bool]) -> NoReturn:
    """Ends a benchmark: with a line for each fault that holds, and exit status 1 where one does."""
    found = [fault for fault, holds in faults.items() if holds]
    for fault in found:
        print(f"{name}: {fault}", file=sys.stderr)
    sys.exit(1 if found else 0)
