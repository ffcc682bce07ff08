"""Frames from a camera to a recording, at full rate: capture waits neither for the encoding nor for the decoder.

    capture ──▶ encoders (PNG) ──▶ writer, in order
       └──────▶ decoder, whenever it is free ──▶ live.jsonl

A frame can be decoded again, but not recorded again: where the encoders are behind, none is decoded.
Which frames were decoded is settled as each is captured, so its line in frames.jsonl can say so, and `ledpi decode
--as-live` decodes the same frames in the same order.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ledpi.camera.base import Camera, GainFollower
from ledpi.camera.recording.wall_clock import unix_offset_ns
from ledpi.camera.recording.writer import encode_picture
from ledpi.camera.recovering import LOST
from ledpi.core.records import Decoded, Frame, Rejected
from ledpi.daemon.threads import switch_promptly
from ledpi.pipeline.pipeline import Pipeline

ENCODERS = 2
WAITING = 128  # frames between capture and disk, 2 s at 60 a second and 40 MB: a disk may pause for so long
BEHIND = WAITING // 4  # of them: the encoders are behind, and the decoder leaves the processor to them


@dataclass(slots=True)
class Recorded:
    """The fate of the frames so far."""

    written: int = 0
    decoded: int = 0
    dropped: int = 0  # there was no room, as the disk or the encoders were too slow
    unfit: int = 0  # made otherwise than asked, or without a time
    lost: int = 0  # times that the camera was lost, and opened again
    missed: int = 0  # gaps in seq: frames that the camera made and nobody fetched in time
    picture_bytes: int = 0


class FrameWriter(Protocol):
    """A context that takes the frames, and what was decoded of them meanwhile. Raises RecordingError."""

    def __enter__(self) -> object: ...

    def __exit__(self, *error: Any) -> None: ...

    @property
    def write(self) -> Callable[..., int]:
        """Adds a frame, as a RecordingWriter does; returns its picture's bytes."""

    def write_live(self, frame: Frame, decoded: Decoded) -> None:
        """Adds what was decoded of a frame, which may be written later. From another thread."""


class Recorder:
    """One recording from one camera. `stop` ends it, from any thread or signal handler; what was captured is kept."""

    def __init__(self, camera: Camera, writer: FrameWriter, pipeline: Pipeline) -> None:
        self.done = Recorded()
        self._camera = camera
        self._writer = writer
        self._pipeline = pipeline
        self._gain = GainFollower(camera)
        self._waiting: deque[Frame] = deque()  # until they are on the disk
        self._decoder_is_free = True
        self._stopping = False
        self._failure: BaseException | None = None

    def stop(self) -> None:
        """Takes no lock, so a signal handler may call it."""
        self._stopping = True

    def run(self, frames: int | None = None) -> None:
        """Until `stop`, the camera's end, or so many frames. Raises LedpiError; what was written by then is whole."""
        switch_promptly()
        with (
            self._writer,
            ThreadPoolExecutor(ENCODERS) as encoders,
            ThreadPoolExecutor(1) as writer,
            ThreadPoolExecutor(1) as decoder,
        ):
            self._capture(encoders, writer, decoder, frames)
        if self._failure is not None:
            raise self._failure

    def _capture(self, encoders: Executor, writer: Executor, decoder: Executor, frames: int | None) -> None:
        info = self._camera.info
        captured = unfit = 0  # unfit: since the last frame, whose number they have taken
        is_lost = False
        next_seq: int | None = None
        while not self._stopping and (frames is None or captured < frames):
            frame = self._camera.read(np.empty((info.height, info.width), np.uint8))
            if frame is None:
                break
            if frame == LOST:
                self.done.lost += not is_lost
                is_lost = True
                continue
            if isinstance(frame, Rejected):
                self.done.unfit += 1
                unfit += 1
                continue
            self.done.missed += 0 if next_seq is None or is_lost else frame.seq - next_seq - unfit
            is_lost, unfit, next_seq = False, 0, frame.seq + 1
            captured += 1
            if len(self._waiting) >= WAITING:
                self.done.dropped += 1
                continue
            is_decoded = self._decoder_is_free and len(self._waiting) < BEHIND
            self._waiting.append(frame)
            if is_decoded:
                self._decoder_is_free = False
                decoder.submit(self._guard, self._decode, frame)
            writer.submit(self._guard, self._write, frame, encoders.submit(encode_picture, frame.pixels), is_decoded)

    def _write(self, frame: Frame, png: Future[bytes], decoded: bool) -> None:
        """Never leaves capture waiting: after a failure nothing more is written, as of a full disk."""
        self._waiting.popleft()
        if self._failure is None:
            self.done.picture_bytes += self._writer.write(
                frame,
                png=png.result(),
                decoded=decoded,
                search_budget=self._pipeline.likelihood.search_budget if decoded else None,
                wall_clock_offset_ns=unix_offset_ns(frame),
            )
            self.done.written += 1

    def _decode(self, frame: Frame) -> None:
        decoded = self._pipeline.decode(frame)
        self._gain.update(frame, decoded)
        self.done.decoded += 1
        self._decoder_is_free = True
        self._writer.write_live(frame, decoded)

    def _guard(self, work: Callable[..., None], *values: Any) -> None:
        try:
            work(*values)
        except BaseException as error:  # what is there is a recording
            self._failure = self._failure or error
            self._stopping = True
