"""What the daemon writes beside its work: recordings of what it decoded, in a folder of the service or of the user."""

from __future__ import annotations

import fcntl
import json
import os
import re
import shutil
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from datetime import datetime, timezone
from pathlib import Path
from typing import NamedTuple, TextIO

from ledpi.core.errors import RecordingError
from ledpi.core.records import CameraInfo, Frame, PanelSpec
from ledpi.pipeline.output import decoded_as_json
from ledpi.recording.wall_clock import unix_offset_ns
from ledpi.recording.writer import RecordingWriter
from ledpi.runtime.frame_buffers import KeptFrame
from ledpi.runtime.recorder import LIVE_FILE

PART = ".part"  # how the name of a recording ends until it is whole
AUTOMATIC = ("camera_lost", "contradicted")  # causes that nobody asked for
MAX_AUTOMATIC = 5  # recordings of these that stay
MIN_FREE_BYTES = 100_000_000  # that a disk has left afterwards: a full one stops more than this

# The decoder that decodes it again does not remember what the daemon did.
RUN_IN = "decoded again, its first second may differ"

_OLD = re.compile(rf"\d{{8}}T\d{{6}}Z-({'|'.join(AUTOMATIC)})(-\d+)?({re.escape(PART)})?")


class Shown(NamedTuple):
    """What a recording says of its camera and its panels."""

    camera: CameraInfo
    dictionary: str
    panel: PanelSpec
    source: str


class Take:
    """A recording that is being written; `write` is for one thread."""

    def __init__(self, path: Path, writer: RecordingWriter, live: TextIO) -> None:
        """`path`: where it is to be once it is whole."""
        self.path = path
        self.written = 0  # frames
        self._writer, self._live = writer, live

    def write(self, kept: KeptFrame, frame: Frame) -> None:
        """Adds what was kept, and `frame`, the same with its picture. Raises RecordingError or OSError."""
        self._writer.write(
            frame, decoded=True, search_budget=kept.search_budget, wall_clock_offset_ns=unix_offset_ns(frame)
        )
        self.written += 1
        self._live.write(json.dumps(decoded_as_json(kept.decoded, self.path.name)) + "\n")


@contextmanager
def new_take(folder: Path, shown: Shown, cause: str, note: str) -> Iterator[Take]:
    """One whose name says when and why; its name ends in `.part` until the end.

    What is there when an exception comes stays so; without a frame, nothing does. Raises RecordingError or OSError.
    """
    path = _new_path(folder, cause)
    part, take = path.with_name(path.name + PART), None
    with ExitStack() as in_work:
        try:
            with (
                RecordingWriter(
                    part, camera=shown.camera, dictionary=shown.dictionary, panel=shown.panel, note=f"{note}; {RUN_IN}"
                ) as writer,
                (part / LIVE_FILE).open("x", encoding="utf-8", buffering=1) as live,
            ):
                in_work.enter_context(_in_work(part))
                take = Take(path, writer, live)
                yield take
        except BaseException:
            if take is None or take.written == 0:  # without a frame it is none
                shutil.rmtree(part, ignore_errors=True)
            raise
        part.rename(path)


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
    """Where recordings are written: in the service's StateDirectory=, else in the user's own."""
    given = os.environ.get("STATE_DIRECTORY", "").partition(":")[0]
    if given:
        return Path(given)
    return Path(os.environ.get("XDG_STATE_HOME") or os.path.expanduser("~/.local/state")) / "ledpi" / "takes"


def make_room(folder: Path, cause: str, wanted_bytes: int) -> None:
    """Forgets the oldest of those that nobody asked for. Raises RecordingError where the disk is too full."""
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)  # whoever may not use the tap gets no picture here either
    if cause in AUTOMATIC:
        old = sorted(path for path in folder.iterdir() if _OLD.fullmatch(path.name) and path.is_dir())
        for path in old[: max(0, len(old) - MAX_AUTOMATIC + 1)]:
            shutil.rmtree(path, ignore_errors=True)
    check_room(folder, wanted_bytes)


def check_room(folder: Path, wanted_bytes: int = 0) -> None:
    """Raises RecordingError where the disk has too little left for so much more."""
    status = os.statvfs(folder)
    free, wanted = status.f_bavail * status.f_frsize, wanted_bytes + MIN_FREE_BYTES
    if free < wanted:
        raise RecordingError(f"{folder}: the disk has {free / 1e6:.0f} MB left; {wanted / 1e6:.0f} MB are needed")


def _new_path(folder: Path, cause: str) -> Path:
    name = f"{datetime.now(timezone.utc):%Y%m%dT%H%M%SZ}-{cause}"
    for number in range(1, 1000):
        path = folder / (name if number == 1 else f"{name}-{number}")
        if not path.exists() and not path.with_name(path.name + PART).exists():
            return path
    raise RecordingError(f"{folder / name}: is there a thousand times; is the clock stuck?")
