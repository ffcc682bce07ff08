"""An MCAP file that is being written. What is there when the power fails is a bag of the frames until then.

Chunks are short and not compressed: pictures are PNG already, and a Pi has better things to do. A whole chunk is handed
to the kernel at once, so a process that is killed loses a few frames at most.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from io import BufferedWriter
from pathlib import Path
from types import TracebackType

from mcap.writer import CompressionType, Writer
from typing_extensions import Self

from ledpi import __version__
from ledpi.core.errors import RecordingError
from ledpi.core.files import writing
from ledpi.links.ros.contents import Message
from ledpi.links.ros.types import definition, to_cdr

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
