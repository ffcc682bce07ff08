"""Writing a calibration: whole or not at all, and never over an older one."""

from __future__ import annotations

import contextlib
from pathlib import Path

from ledpi.errors import CalibrationError


def write_keeping_old(path: Path, content: str | bytes) -> Path | None:
    """Writes `content`, text as UTF-8. A file that is already there is kept beside it as NAME.bak-1, -2, …

    Returns the kept file, if there was one. Raises CalibrationError where `path` cannot be written; the older
    file is then untouched.
    """
    fresh = path.with_name(path.name + ".new")
    try:
        fresh.write_bytes(content.encode() if isinstance(content, str) else content)
    except OSError as error:
        _forget(fresh)
        raise CalibrationError(f"{path}: cannot be written: {error.strerror}") from None
    return _put_in_place(fresh, path)


def _put_in_place(fresh: Path, path: Path) -> Path | None:
    if path.exists() and not path.is_file():
        fresh.unlink()
        what = "a folder" if path.is_dir() else "no file but a device, or the like, which must not be renamed"
        raise CalibrationError(f"{path}: is {what}; must be the file to write")
    kept = _next_backup(path) if path.exists() else None
    try:
        if kept is not None:
            path.rename(kept)
        fresh.replace(path)
    except OSError as error:
        raise CalibrationError(f"{path}: cannot be written: {error.strerror}") from None
    return kept


def _forget(half_written: Path) -> None:
    with contextlib.suppress(OSError):
        half_written.unlink(missing_ok=True)


def _next_backup(path: Path) -> Path:
    number = 1
    while (backup := path.with_name(f"{path.name}.bak-{number}")).exists():
        number += 1
    return backup
