"""A finding of one check."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

State = Literal["ok", "bad", "unknown"]


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One line of the page."""

    name: str  # what was looked at, as "camera"
    state: State  # unknown: could not be looked at here, or does not apply
    said: str  # what was found
    remedy: str = ""  # where it is bad: what to do
    stops_daemon: bool = False  # whether `ledpi run` ends, or does not start, for it


def ok(name: str, said: str) -> Finding:
    """It is as it should be."""
    return Finding(name=name, state="ok", said=said)


def unknown(name: str, said: str) -> Finding:
    """It could not be looked at here, or does not apply."""
    return Finding(name=name, state="unknown", said=said)


def bad(name: str, said: str, remedy: str, *, stops_daemon: bool = False) -> Finding:
    """It is not; `remedy` is what to do."""
    return Finding(name=name, state="bad", said=said, remedy=remedy, stops_daemon=stops_daemon)
