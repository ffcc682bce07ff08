"""The order in which takes were begun, in a file beside them: names have the time of day, and a clock may go back.

A Pi has no clock that goes on without power: where no network sets it, it begins each time at the date of its last end.
"""

from __future__ import annotations

from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from ledpi.core.errors import LedpiError, RecordingError
from ledpi.core.files import locked, put_in_place, read_text, remove_unfinished, write_beside
from ledpi.runtime.take_writer import PART

FILE = ".order"  # a name a line, the oldest first
MOST = 1000  # that are remembered


def note_begun(folder: Path, name: str) -> None:
    """Notes the name of the newest. Where that fails, its time of day tells."""
    file = folder / FILE
    with suppress(OSError), locked(folder):
        remove_unfinished(file)
        names = [*_names(folder), name][-MOST:]
        put_in_place(write_beside(file, "\n".join(names).encode(), mode=0o600), file)


def oldest_first(folder: Path, names: Iterable[str]) -> list[str]:
    """Those that were noted come last, as they were begun; ahead of them others, by the time in their names."""
    place = {name: at for at, name in enumerate(_names(folder))}
    return sorted(names, key=lambda name: (place.get(name.removesuffix(PART), -1), name))


def _names(folder: Path) -> list[str]:
    file = folder / FILE
    try:
        return read_text(file, RecordingError).split("\n") if file.exists() else []
    except LedpiError:
        return []
