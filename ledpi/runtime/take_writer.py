"""A recording as it is taken: with what was decoded of its frames meanwhile, in live.jsonl."""

from __future__ import annotations

import json
from io import FileIO
from pathlib import Path
from types import TracebackType

from typing_extensions import Self

from ledpi.core.records import Decoded, Frame
from ledpi.pipeline.output import decoded_as_json
from ledpi.recording.wall_clock import unix_offset_ns
from ledpi.recording.writer import RecordingWriter
from ledpi.runtime.frame_buffers import KeptFrame
from ledpi.wire.diary import DIARY_FILE

LIVE_FILE = "live.jsonl"
PART = ".part"  # how the name of a recording ends until it is whole, where somebody might take it for that


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
