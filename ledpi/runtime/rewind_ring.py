"""The last seconds of a stream, in memory: pictures as they were, and what was decoded of them.

Room for pictures is asked for once. A frame takes the room of the oldest; what is being written keeps its own until it
is written, and meanwhile fewer seconds are kept. So nobody waits, and what is kept never has a gap.
"""

from __future__ import annotations

import math
from collections import deque

import numpy as np

from ledpi.core.records import Decoded, Frame
from ledpi.runtime.frame_buffers import FrameBuffers, KeptFrame, follows, side_bytes

# Kept beyond what is asked for: who decodes it again has to find and read the panels first, as live once.
RUN_IN_NS = 1_000_000_000
SPARE = 2  # pictures' rooms that stay free, so that the next frame has one when all others are handed over
MIN_FRAMES = 8  # frames, less than which are not worth keeping
SIDE_SHARE = 1 / 8  # of the memory, at least, is for results


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
        self._side_bytes = 0

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

        From one thread, as often as there are frames: what was written goes to where the next is taken from.
        """
        with self._changing:
            if len(self._free) <= SPARE:
                return
            slot = self._free.pop(0)
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
