"""Writing a calibration: whole or not at all, and never over an older one."""

from __future__ import annotations

import contextlib
import errno
import os
from pathlib import Path

from ledpi.core.errors import CalibrationError, LedpiError
from ledpi.core.files import not_written, put_in_place, read_bytes, sync_folder, write_beside

PICTURE_SUFFIX = ".png"
MAX_KEPT_BYTES = 64 * 1024 * 1024  # of an older file that is copied: a picture
# Said by FAT, by network file systems, and of other users' files (fs.protected_hardlinks).
_NO_SECOND_NAME = (errno.EPERM, errno.EOPNOTSUPP, errno.EMLINK)


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


def write_keeping_old(path: Path, content: str | bytes, *, mode: int | None = None) -> Path | None:
    """Writes `content`, text as UTF-8. A file that is already there is kept beside it as NAME.bak-1, -2, …

    At every moment `path` is whole, the older file or the new one, whenever the power is cut. Returns the kept file, if
    there was one. `mode`: its permissions, if not the usual ones. Raises CalibrationError where `path` cannot be
    written; the older file is then untouched.
    """
    _check_is_file(path)
    fresh = None
    try:
        fresh = write_beside(path, content.encode() if isinstance(content, str) else content)
        if mode is not None:
            fresh.chmod(mode)
        kept = _keep(path) if path.exists() else None
        put_in_place(fresh, path)
    except OSError as error:
        raise _refused(path, error) from None
    finally:
        if fresh is not None:
            _forget(fresh)
    return kept


def _check_is_file(path: Path) -> None:
    if path.exists() and not path.is_file():
        what = "a folder" if path.is_dir() else "no file but a device, or the like, which must not be renamed"
        raise CalibrationError(f"{path}: is {what}; must be the file to write")


def _refused(path: Path, error: OSError) -> LedpiError:
    return not_written(path, error, CalibrationError)


def _forget(fresh: Path) -> None:
    with contextlib.suppress(OSError):
        fresh.unlink(missing_ok=True)


def _keep(path: Path) -> Path:
    """Gives the file a second name, NAME.bak-1, -2, …; a copy has it where a file may have no second one."""
    number = 1
    while True:
        kept = path.with_name(f"{path.name}.bak-{number}")
        try:
            os.link(path, kept, follow_symlinks=False)
            break
        except FileExistsError:
            number += 1
        except OSError as error:
            if error.errno not in _NO_SECOND_NAME:
                raise
            if not os.path.lexists(kept):
                write_beside(kept, read_bytes(path, CalibrationError, MAX_KEPT_BYTES)).rename(kept)
                break
            number += 1
    sync_folder(path.parent)
    return kept
