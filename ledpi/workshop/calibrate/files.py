"""Writing a calibration: whole or not at all, never over an older one; and changed keys into what people wrote."""

from __future__ import annotations

import contextlib
import errno
import glob
import io
import os
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from ledpi.config.mistakes import SECRET
from ledpi.core.errors import CalibrationError
from ledpi.core.files import (
    locked,
    not_written,
    parse_yaml,
    put_in_place,
    read_bytes,
    read_text,
    remove_unfinished,
    sync_folder,
    write_beside,
    writing,
)

PICTURE_SUFFIX = ".png"
MAX_KEPT_BYTES = 64 * 1024 * 1024  # of an older file that is copied: a picture
MOST_KEPT = 5  # older files: enough to undo an afternoon
# Said by FAT, by network file systems, of other users' files (fs.protected_hardlinks), and of a file on another disk.
_NO_SECOND_NAME = (errno.EPERM, errno.EOPNOTSUPP, errno.EMLINK, errno.EXDEV)


Key = tuple[str | int, ...]  # ("panels", "overrides", 7, "black_hz")


def check_with_picture(path: Path) -> None:
    """As `check_writable` of `path` and of the picture beside it."""
    if path.suffix == PICTURE_SUFFIX:
        raise CalibrationError(f"{path}: must not end in {PICTURE_SUFFIX}: a picture of that name is written beside it")
    _check_is_file(path)  # a folder, as ".", has no name that a picture could have
    check_writable(path, picture_beside(path))


def check_writable(*files: Path) -> None:
    """Raises CalibrationError where one of `files` cannot be written: before the long work, not after it."""
    for file in files:
        _check_is_file(file)
        with writing(file, CalibrationError):
            write_beside(followed(file), b"").unlink(missing_ok=True)


def picture_beside(path: Path) -> Path:
    """camera.png beside camera.yaml."""
    return path.with_suffix(PICTURE_SUFFIX)


def write_keeping_old(path: Path, content: str | bytes, *, mode: int = 0o666) -> Path | None:
    """Writes `content`, text as UTF-8. A file that is already there is kept beside it as NAME.bak-1, -2, …

    The last five are kept. At every moment `path` is whole, the older file or the new one, whenever the power is cut.
    Owner, group and mode are the older file's, and of a link the file to which it leads is replaced. Returns the kept
    file, if there was an older one. `mode`: that of a new file, less the umask. Raises CalibrationError where `path`
    cannot be written; the older file is then untouched.
    """
    with changing(path):
        return write_locked(path, content, mode=mode)


@contextlib.contextmanager
def changing(path: Path) -> Iterator[None]:
    """Lets nobody else change `path`, who asks, too. Raises CalibrationError where somebody does for long."""
    with contextlib.ExitStack() as held:
        with writing(path, CalibrationError):
            held.enter_context(locked(followed(path).parent))
        yield


def write_locked(path: Path, content: str | bytes, *, mode: int = 0o666) -> Path | None:
    """As `write_keeping_old`, within `changing(path)`."""
    _check_is_file(path)
    real = followed(path)
    fresh = None
    try:
        remove_unfinished(real)
        older = real.lstat() if real.is_file() and not real.is_symlink() else None
        data = content.encode() if isinstance(content, str) else content
        fresh = write_beside(real, data, like=older, mode=mode)
        kept = _keep(real, path) if real.exists() else None
        put_in_place(fresh, real)
    except OSError as error:
        raise not_written(path, error, CalibrationError) from None
    finally:
        if fresh is not None:
            _forget(fresh)
    return kept


def newest_kept(path: Path) -> Path | None:
    """The older file that was kept last; None where there is none."""
    number = max(_kept_numbers(path), default=None)
    return None if number is None else _kept_name(path, number)


def followed(path: Path) -> Path:
    """The file to which a link leads that root or we have made; another user's link in a shared folder is replaced."""
    for _ in range(40):  # as many as the kernel follows
        if not path.is_symlink() or path.lstat().st_uid not in (0, os.geteuid()):
            break
        path = path.parent / path.readlink()
    return path


def _check_is_file(path: Path) -> None:
    if path.exists() and not path.is_file():
        what = "a folder" if path.is_dir() else "no file but a device, or the like, which must not be renamed"
        raise CalibrationError(f"{path}: is {what}; must be the file to write")


def _forget(fresh: Path) -> None:
    with contextlib.suppress(OSError):
        fresh.unlink(missing_ok=True)


def _keep(real: Path, path: Path) -> Path:
    """Gives the file a second name beside `path`, NAME.bak-1, -2, …; a copy has it where a file may have no second one.

    Of those that were kept before the last ones stay.
    """
    earlier = sorted(_kept_numbers(path))
    kept = _kept_name(path, earlier[-1] + 1 if earlier else 1)
    try:
        os.link(real, kept, follow_symlinks=False)
    except OSError as error:
        if error.errno not in _NO_SECOND_NAME:
            raise
        write_beside(kept, read_bytes(real, CalibrationError, MAX_KEPT_BYTES), like=real.lstat()).rename(kept)
    for number in earlier[: -MOST_KEPT + 1]:
        _forget(_kept_name(path, number))
    sync_folder(path.parent)
    return kept


def _kept_name(path: Path, number: int) -> Path:
    return path.with_name(f"{path.name}.bak-{number}")


def _kept_numbers(path: Path) -> Iterator[int]:
    for kept in path.parent.glob(f"{glob.escape(path.name)}.bak-*"):
        number = kept.name.rpartition("-")[2]
        if number.isascii() and number.isdigit() and len(number) < 10:
            yield int(number)


def change_config(path: Path, changes: Mapping[Key, Any], check: Callable[[], None] = lambda: None) -> Path | None:
    """Sets keys of a YAML file, and makes sections that are missing. Returns the file in which the older one is kept.

    `check` may refuse the change; nobody else changes the file between that and the writing. Raises CalibrationError
    where the file cannot be changed without losing something.
    """
    with changing(path):
        check()
        return write_locked(path, changed_safely(read_text(path, CalibrationError), changes, path))


def changed_safely(text: str, changes: Mapping[Key, Any], where: object) -> str:
    """As `changed_yaml`. Raises CalibrationError, which begins with `where`, if another key would change, too."""
    changed = changed_yaml(text, changes)
    wanted = parse_yaml(text, where, CalibrationError) or {}
    for key, value in changes.items():
        _set(wanted, key, value)
    if parse_yaml(changed, where, CalibrationError) != wanted:
        shown = {".".join(map(str, key)): value for key, value in changes.items()}
        named = ", ".join(key if key.endswith(SECRET) else f"{key}: {value}" for key, value in shown.items())
        raise CalibrationError(f"{where}: cannot be changed without touching other keys; set by hand: {named}")
    return changed


def changed_yaml(text: str, changes: Mapping[Key, Any]) -> str:
    """The text with keys set, by ruamel.yaml, which keeps comments."""
    editor = _editor()
    editor.preserve_quotes = True
    editor.width = 4096  # no line is broken that was whole
    editor.representer.add_representer(type(None), lambda to, _: to.represent_scalar("tag:yaml.org,2002:null", "null"))
    tree = editor.load(text)
    for key, value in changes.items():
        _set(tree, key, _in_one_line(value))
    out = io.StringIO()
    editor.dump(tree, out)
    return out.getvalue()


def _editor() -> Any:
    from ruamel.yaml import YAML  # takes 50 ms

    return YAML()


def _in_one_line(value: Any) -> Any:
    """As in [7, 23]."""
    from ruamel.yaml.comments import CommentedSeq

    if not isinstance(value, (list, tuple)):
        return value
    items = CommentedSeq(value)
    items.fa.set_flow_style()
    return items


def _set(tree: Any, key: Key, value: Any) -> None:
    *sections, last = key
    for name in sections:
        if tree.get(name) is None:
            tree[name] = {}
        tree = tree[name]
    tree[last] = value
