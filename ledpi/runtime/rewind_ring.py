"""The last seconds of a stream, in memory: pictures as they were, what was decoded of them, and now and then the state.

Room for pictures is asked for once. A frame takes the room of the oldest; what is being written keeps its own until it
is written, and meanwhile fewer seconds are kept. So nobody waits, and what is kept never has a gap.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable

import numpy as np

from ledpi.core.records import Decoded, Frame
from ledpi.pipeline.state import PipelineState, size_of
from ledpi.runtime.frame_buffers import FrameBuffers, KeptFrame, follows

# Between two states. A recording begins at one; so much more is kept than is asked for. Where little is kept at all,
# it is a quarter of that.
STATE_EVERY_NS, STATE_SHARE = 1_000_000_000, 4
SPARE = 2  # pictures' rooms that stay free, so that the next frame has one when all others are handed over
MIN_FRAMES = 8  # frames, less than which are not worth keeping
SIDE_SHARE = 1 / 8  # of the memory, at least, is for states and results
MARKER_BYTES, FRAME_BYTES = 4096, 2048  # of what was decoded, as Python holds it; a little more than it is


class RewindRing(FrameBuffers):
    """Between the decode thread, which keeps, and those that take what was kept; it is written in another thread."""

    def __init__(self, height: int, width: int, period_ms: float, seconds: float, most_bytes: int) -> None:
        """`most_bytes`: of memory, for all. Where they hold less than `seconds`, less is kept, or nothing."""
        picture = height * width
        wanted = math.ceil((1e3 * seconds + STATE_EVERY_NS * 1e-6) / period_ms) + SPARE
        count = min(wanted, int((1.0 - SIDE_SHARE) * most_bytes) // picture)
        super().__init__(count if count >= MIN_FRAMES else 0, height, width)
        self._state_every_ns = min(STATE_EVERY_NS, round(1e6 * period_ms * self.frames / STATE_SHARE))
        self._longest_ns = round(seconds * 1e9) + STATE_EVERY_NS
        self._most_side_bytes = most_bytes - self.frames * picture
        self._kept: deque[KeptFrame] = deque()
        self._side_bytes = 0
        self._state: PipelineState | None = None
        self._stated_ns: int | None = None  # read-out of the frame after which the last state was taken

    def keep(self, frame: Frame, decoded: Decoded, search_budget: int, state: Callable[[], PipelineState]) -> None:
        """A frame that was just decoded, and that might spend so much. Copies its picture; waits for nobody.

        `state` tells what the pipeline is left with; it is called now and then.
        """
        self.seen += 1
        before, self._state = self._state, None
        side_bytes = FRAME_BYTES + MARKER_BYTES * len(decoded.markers) + (0 if before is None else size_of(before))
        slot = self._slot_for(frame, side_bytes)
        if slot is not None:
            np.copyto(self._pictures[slot], frame.pixels)
            kept = KeptFrame(slot, frame.drop_picture(), decoded, search_budget, before, side_bytes)
            with self._changing:
                self._kept.append(kept)
                self._side_bytes += side_bytes
        if self._stated_ns is None or not 0 <= frame.row0_readout_ns - self._stated_ns < self._state_every_ns:
            self._state, self._stated_ns = state(), frame.row0_readout_ns

    @property
    def kept_s(self) -> float:
        """From the first frame that is kept to the last one. From any thread."""
        with self._changing:
            if not self._kept:
                return 0.0
            return (self._kept[-1].frame.row0_readout_ns - self._kept[0].frame.row0_readout_ns) * 1e-9

    def begin(self, state: PipelineState) -> None:
        """The state before the first frame."""
        self._state = state

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
        """All that is kept, from the oldest state on; it is forgotten here. Empty where there is nothing.

        Its slots are the taker's, who gives back each.
        """
        with self._changing:
            taken, self._kept, self._side_bytes = list(self._kept), deque(), 0
            self._stated_ns = None  # what comes after it begins with a state
            first = next((k for k, kept in enumerate(taken) if kept.state is not None), len(taken))
            self._free += [kept.slot for kept in taken[:first]]
        return taken[first:]

    def _slot_for(self, frame: Frame, side_bytes: int) -> int | None:
        """Room for a picture, and for so much beside it; None where all is being written, or there never is so much."""
        with self._changing:
            if self._kept and not follows(frame, self._kept[-1].frame):
                self._free += [kept.slot for kept in self._kept]
                self._kept, self._side_bytes, self._stated_ns = deque(), 0, None
            oldest_ns = frame.row0_readout_ns - self._longest_ns
            while self._kept and (
                len(self._free) < SPARE
                or self._side_bytes + side_bytes > self._most_side_bytes
                or self._kept[0].frame.row0_readout_ns < oldest_ns
            ):
                oldest = self._kept.popleft()
                self._free.append(oldest.slot)
                self._side_bytes -= oldest.side_bytes
            if not self._free or side_bytes > self._most_side_bytes:
                self._stated_ns = None  # what is kept next begins with a state
                return None
            return self._free.pop()
