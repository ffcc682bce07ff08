"""Pictures that a camera gives again, with a new time: what is old is never taken for what is seen now."""

from __future__ import annotations

import numpy as np

from ledpi.core.records import Frame, Pixels, Rejected

REPEATED = Rejected(stage="capture", reason="repeated")
# Every fourth row is compared: a panel that can be read crosses two of them at least, and noise never gives the same
# pixels again. Where nothing is lit pictures may be alike, and nothing is lost.
ROW_STEP = 4


class Repeats:
    """Tells whether a stream's picture is the one before, byte for byte."""

    def __init__(self) -> None:
        self._last: Pixels = np.empty((0, 0), np.uint8)

    def is_repeated(self, frame: Frame) -> bool:
        """Compares the picture with the last that was given here, and keeps its rows in that one's place."""
        rows = frame.pixels[::ROW_STEP]
        if rows.shape != self._last.shape:
            self._last = rows.copy()
            return False
        middle = len(rows) // 2  # which differs, as a rule, so that no more need be compared
        if np.array_equal(rows[middle], self._last[middle]) and np.array_equal(rows, self._last):
            return True
        np.copyto(self._last, rows)
        return False
