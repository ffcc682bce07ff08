"""`takes`, `take` and `take_delete` of the tap: recordings of the daemon listed, read as a tar file, and deleted.

A client names a take, never a path: the name has a fixed form, and links are followed nowhere. The tar file is made
piece by piece as it is asked for, from the sizes of a take's files, so a piece is all that is ever in memory.
"""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import stat
import tarfile
from bisect import bisect_right
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import accumulate
from pathlib import Path
from typing import Any, NamedTuple

from ledpi.core.errors import RecordingError
from ledpi.daemon.takes import PART, oldest_first, takes_folder
from ledpi.daemon.tap.protocol import Request

PIECE_BYTES = 1 << 18
MOST_LISTED = 300  # the newest
_NAME = re.compile(rf"\d{{8}}T\d{{6}}Z-[a-z_]{{1,20}}(-\d{{1,3}})?({re.escape(PART)})?", re.ASCII)
_IN_WORK = "is being written; ask again when it is complete"


class _Archive(NamedTuple):
    """A take's tar file: what it is made of, bytes or a file of the take, and where each begins."""

    of: tuple[str, int, int]  # name, inode and time of the folder
    parts: tuple[bytes | str, ...]
    starts: tuple[int, ...]  # and the end


class KeptTakes:
    """Those in one folder. The tap calls each command in a thread of its own, one of each kind at a time."""

    def __init__(self, folder: Path | None = None) -> None:
        self._folder = folder or takes_folder()
        self._archive: _Archive | None = None  # the last that was asked for

    def list(self, request: Request) -> dict[str, Any]:
        """The newest first: `name`, `frames`, and whether it is `written` just now."""
        names = []
        with suppress(FileNotFoundError), os.scandir(self._folder) as entries:
            names = [e.name for e in entries if _NAME.fullmatch(e.name) and e.is_dir(follow_symlinks=False)]
        return {"takes": [self._told(name) for name in oldest_first(self._folder, names)[: -MOST_LISTED - 1 : -1]]}

    def read(self, request: Request) -> dict[str, Any]:
        """A piece of the take's tar file from `offset` on, and how many bytes the whole has. Raises RecordingError."""
        with self._opened(request) as folder:
            archive = self._archive_of(request.name or "", folder)
            offset = request.offset
            if offset > archive.starts[-1]:
                raise RecordingError(f"offset: the take has {archive.starts[-1]} bytes, not {offset}")
            return {"size": archive.starts[-1], "raw": _piece(archive, folder, offset)}

    def delete(self, request: Request) -> dict[str, Any]:
        """For good. Raises RecordingError where it is being written."""
        with self._opened(request):
            shutil.rmtree(self._folder / (request.name or ""))
        return {"deleted": request.name}

    def _told(self, name: str) -> dict[str, Any]:
        try:
            frames = len(os.listdir(self._folder / name / "frames"))
        except OSError:
            frames = 0
        in_work = False
        with suppress(OSError), _descriptor(self._folder / name) as folder:
            in_work = not _is_at_rest(folder)
        return {"name": name, "frames": frames, "written": in_work}

    @contextmanager
    def _opened(self, request: Request) -> Iterator[int]:
        """The folder of the take that is named, where it is whole and nobody writes to it. Raises RecordingError."""
        name = request.name
        if name is None or _NAME.fullmatch(name) is None:
            raise RecordingError("name: must be that of a take; `takes` lists them")
        try:
            with _descriptor(self._folder / name) as folder:
                if not _is_at_rest(folder):
                    raise RecordingError(f"{name}: {_IN_WORK}")
                yield folder
        except FileNotFoundError:
            raise RecordingError(f"{name}: there is no such take; `takes` lists them") from None
        except NotADirectoryError:  # a link, or a file
            raise RecordingError(f"{name}: is no folder, and no take") from None

    def _archive_of(self, name: str, folder: int) -> _Archive:
        status = os.fstat(folder)
        of = name, status.st_ino, status.st_mtime_ns
        if self._archive is None or self._archive.of != of:
            self._archive = _archive(of, folder)
        return self._archive


@contextmanager
def _descriptor(path: Path, flags: int = os.O_DIRECTORY, at: int | None = None) -> Iterator[int]:
    """A file or folder, not what a link of that name leads to."""
    descriptor = os.open(path, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC | flags, dir_fd=at)
    try:
        yield descriptor
    finally:
        os.close(descriptor)


def _is_at_rest(folder: int) -> bool:
    """Tells whether no daemon writes there: it holds a lock as long as it does."""
    try:
        fcntl.flock(folder, fcntl.LOCK_SH | fcntl.LOCK_NB)
    except BlockingIOError:
        return False
    return True


def _archive(of: tuple[str, int, int], folder: int) -> _Archive:
    """Regular files only, in the order of their names."""
    parts: list[tuple[bytes | str, int]] = []
    for relative, status in sorted(_files(folder)):
        info = tarfile.TarInfo(f"{of[0]}/{relative}")
        info.size, info.mtime, info.mode = status.st_size, int(status.st_mtime), 0o644
        header, padding = info.tobuf(tarfile.PAX_FORMAT), bytes(-status.st_size % tarfile.BLOCKSIZE)
        parts += [(header, len(header)), (relative, status.st_size), (padding, len(padding))]
    parts.append((bytes(2 * tarfile.BLOCKSIZE), 2 * tarfile.BLOCKSIZE))  # a tar file's end
    return _Archive(of, tuple(part for part, _ in parts), tuple(accumulate((size for _, size in parts), initial=0)))


def _files(folder: int) -> Iterator[tuple[str, os.stat_result]]:
    for above, _, names, at in os.fwalk(".", dir_fd=folder):
        for name in names:
            status = os.stat(name, dir_fd=at, follow_symlinks=False)
            if stat.S_ISREG(status.st_mode):
                yield os.path.normpath(os.path.join(above, name)), status


def _piece(archive: _Archive, folder: int, offset: int) -> bytes:
    """The tar file's bytes from `offset` on, PIECE_BYTES at most."""
    piece, end = bytearray(), min(archive.starts[-1], offset + PIECE_BYTES)
    while (at := offset + len(piece)) < end:
        number = bisect_right(archive.starts, at) - 1
        part, within, most = (
            archive.parts[number],
            at - archive.starts[number],
            min(end, archive.starts[number + 1]) - at,
        )
        if isinstance(part, bytes):
            piece += part[within : within + most]
            continue
        with _descriptor(Path(part), 0, folder) as file:
            content = os.pread(file, most, within)
        if not content:
            raise RecordingError(f"{part}: is shorter than it was")
        piece += content
    return bytes(piece)
