"""Drawn pictures to files: whole or not at all, and never over what they were drawn from."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from ledpi.core.errors import ConfigError, RecordingError
from ledpi.core.files import not_written, put_in_place, write_beside

if TYPE_CHECKING:
    from ledpi.core.records import Pixels


def check_apart(folder: Path, pictures: Iterable[Path], option: str) -> None:
    """Raises ConfigError where drawings in `folder` would lie among the `pictures`, whose names they may have."""
    if folder.resolve() in {parent.resolve() for parent in {path.parent for path in pictures}}:
        raise ConfigError(f"{option} {folder}: holds the pictures that are read; must be another folder")


def write_drawn(path: Path, drawn: Pixels, option: str) -> None:
    """Encodes as the file's suffix says. Raises RecordingError, which names the `option` that gave the path; an older
    picture is then untouched.
    """
    import cv2

    data = cv2.imencode(path.suffix.lower(), drawn)[1]
    fresh = None
    try:
        fresh = write_beside(path, data.tobytes())
        put_in_place(fresh, path)
    except OSError as error:
        if fresh is not None:
            with contextlib.suppress(OSError):
                fresh.unlink()
        raise not_written(path, error, RecordingError, f"{option} {path}") from None
