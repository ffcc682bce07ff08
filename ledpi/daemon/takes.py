"""Recordings that the daemon writes beside its work, of what it decoded: in a folder of the service or of the user."""

from __future__ import annotations

import fcntl
import json
import logging
import os
import re
import shutil
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor, wait
from contextlib import ExitStack, contextmanager, suppress
from datetime import datetime, timezone
from io import FileIO
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple, TypeVar

from typing_extensions import Self

from ledpi.camera.recording.wall_clock import unix_offset_ns
from ledpi.camera.recording.writer import RecordingWriter
from ledpi.core.errors import DiskFullError, LedpiError, RecordingError
from ledpi.core.files import FULL, locked, not_written, put_in_place, read_text, remove_unfinished, write_beside
from ledpi.core.records import CameraInfo, Decoded, Frame, PanelSpec
from ledpi.daemon.kept_frames import FrameBuffers, KeptFrame
from ledpi.daemon.reporting import event
from ledpi.daemon.threads import NO_THREAD
from ledpi.pipeline.output import decoded_as_json
from ledpi.wire.diary import DIARY_FILE

LIVE_FILE = "live.jsonl"
PART = ".part"  # how the name of a recording ends until it is whole, where somebody might take it for that
ORDER_FILE = ".order"  # a name a line, the oldest first
MOST_REMEMBERED = 1000  # names there
RECORDED = "recorded"  # the cause of one that a client of the tap asked for
AUTOMATIC = ("camera_lost", "contradicted")  # causes that nobody asked for
MAX_AUTOMATIC = 5  # recordings of these that stay
MIN_FREE_BYTES = 100_000_000  # that a disk has left afterwards: a full one stops more than this
MAX_WAITING = 4  # of one kind
JOIN_S = 0.4

# The decoder that decodes it again does not remember what the daemon did.
RUN_IN = "decoded again, its first second may differ"

_OLD = re.compile(rf"\d{{8}}T\d{{6}}Z-({'|'.join(AUTOMATIC)})(-\d+)?({re.escape(PART)})?")
_log = logging.getLogger("ledpi")
Result = TypeVar("Result")


class TakeWriter(RecordingWriter):
    """A RecordingWriter that also takes what was decoded."""

    written = 0  # frames by `write_kept`
    _live: FileIO | None = None
    _diary: FileIO | None = None

    @property
    def path(self) -> Path:
        """Its place once it is whole."""
        return self._folder.with_name(self._folder.name.removesuffix(PART))

    def __enter__(self) -> Self:
        super().__enter__()
        self._live = self._create(LIVE_FILE)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        super().__exit__(kind, error, trace)
        for file in (self._live, self._diary):
            if file is not None:
                file.close()

    def write_live(self, frame: Frame, decoded: Decoded) -> None:
        """Adds what was decoded of a frame, which may be written later. From another thread, too."""
        assert self._live is not None
        self._append(self._live, json.dumps(decoded_as_json(decoded, self.path.name)))

    def write_kept(self, kept: KeptFrame, frame: Frame) -> None:
        """Adds what was kept, and `frame`, the same with its picture."""
        self.write(frame, decoded=True, search_budget=kept.search_budget, wall_clock_offset_ns=unix_offset_ns(frame))
        self.written += 1
        self.write_live(frame, kept.decoded)
        if kept.decoded.diary:
            self._diary = self._diary or self._create(DIARY_FILE)
            self._append(self._diary, "\n".join(kept.decoded.diary))


class Shown(NamedTuple):
    """A recording's words on its camera and its panels."""

    camera: CameraInfo
    dictionary: str
    panel: PanelSpec
    source: str


class Takes:
    """A daemon's recordings of one kind, written in a thread of their own, one after the other."""

    def __init__(self, kind: str, shown: Shown, folder: Path | None = None) -> None:
        """`kind`: as the journal names them."""
        self.shown, self.folder, self.ends = shown, folder or takes_folder(), threading.Event()
        self._kind = kind
        self._changing = threading.Lock()
        self._writer = ThreadPoolExecutor(1, kind)
        self._waiting: list[Future[Any]] = []

    def submit(self, job: Callable[..., Result], *values: Any) -> Future[Result]:
        """Runs soon what calls `write`. Raises RecordingError where too many wait, or the daemon ends."""
        with self._changing:
            self._waiting = [each for each in self._waiting if not each.done()]
            if self.ends.is_set() or len(self._waiting) > MAX_WAITING:
                raise RecordingError(f"{self._kind}: others are still being written; ask again later")
            try:
                done = self._writer.submit(job, *values)
            except RuntimeError:  # the job stays, and is done with the next one: it must find nothing left to do
                raise RecordingError(f"{self._kind}: {NO_THREAD}") from None
            self._waiting.append(done)
        return done

    def write(
        self, cause: str, note: str, buffers: FrameBuffers, frames: Iterable[KeptFrame], wanted_bytes: int
    ) -> TakeWriter:
        """Writes frames of `buffers` as they come, and gives each back. Returns the take once it is whole.

        It rests as long as it works while others are kept, unless the daemon ends. It asks for no lower priority:
        whoever takes the interpreter must not be kept from giving it back, or the decoder would wait for both.

        Raises RecordingError, which says where the frames until then are; so it does where there was none.
        """
        take: TakeWriter | None = None
        try:
            make_room(self.folder, cause, wanted_bytes)
            with new_take(self.folder, self.shown, cause, f"{note}; {RUN_IN}") as take:
                for kept in frames:
                    began_s, seen = time.monotonic(), buffers.seen
                    try:
                        check_room(self.folder)
                        take.write_kept(kept, buffers.picture_of(kept))
                    finally:
                        buffers.give_back(kept)
                    if buffers.seen > seen:
                        self.ends.wait(time.monotonic() - began_s)
                if take.written == 0:
                    raise RecordingError("no frame was decoded meanwhile, and nothing is written")
        except Exception as error:  # whatever it is, the daemon goes on, and who asked hears of it
            there = f"; {take.written} frames are in {take.path}{PART}" if take is not None and take.written else ""
            said = f"{said_of(error)}{there}"
            asked = cause == RECORDED
            _log.error(event(f"{self._kind}_failed", cause=None if asked else cause, reason=said))
            raise failure_of(error, said if asked else f"{self._kind}: {said}") from None
        return take

    def stop(self) -> None:
        """Ends after the picture in work. What is being written stays as far as it is: its name ends in `.part`."""
        with self._changing:
            self.ends.set()
            self._writer.shutdown(wait=False)

    def close(self) -> bool:
        """As `stop`, and waits for that, a moment at most. Returns whether all is written."""
        self.stop()
        return not wait(self._waiting, JOIN_S).not_done


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
                part, camera=shown.camera, dictionary=shown.dictionary, panel=shown.panel, note=note
            ) as take:
                in_work.enter_context(_in_work(part))
                yield take
        except BaseException:
            if take is None or take.written == 0:  # without a frame it is none
                shutil.rmtree(part, ignore_errors=True)
            raise
        part.rename(path)


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


# Names have the time of day, and a clock may go back: a Pi has none that goes on without power, and begins each time at
# the date of its last end. So a file beside the takes has the order in which they were begun.


def note_begun(folder: Path, name: str) -> None:
    """Notes the name of the newest. Where that fails, its time of day tells."""
    file = folder / ORDER_FILE
    with suppress(OSError), locked(folder):
        remove_unfinished(file)
        names = [*_names(folder), name][-MOST_REMEMBERED:]
        put_in_place(write_beside(file, "\n".join(names).encode(), mode=0o600), file)


def oldest_first(folder: Path, names: Iterable[str]) -> list[str]:
    """Those that were noted come last, as they were begun; ahead of them others, by the time in their names."""
    place = {name: at for at, name in enumerate(_names(folder))}
    return sorted(names, key=lambda name: (place.get(name.removesuffix(PART), -1), name))


def _names(folder: Path) -> list[str]:
    file = folder / ORDER_FILE
    try:
        return read_text(file, RecordingError).split("\n") if file.exists() else []
    except LedpiError:
        return []
