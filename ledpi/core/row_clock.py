"""The row time that the frames' own times tell, where the driver reports another.

A sensor's frame is a whole number of rows, blanking included, so row time = frame interval / rows of a frame. A driver
that believes in another pixel clock misreports the row time, and with it the exposure, which is a whole number of rows
too; the frames' intervals it cannot bend.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from statistics import median
from typing import TypeVar

from ledpi.core.records import CameraInfo, Frame

Exposed = TypeVar("Exposed", CameraInfo, Frame)

INTERVALS = 64  # the latest that are remembered
MIN_INTERVALS = 3
# Drivers have been off by 6 %. What is further off is a gap, or a period that does not follow from the rows.
MAX_RATIO = 1.1
# Within 1 % the report is believed: whole microseconds of rounding, and no band moves by a tenth of its cycle within
# a panel for less.
MIN_DEVIATION = 0.01
SIGNIFICANT_SIGMA = 5.0  # standard errors that a deviation must have, where times are taken by a busy computer
# Three intervals that are off by much may agree to a hair by chance: of fewer than so many, the one that is furthest
# from their middle says how well they are known.
MIN_FOR_MEDIAN = 8


class RowClock:
    """Takes in when frames were read out; says by how much their rows are slower than reported."""

    def __init__(self, camera: CameraInfo) -> None:
        self._reported_ns = None
        if camera.frame_length_rows is not None:
            self._reported_ns = camera.frame_length_rows * camera.row_time_us * 1e3
        self._ratios: deque[float] = deque(maxlen=INTERVALS)
        self._last: tuple[int, int] | None = None
        self.ratio = 1.0  # true row time over the reported one; 1 unless the frames surely say otherwise

    def add(self, seq: int, row0_readout_ns: int) -> None:
        """The next frame. Gaps in `seq` and jumps in time are legal, and left out."""
        if self._reported_ns is not None and self._last is not None and seq > self._last[0]:
            ratio = (row0_readout_ns - self._last[1]) / (seq - self._last[0]) / self._reported_ns
            if 1 / MAX_RATIO < ratio < MAX_RATIO:
                self._ratios.append(ratio)
                self.ratio = self._significant_ratio()
        self._last = seq, row0_readout_ns

    def _significant_ratio(self) -> float:
        if len(self._ratios) < MIN_INTERVALS:
            return 1.0
        middle = median(self._ratios)
        away = [abs(ratio - middle) for ratio in self._ratios]
        # Of a median of n normal values: 1.25·σ/√n, σ = 1.48 times the median distance from it.
        sigma = max(away) if len(away) < MIN_FOR_MEDIAN else 1.48 * median(away)
        error = 1.25 * sigma / math.sqrt(len(away))
        off = abs(middle - 1.0)
        return middle if off > max(MIN_DEVIATION, SIGNIFICANT_SIGMA * error) else 1.0

    def corrected(self, exposed: Exposed) -> Exposed:
        """A frame, or all of a camera's, with its true row time and exposure."""
        if self.ratio == 1.0:
            return exposed
        row_time_us, exposure_us = exposed.row_time_us * self.ratio, exposed.exposure_us * self.ratio
        return replace(exposed, row_time_us=row_time_us, exposure_us=exposure_us)


def row_time_note(row_time_us: float, ratio: float) -> str:
    """Says what to tell the user where `row_time_us` is `ratio` times the reported one."""
    return (
        f"the frames' times say that a row takes {row_time_us:.2f} µs, not {row_time_us / ratio:.2f} µs as reported; "
        "row time and exposure are corrected"
    )
