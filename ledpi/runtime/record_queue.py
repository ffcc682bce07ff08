"""Frames on their way into a recording that was begun: between the decode thread and the one that writes.

The rooms are bounded, and their memory is there before the first frame comes. A frame that finds no room is no part of
the recording, and is counted. So the decoder waits for no disk.
"""

from __future__ import annotations

import queue
import time

from ledpi.core.records import Decoded, Frame
from ledpi.runtime.frame_buffers import FrameBuffers, KeptFrame, follows

# A disk may pause for a second; of large pictures there are fewer, as a service's memory is limited.
MAX_FRAMES, MAX_BYTES, MIN_FRAMES = 64, 24_000_000, 4


class RecordQueue(FrameBuffers):
    """`keep` is for the decode thread, `next` for the one that writes, `close` for any."""

    def __init__(self, height: int, width: int) -> None:
        super().__init__(max(MIN_FRAMES, min(MAX_FRAMES, MAX_BYTES // (height * width))), height, width)
        self._pictures.fill(0)  # the system gives the memory now, and not to the decode thread
        self.dropped = 0  # frames that found no room
        self._waiting: queue.SimpleQueue[KeptFrame | None] = queue.SimpleQueue()
        self._last: Frame | None = None  # that came
        self._is_closed = False

    def _slot_for(self, frame: Frame, decoded: Decoded) -> int | None:
        last, self._last = self._last, frame.drop_picture()
        if last is not None and not follows(frame, last):  # a camera was opened anew; no recording holds both
            self.close()
        with self._changing:
            slot = self._free.pop() if self._free and not self._is_closed else None
            self.dropped += slot is None and not self._is_closed
        return slot

    def _put(self, kept: KeptFrame) -> None:
        if not self._is_closed:
            self._waiting.put(kept)

    def next(self, until_s: float) -> KeptFrame | None:
        """The oldest, as soon as it is there; None once it is closed and empty. Closes at `until_s` (monotonic)."""
        if time.monotonic() < until_s:
            try:
                return self._waiting.get(timeout=max(0.0, until_s - time.monotonic()))
            except queue.Empty:
                pass
        self.close()
        return self._waiting.get()

    def close(self) -> None:
        """Takes no more; what is there may still be taken."""
        with self._changing:
            if not self._is_closed:
                self._is_closed = True
                self._waiting.put(None)

    def abandon(self) -> None:
        """Drops what waits, as no part of the recording, and counts it. For the thread that writes."""
        self.close()
        while self._waiting.get() is not None:
            self.dropped += 1
