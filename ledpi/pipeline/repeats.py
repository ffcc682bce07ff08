"""Pictures that a camera gives again, with a new time: what is old is never taken for what is seen now."""

from __future__ import annotations

from collections import deque

import numpy as np

from ledpi.core.records import MAX_GAP_NS, Frame, Pixels, Rejected

REPEATED = Rejected(stage="capture", reason="repeated")
# Every fourth row is compared: a panel that can be read crosses two of them at least, and noise never gives the same
# pixels again. Where nothing is lit pictures may be alike, and nothing is lost.
ROW_STEP = 4
BUFFERS = 8  # a driver that hangs gives the pictures in its buffers by turns: V4L2 and libcamera ask for four to six


class Repeats:
    """Tells whether a stream's picture is one of the last ones, byte for byte."""

    def __init__(self) -> None:
        self._past: deque[Pixels] = deque()  # the oldest first
        self._last_ns = 0

    def is_repeated(self, frame: Frame) -> bool:
        """Compares the picture with those that were kept, after a gap with the last one only; keeps its rows, too."""
        rows, now_ns = frame.pixels[::ROW_STEP], frame.row0_readout_ns
        if self._past and rows.shape != self._past[-1].shape:
            self._past.clear()
        if not 0 < now_ns - self._last_ns <= MAX_GAP_NS:
            self._past = deque([*self._past][-1:])
        self._last_ns = now_ns
        middle = len(rows) // 2  # which differs, as a rule, so that no more need be compared
        if any(np.array_equal(rows[middle], past[middle]) and np.array_equal(rows, past) for past in self._past):
            return True
        room = self._past.popleft() if len(self._past) == BUFFERS else np.empty(rows.shape, np.uint8)
        np.copyto(room, rows)
        self._past.append(room)
        return False
