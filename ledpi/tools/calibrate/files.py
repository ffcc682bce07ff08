"""Writing a calibration: whole or not at all, and never over an older one."""

from __future__ import annotations

import contextlib
from pathlib import Path

from ledpi.core.errors import CalibrationError
from ledpi.core.files import write_beside

PICTURE_SUFFIX = ".png"


def check_with_picture(path: Path) -> None:
    """As `check_writable` of `path` and of the picture beside it."""
    if path.suffix == PICTURE_SUFFIX:
        raise CalibrationError(f"{path}: must not end in {PICTURE_SUFFIX}: a picture of that name is written beside it")
    check_writable(path, picture_beside(path))


def check_writable(*files: Path) -> None:
    """Raises CalibrationError where one of `files` cannot be written.

    For what takes long to measure: that would be lost at its end.
    """
    for file in files:
        _check_is_file(file)
        try:
            write_beside(file, b"").unlink()
        except OSError as error:
            raise _refused(file, error) from None


def picture_beside(path: Path) -> Path:
    """camera.png beside camera.yaml."""
    return path.with_suffix(PICTURE_SUFFIX)


def write_keeping_old(path: Path, content: str | bytes) -> Path | None:
    """Writes `content`, text as UTF-8. A file that is already there is kept beside it as NAME.bak-1, -2, …

    Returns the kept file, if there was one. Raises CalibrationError where `path` cannot be written; the older
    file is then untouched.
    """
    _check_is_file(path)
    fresh = None
    try:
        fresh = write_beside(path, content.encode() if isinstance(content, str) else content)
        kept = _next_backup(path) if path.exists() else None
        if kept is not None:
            path.rename(kept)
        fresh.replace(path)
    except OSError as error:
        if fresh is not None:
            _forget(fresh)
        raise _refused(path, error) from None
    return kept


def _check_is_file(path: Path) -> None:
    if path.exists() and not path.is_file():
        what = "a folder" if path.is_dir() else "no file but a device, or the like, which must not be renamed"
        raise CalibrationError(f"{path}: is {what}; must be the file to write")


def _refused(path: Path, error: OSError) -> CalibrationError:
    return CalibrationError(f"{path}: cannot be written: {error.strerror}")


def _forget(half_written: Path) -> None:
    with contextlib.suppress(OSError):
        half_written.unlink(missing_ok=True)


def _next_backup(path: Path) -> Path:
    number = 1
    while (backup := path.with_name(f"{path.name}.bak-{number}")).exists():
        number += 1
    return backup
