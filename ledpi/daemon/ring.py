"""The hand-over of frames from the capture thread to the decode worker: newest wins, nothing is copied.

Three slots are enough, and all that can be of use: one is being filled, one holds the newest whole frame, one
is being read. A frame that is still unread when the next one is published will never be read, so its slot is
the next to be filled.
"""

from __future__ import annotations

import threading
from dataclasses import dataclass

import numpy as np

from ledpi.core.records import Frame, Pixels

_SLOTS = 3


@dataclass(frozen=True, slots=True, kw_only=True)
class RingCounters:
    """The fate of the frames so far: published = taken + dropped, and one more while a frame waits."""

    published: int
    taken: int
    dropped: int  # overtaken by a newer frame before the reader came, or published after `close`


class FrameRing:
    """Preallocated slots of (height, width) uint8 between one writing and one reading thread."""

    def __init__(self, height: int, width: int) -> None:
        self._slots = np.zeros((_SLOTS, height, width), np.uint8)
        self._changed = threading.Condition()
        self._filling = 0
        self._reading: int | None = None
        self._newest: tuple[int, Frame] | None = None  # its slot, and the frame in it
        self._published = self._taken = self._dropped = 0
        self._closed = False

    def acquire(self) -> Pixels:
        """The slot to fill next, (height, width), writable. Never waits; the same one until `publish`."""
        slot: Pixels = self._slots[self._filling]
        return slot

    def publish(self, frame: Frame) -> None:
        """Hands over a frame whose `pixels` is a view of the slot last acquired. Never waits for the reader.

        Raises ValueError where `pixels` is not that whole slot: a copy would be lost time, and another slot
        may be in the reader's hands.
        """
        slot = self._slots[self._filling]
        if frame.pixels.shape != slot.shape or not np.may_share_memory(frame.pixels, slot):
            raise ValueError("a published frame's pixels must be a view of the slot that acquire() gave")
        with self._changed:
            self._published += 1
            if self._closed:
                self._dropped += 1
                return
            self._dropped += self._newest is not None
            self._newest = (self._filling, frame)
            taken = (self._filling, self._reading)
            self._filling = next(index for index in range(_SLOTS) if index not in taken)
            self._changed.notify()

    def take(self, timeout_s: float) -> Frame | None:
        """Waits for a frame newer than the last one taken; None after `timeout_s`, or when none will come.

        The frame's slot stays untouched until `release` or the next `take`. After `close`, a frame that is
        still unread is handed out once.
        """
        with self._changed:
            self._reading = None
            self._changed.wait_for(lambda: self._newest is not None or self._closed, timeout_s)
            if self._newest is None:
                return None
            self._reading, frame = self._newest
            self._newest = None
            self._taken += 1
            self._changed.notify_all()
            return frame

    def wait_until_taken(self, timeout_s: float) -> bool:
        """Waits, `timeout_s` at most, until no frame is left to be read, and tells whether that is so; for a replay."""
        with self._changed:
            return self._changed.wait_for(lambda: self._newest is None or self._closed, timeout_s)

    def release(self) -> None:
        """Gives the slot of the frame last taken back. Safe to call twice."""
        with self._changed:
            self._reading = None

    def close(self) -> None:
        """No further frame will come: wakes the reader. Safe to call twice, and from any thread."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    @property
    def closed(self) -> bool:
        """Tells whether `close` was called. A `take` that then gives None is the last."""
        return self._closed

    def counters(self) -> RingCounters:
        """A consistent snapshot."""
        with self._changed:
            return RingCounters(published=self._published, taken=self._taken, dropped=self._dropped)
