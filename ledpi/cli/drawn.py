"""Drawn pictures to files."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from ledpi.errors import RecordingError

if TYPE_CHECKING:
    from ledpi.records import Pixels


def write_drawn(path: Path, drawn: Pixels, option: str) -> None:
    """Encodes as the file's suffix says. Raises RecordingError, which names the `option` that gave the path."""
    import cv2

    data = cv2.imencode(path.suffix.lower(), drawn)[1]
    try:
        path.write_bytes(data.tobytes())
    except OSError as error:
        raise RecordingError(f"{option} {path}: cannot be written: {error.strerror}") from None
