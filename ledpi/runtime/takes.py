"""Recordings that the daemon writes beside its work, of what it decoded: in a folder of the service or of the user."""

from __future__ import annotations

import fcntl
import os
import re
import shutil
import threading
import time
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from datetime import datetime, timezone
from pathlib import Path
from typing import NamedTuple

from ledpi.core.errors import DiskFullError, LedpiError, RecordingError
from ledpi.core.files import FULL, not_written
from ledpi.core.records import CameraInfo, PanelSpec
from ledpi.runtime.frame_buffers import FrameBuffers, KeptFrame
from ledpi.runtime.take_order import note_begun, oldest_first
from ledpi.runtime.take_writer import PART, TakeWriter

AUTOMATIC = ("camera_lost", "contradicted")  # causes that nobody asked for
MAX_AUTOMATIC = 5  # recordings of these that stay
MIN_FREE_BYTES = 100_000_000  # that a disk has left afterwards: a full one stops more than this

# The decoder that decodes it again does not remember what the daemon did.
RUN_IN = "decoded again, its first second may differ"

_OLD = re.compile(rf"\d{{8}}T\d{{6}}Z-({'|'.join(AUTOMATIC)})(-\d+)?({re.escape(PART)})?")


class Shown(NamedTuple):
    """A recording's words on its camera and its panels."""

    camera: CameraInfo
    dictionary: str
    panel: PanelSpec
    source: str


@contextmanager
def new_take(folder: Path, shown: Shown, cause: str, note: str) -> Iterator[TakeWriter]:
    """One whose name says when and why; its name ends in `.part` until the end.

    What is there when an exception comes stays so; without a frame, nothing does. Raises RecordingError or OSError.
    """
    path = _new_path(folder, cause)
    part, take = path.with_name(path.name + PART), None
    with ExitStack() as in_work:
        try:
            with TakeWriter(
                part, camera=shown.camera, dictionary=shown.dictionary, panel=shown.panel, note=f"{note}; {RUN_IN}"
            ) as take:
                in_work.enter_context(_in_work(part))
                yield take
        except BaseException:
            if take is None or take.written == 0:  # without a frame it is none
                shutil.rmtree(part, ignore_errors=True)
            raise
        part.rename(path)


def write_take(
    begun: AbstractContextManager[TakeWriter], buffers: FrameBuffers, frames: Iterable[KeptFrame], ends: threading.Event
) -> TakeWriter:
    """Writes frames of `buffers` as they come, and gives each back. Returns the take once it is whole.

    It rests as long as it works while others are kept, unless the daemon `ends`. It asks for no lower priority: whoever
    takes the interpreter must not be kept from giving it back, or the decoder would wait for both.

    Raises RecordingError, which says where the frames until then are; so it does where there was none.
    """
    with begun as take:
        try:
            for kept in frames:
                began_s, seen = time.monotonic(), buffers.seen
                try:
                    check_room(take.path.parent)
                    take.write_kept(kept, buffers.picture_of(kept))
                finally:
                    buffers.give_back(kept)
                if buffers.seen > seen:
                    ends.wait(time.monotonic() - began_s)
        except (LedpiError, OSError) as error:
            part = take.path.with_name(take.path.name + PART)
            there = f"; {take.written} frames are in {part}" if take.written else ""
            raise failure_of(error, f"{said_of(error)}{there}") from None
        if take.written == 0:
            raise RecordingError("no frame was decoded meanwhile, and nothing is written")
    return take


def said_of(error: Exception) -> str:
    """In one line, also of the system's errors and of those that nobody has foreseen."""
    if isinstance(error, LedpiError):
        return str(error)
    if isinstance(error, OSError) and error.errno in FULL and error.filename:
        return str(not_written(Path(os.fsdecode(error.filename)), error, RecordingError))
    if isinstance(error, OSError) and error.strerror:
        return f"{error.filename}: {error.strerror}"
    return f"{type(error).__name__}: {error}"


def failure_of(error: Exception, said: str) -> RecordingError:
    """`said`, which `error` has made; a full disk stays one, as it may be less full the next time."""
    is_full = isinstance(error, DiskFullError) or (isinstance(error, OSError) and error.errno in FULL)
    return DiskFullError(said) if is_full else RecordingError(said)


@contextmanager
def _in_work(folder: Path) -> Iterator[None]:
    """Locked, so that nobody deletes it or reads half of it; the lock ends with the process, however that ends."""
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY | os.O_CLOEXEC)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX)
        yield
    finally:
        os.close(descriptor)


def takes_folder() -> Path:
    """Returns where recordings are written: in the service's StateDirectory=, else in the user's own."""
    given = os.environ.get("STATE_DIRECTORY", "").partition(":")[0]
    if given:
        return Path(given)
    return Path(os.environ.get("XDG_STATE_HOME") or os.path.expanduser("~/.local/state")) / "ledpi" / "takes"


def make_room(folder: Path, cause: str, wanted_bytes: int) -> None:
    """Forgets the oldest of those that nobody asked for. Raises RecordingError where the disk is too full."""
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)  # whoever may not use the tap gets no picture here either
    if cause in AUTOMATIC:
        unasked = (path.name for path in folder.iterdir() if _OLD.fullmatch(path.name) and path.is_dir())
        old = oldest_first(folder, unasked)
        for name in old[: max(0, len(old) - MAX_AUTOMATIC + 1)]:
            shutil.rmtree(folder / name, ignore_errors=True)
    check_room(folder, wanted_bytes)


def check_room(folder: Path, wanted_bytes: int = 0) -> None:
    """Raises RecordingError where the disk has too little left for so much more."""
    status = os.statvfs(folder)
    free, wanted = status.f_bavail * status.f_frsize, wanted_bytes + MIN_FREE_BYTES
    if free < wanted:
        said = f"the disk has {free / 1e6:.0f} MB left; {wanted / 1e6:.0f} MB are needed: make room on it"
        raise DiskFullError(f"{folder}: {said}")


def _new_path(folder: Path, cause: str) -> Path:
    name = f"{datetime.now(timezone.utc):%Y%m%dT%H%M%SZ}-{cause}"
    for number in range(1, 1000):
        path = folder / (name if number == 1 else f"{name}-{number}")
        if not path.exists() and not path.with_name(path.name + PART).exists():
            note_begun(folder, path.name)
            return path
    raise RecordingError(f"{folder / name}: is there a thousand times; is the clock stuck?")
