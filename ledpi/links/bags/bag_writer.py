"""A recording as a bag: pictures, lens, and what was decoded, in ROS 2's messages; and what makes it one again.

What is there when the power fails is a bag of the frames until then. Chunks are short and not compressed: pictures are
PNG already, and a Pi has better things to do. A whole chunk is handed to the kernel at once, so a process that is
killed loses a few frames at most.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from io import BufferedWriter
from pathlib import Path
from types import TracebackType
from typing import Any

from mcap.writer import CompressionType, Writer
from typing_extensions import Self

from ledpi import __version__
from ledpi.camera.recording.format import HEADER_FILE
from ledpi.camera.recording.writer import encode_picture, frame_line, header_of, header_text
from ledpi.core.dictionaries import is_file
from ledpi.core.errors import RecordingError
from ledpi.core.files import writing
from ledpi.core.records import CameraInfo, Decoded, Frame, PanelSpec
from ledpi.core.shutter import row_mid_exposure_ns
from ledpi.daemon.tap.messages import Shown
from ledpi.daemon.tap.messages import decoded as decoded_line
from ledpi.links.bags.contents import CAMERA_FRAME, CAMERA_INFO, DECODED, FRAME, IMAGE, METADATA, TRUTH
from ledpi.links.ros.contents import STRING, Message, Names, camera_info_message, frame_messages, image_message
from ledpi.links.ros.types import definition, to_cdr
from ledpi.wire.diary import DIARY_FILE

CHUNK_BYTES = 1 << 18  # one or two frames
PROFILE = "ros2"


class McapWriter:
    """A context manager that writes a new file. Any thread may `add`. Raises RecordingError."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._adding = threading.Lock()
        self._channels: dict[str, int] = {}
        self._schemas: dict[str, int] = {}
        self._file: BufferedWriter | None = None
        self._writer: Writer | None = None

    def __enter__(self) -> Self:
        with self._writing():
            if self._path.exists():
                raise RecordingError(f"{self._path}: is there already; give a new name")
            self._file = self._path.open("xb")
            self._writer = Writer(self._file, chunk_size=CHUNK_BYTES, compression=CompressionType.NONE)
            self._writer.start(PROFILE, f"ledpi {__version__}")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Writes the index, unless the file could not be written before."""
        assert self._file is not None
        assert self._writer is not None
        try:
            if not isinstance(error, RecordingError):
                with self._writing():
                    self._writer.finish()  # type: ignore[no-untyped-call]
                    self._file.flush()
        finally:
            with self._closing():
                self._file.close()

    def add(self, message: Message, log_ns: int) -> None:
        """Adds a message. `log_ns`: Unix time by which players replay it."""
        data = to_cdr(message.type, message.values)
        with self._adding, self._writing():
            assert self._writer is not None
            assert self._file is not None
            channel = self._channel(message.topic, message.type)
            self._writer.add_message(channel, max(log_ns, 0), data, max(message.stamp_ns, 0))
            self._file.flush()

    def add_metadata(self, name: str, values: Mapping[str, str]) -> None:
        """Adds words that are no message."""
        with self._adding, self._writing():
            assert self._writer is not None
            self._writer.add_metadata(name, dict(values))

    def _channel(self, topic: str, kind: str) -> int:
        assert self._writer is not None
        if kind not in self._schemas:
            self._schemas[kind] = self._writer.register_schema(kind, "ros2msg", definition(kind).encode())
        if topic not in self._channels:
            self._channels[topic] = self._writer.register_channel(topic, "cdr", self._schemas[kind])
        return self._channels[topic]

    @contextmanager
    def _writing(self) -> Iterator[None]:
        with writing(self._path, RecordingError):
            yield

    @contextmanager
    def _closing(self) -> Iterator[None]:
        """A full disk refuses the rest of the buffer once more."""
        try:
            yield
        except OSError:
            assert self._file is not None
            self._file.raw.close()


NAMES = Names(camera_frame=CAMERA_FRAME)


class BagWriter:
    """A context manager that writes one bag, with a recording writer's methods. Raises RecordingError."""

    def __init__(
        self,
        path: Path,
        *,
        camera: CameraInfo,
        dictionary: str,
        panel: PanelSpec,
        note: str = "",
        header: str | None = None,
        diary: str | None = None,
    ) -> None:
        """`header`, `diary`: recording.yaml and controller.jsonl, where there is one already."""
        self._mcap = McapWriter(path)
        self._camera = camera
        self._words = {} if diary is None else {DIARY_FILE: diary}
        if is_file(dictionary):  # a bag, too, holds all that it takes to read it
            self._words[Path(dictionary).name] = Path(dictionary).read_text(encoding="utf-8")
            dictionary = Path(dictionary).name
        self._side_m = panel.side_m
        self._header, self._note, self._header_text = header_of(camera, dictionary, panel), note, header
        self._offset_ns: int | None = None  # to Unix time; None: nothing is written yet

    def __enter__(self) -> Self:
        self._mcap.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._mcap.__exit__(kind, error, trace)

    def write(
        self,
        frame: Frame,
        *,
        png: bytes | None = None,
        decoded: bool | None = None,
        search_budget: int | None = None,
        wall_clock_offset_ns: int | None = None,
    ) -> int:
        """Adds a frame, as RecordingWriter does. Returns the picture's bytes."""
        line = frame_line(frame, decoded=decoded, search_budget=search_budget).model_dump_json(exclude_defaults=True)
        return self.write_line(frame, line, encode_picture(frame.pixels) if png is None else png, wall_clock_offset_ns)

    def write_line(self, frame: Frame, line: str, png: bytes, wall_clock_offset_ns: int | None) -> int:
        """Adds a frame with a line of frames.jsonl that there is already."""
        if self._offset_ns is None:
            self._begin(wall_clock_offset_ns)
        stamp_ns, log_ns = self._times_ns(frame)
        self._mcap.add(image_message(png, IMAGE, stamp_ns, CAMERA_FRAME), log_ns)
        self._mcap.add(camera_info_message(self._camera, CAMERA_INFO, stamp_ns, CAMERA_FRAME), log_ns)
        self._add_text(FRAME, line, stamp_ns, log_ns)
        return len(png)

    def write_live(self, frame: Frame, decoded: Decoded) -> None:
        """Adds what was decoded of a frame."""
        offset_ns = self._offset_ns or 0
        stamp_ns, log_ns = self._times_ns(frame)
        here = frame.host_offset_ns
        shown = Shown(decoded.seq, frame, decoded, done_ns=log_ns - offset_ns + here, rows=self._camera.height)
        values = decoded_line(shown)
        self._add_text(DECODED, json.dumps(values), stamp_ns, log_ns)
        for message in frame_messages(values, NAMES, offset_ns - here, lambda _: self._side_m):
            self._mcap.add(message, log_ns)

    def write_truth(self, frame: Frame, truth_line: str) -> None:
        """Adds what is to be seen in a frame, as a line of truth.jsonl."""
        stamp_ns, log_ns = self._times_ns(frame)
        self._add_text(TRUTH, truth_line, stamp_ns, log_ns)

    def _begin(self, offset_ns: int | None) -> None:
        self._offset_ns = offset_ns or 0
        header = self._header.model_copy(update={"wall_clock_offset_ns": offset_ns})
        text = self._header_text or header_text(header, self._note)
        self._mcap.add_metadata(METADATA, {HEADER_FILE: text, **self._words})

    def _times_ns(self, frame: Frame) -> tuple[int, int]:
        """Unix time of mid-exposure of the picture's centre row, and of the end of its read-out."""
        offset_ns, rows = self._offset_ns or 0, self._camera.height
        exposed_ns = row_mid_exposure_ns(frame, (rows - 1) / 2)
        return exposed_ns + offset_ns, frame.row0_readout_ns + round(rows * frame.row_time_us * 1e3) + offset_ns

    def _add_text(self, topic: str, text: str, stamp_ns: int, log_ns: int) -> None:
        values: dict[str, Any] = {"data": text}
        self._mcap.add(Message(topic, STRING, stamp_ns, values), log_ns)
