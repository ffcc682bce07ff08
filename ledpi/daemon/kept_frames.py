"""Frames that are kept, in memory that is asked for once: the last seconds, and those on their way into a recording.

Nobody waits. The last seconds have no gap: a frame takes the room of the oldest; what is being written keeps its own
until then, and meanwhile fewer seconds are kept. On the way into a recording, a frame that finds no room is counted.
"""

from __future__ import annotations

import math
import queue
import threading
import time
from abc import ABC, abstractmethod
from collections import deque
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ledpi.core.records import Decoded, Frame

# Of what was decoded, as Python holds it; a little more than it is.
_MARKER_BYTES, _FRAME_BYTES, _LINE_BYTES = 4096, 2048, 320
# Kept beyond what is asked for: who decodes it again has to find and read the panels first, as live once.
RUN_IN_NS = 1_000_000_000
SPARE = 2  # pictures' rooms that stay free, so that the next frame has one when all others are handed over
MIN_FRAMES = 8  # frames, less than which are not worth keeping
SIDE_SHARE = 1 / 8  # of the memory, at least, is for results
# A disk may pause for a second; of large pictures there are fewer, as a service's memory is limited.
MAX_FRAMES, MAX_BYTES, MIN_QUEUED = 64, 24_000_000, 4
MOST_MISSED = 10_000  # lines: a minute's


class KeptFrame(NamedTuple):
    """A frame of the past."""

    slot: int  # where its picture is
    frame: Frame  # without its picture
    decoded: Decoded
    search_budget: int

    @property
    def side_bytes(self) -> int:
        """That all of this takes, beside the picture."""
        return side_bytes(self.decoded)


def side_bytes(decoded: Decoded) -> int:
    """That a frame takes beside its picture, in memory."""
    return _FRAME_BYTES + _MARKER_BYTES * len(decoded.markers) + _LINE_BYTES * len(decoded.diary)


class FrameBuffers(ABC):
    """`frames` rooms of H × W bytes. What keeps frames in them is derived from it; any thread may give one back."""

    def __init__(self, frames: int, height: int, width: int) -> None:
        self.frames = frames
        self.seen = 0  # frames that came
        self._pictures = np.empty((frames, height, width), np.uint8)  # the system gives it as it is first written
        self._changing = threading.Lock()
        self._free = list(range(frames))  # the last one is taken first: it was written before

    def keep(self, frame: Frame, decoded: Decoded, search_budget: int) -> None:
        """Keeps a frame that was just decoded, and that might spend so much. Copies its picture; waits for nobody."""
        self.seen += 1
        slot = self._slot_for(frame, decoded)
        if slot is not None:
            np.copyto(self._pictures[slot], frame.pixels)
            with self._changing:
                self._put(KeptFrame(slot, frame.drop_picture(), decoded, search_budget))

    @abstractmethod
    def _slot_for(self, frame: Frame, decoded: Decoded) -> int | None:
        """A room for it; None where it cannot be kept."""

    @abstractmethod
    def _put(self, kept: KeptFrame) -> None:
        """Takes it in; `_changing` is held."""

    def picture_of(self, kept: KeptFrame) -> Frame:
        """The frame with its picture, until that is given back."""
        return replace(kept.frame, pixels=self._pictures[kept.slot].view())

    def give_back(self, kept: KeptFrame) -> None:
        """Frees the room of what was taken, and is written."""
        with self._changing:
            self._free.append(kept.slot)

    @property
    def room(self) -> int:
        """Counts the pictures that fit before there is no free room."""
        with self._changing:
            return len(self._free)


def follows(new: Frame, old: Frame) -> bool:
    """Tells whether a recording may hold both, one after the other."""
    return new.seq > old.seq and new.row0_readout_ns > old.row0_readout_ns


class RewindRing(FrameBuffers):
    """Between the decode thread, which keeps, and those that take what was kept; it is written in another thread."""

    def __init__(self, height: int, width: int, period_ms: float, seconds: float, most_bytes: int) -> None:
        """`most_bytes`: of memory, for all. Where they hold less than `seconds`, less is kept, or nothing."""
        picture = height * width
        wanted = math.ceil((1e3 * seconds + RUN_IN_NS * 1e-6) / period_ms) + SPARE
        count = min(wanted, int((1.0 - SIDE_SHARE) * most_bytes) // picture)
        super().__init__(count if count >= MIN_FRAMES else 0, height, width)
        self._longest_ns = round(seconds * 1e9) + RUN_IN_NS
        self._most_side_bytes = most_bytes - self.frames * picture
        self._kept: deque[KeptFrame] = deque()
        self._side_bytes = self._touched = 0

    @property
    def is_empty(self) -> bool:
        """Tells whether nothing is kept now. From any thread."""
        with self._changing:
            return not self._kept

    @property
    def kept_s(self) -> float:
        """From the first frame that is kept to the last one. From any thread."""
        with self._changing:
            if not self._kept:
                return 0.0
            return (self._kept[-1].frame.row0_readout_ns - self._kept[0].frame.row0_readout_ns) * 1e-9

    def touch(self) -> None:
        """Writes a room that was never written, so that the system gives its memory now, and not to the decode thread.

        From one thread: what was written goes to where the next is taken from. Does nothing once all are.
        """
        with self._changing:
            if self._touched >= self.frames or len(self._free) <= SPARE:
                return
            slot = self._free.pop(0)
            self._touched += 1
        np.copyto(self._pictures[slot], 0)
        with self._changing:
            self._free.append(slot)

    def take(self) -> list[KeptFrame]:
        """Returns all that is kept, the oldest first, and forgets it. The taker gives back each slot."""
        with self._changing:
            taken, self._kept, self._side_bytes = list(self._kept), deque(), 0
        return taken

    def _put(self, kept: KeptFrame) -> None:
        self._kept.append(kept)
        self._side_bytes += kept.side_bytes

    def _slot_for(self, frame: Frame, decoded: Decoded) -> int | None:
        """A room, and memory for what is beside it; None where all is being written, or there never is so much."""
        wanted_bytes = side_bytes(decoded)
        with self._changing:
            if self._kept and not follows(frame, self._kept[-1].frame):
                self._free += [kept.slot for kept in self._kept]
                self._kept, self._side_bytes = deque(), 0
            oldest_ns = frame.row0_readout_ns - self._longest_ns
            while self._kept and (
                len(self._free) < SPARE
                or self._side_bytes + wanted_bytes > self._most_side_bytes
                or self._kept[0].frame.row0_readout_ns < oldest_ns
            ):
                oldest = self._kept.popleft()
                self._free.append(oldest.slot)
                self._side_bytes -= oldest.side_bytes
            if not self._free or wanted_bytes > self._most_side_bytes:
                return None
            return self._free.pop()


class RecordQueue(FrameBuffers):
    """`keep` is for the decode thread, `next` for the one that writes, `close` for any."""

    def __init__(self, height: int, width: int) -> None:
        super().__init__(max(MIN_QUEUED, min(MAX_FRAMES, MAX_BYTES // (height * width))), height, width)
        self._pictures.fill(0)  # the system gives the memory now, and not to the decode thread
        self.dropped = 0  # frames that found no room
        self._waiting: queue.SimpleQueue[KeptFrame | None] = queue.SimpleQueue()
        self._last: Frame | None = None  # that came
        # The diary's lines of frames that found no room: the next one has them. A disk may hang for hours.
        self._missed: deque[str] = deque(maxlen=MOST_MISSED)
        self._is_closed = False

    def _slot_for(self, frame: Frame, decoded: Decoded) -> int | None:
        last, self._last = self._last, frame.drop_picture()
        if last is not None and not follows(frame, last):  # a camera was opened anew; no recording holds both
            self.close()
        with self._changing:
            slot = self._free.pop() if self._free and not self._is_closed else None
            if slot is None and not self._is_closed:
                self.dropped += 1
                self._missed.extend(decoded.diary)
        return slot

    def _put(self, kept: KeptFrame) -> None:
        if not self._is_closed:
            diary = (*self._missed, *kept.decoded.diary)
            self._missed.clear()
            self._waiting.put(kept._replace(decoded=replace(kept.decoded, diary=diary)))

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
