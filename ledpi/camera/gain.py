"""`analogue_gain: auto`: the sensor's gain follows how bright the panels are. Pure: frames in, gains out.

A panel must stay below full scale, where there are no bands, and well above the steps of an 8-bit picture. While none
is read the gain sweeps, as the one that shows the panels is not known; the room's brightness says nothing of theirs.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from ledpi.core.records import Floats, Frame
from ledpi.core.shutter import SATURATED, linear_light

FIRST_GAIN = 4.0  # a panel in a lit room at 10 ms, by order of magnitude; the sweep goes on from there
# Of full scale, in linear light, for a panel's brightest pixels, the crests of the bands among them. Half leaves room
# for a robot that comes closer; at a sixth the weaker class at 10 ms still has bands of 2 steps of an 8-bit picture.
WANTED_LEVEL = 0.5
LEVELS = (1 / 6, 0.75)  # within them the gain is left alone: each change costs two frames
BRIGHT_SHARE = 99  # percentile of a panel's pixels that stands for it: bright cells, without the odd pixel
SWEEP_TOP = 16.0  # above it there is more noise than light; the OV5647 then multiplies in numbers
SWEEP_STEP = 2.0
DWELL_S = 0.25  # at each step: 2 frames until it acts, 4 until a far panel is read, with room for 30 frames a second
FREEZE_S = 1.0  # a panel that was lost is waited for
_SAME_GAIN = 1 / 8  # a sensor's steps are at most 1/16 apart, and the sweep's 2


class GainControl:
    """One camera's gain. `update` is told of every decoded frame, in order."""

    def __init__(self, limits: tuple[float, float]) -> None:
        """`limits`: of the sensor, which was started with FIRST_GAIN."""
        self._least = limits[0]
        self._most = min(limits[1], SWEEP_TOP)
        self._asked = FIRST_GAIN
        self._seen_ns: int | None = None
        self._stepped_ns: int | None = None
        self.settled = False  # a panel is read, as bright as it should be, or as the sensor can make it

    def update(self, time_ns: int, gain: float | None, level: float | None) -> float | None:
        """The gain to ask for from now on, or None to leave it.

        `time_ns`, `gain`: of the frame. `level`: how bright its brightest panel is, 0..1 of full scale; None: none was
        read. A frame that was made with another gain than the one last asked for has no say in it: asking takes
        2 frames to act, and no second step is made before the first is seen.
        """
        if level is not None:
            self._seen_ns = time_ns
        if gain is None or abs(gain / self._asked - 1) > _SAME_GAIN:
            return None
        if level is not None:
            gain_wanted = self._follow(level)
            self.settled = gain_wanted is None
            return gain_wanted
        self.settled = False
        if self._seen_ns is not None and time_ns - self._seen_ns < FREEZE_S * 1e9:
            return None
        return self._sweep(time_ns)

    def _follow(self, level: float) -> float | None:
        self._stepped_ns = None
        if LEVELS[0] <= level <= LEVELS[1]:
            return None
        # At full scale the true level is not known; half is enough to see it with the next frame.
        factor = 1 / SWEEP_STEP if level >= 1 else WANTED_LEVEL / max(level, 1 / SATURATED)
        return self._ask(min(max(self._asked * factor, self._least), self._most))

    def _sweep(self, time_ns: int) -> float | None:
        if self._stepped_ns is None:
            self._stepped_ns = time_ns
        if time_ns - self._stepped_ns < DWELL_S * 1e9:
            return None
        self._stepped_ns = None  # the dwell begins with the first frame that has the new gain
        is_top = self._asked >= self._most * (1 - _SAME_GAIN)
        return self._ask(self._least if is_top else min(self._asked * SWEEP_STEP, self._most))

    def _ask(self, gain: float) -> float | None:
        if abs(gain / self._asked - 1) <= _SAME_GAIN:  # at its limit: nothing would change
            return None
        self._asked = gain
        return gain


def brightest_level(frame: Frame, quads_px: Sequence[Floats]) -> float | None:
    """Returns how bright the brightest panel is, in linear light, 0..1 of full scale. None without panels.

    `quads_px`: corners (4, 2) of each. 1.0 where the share that stands for a panel is saturated.
    """
    levels = [_bright_value(frame, corners) for corners in quads_px]
    if not levels:
        return None
    return float(linear_light(frame.transfer, mark_saturated=False)[int(max(levels))])


def _bright_value(frame: Frame, corners_px: Floats) -> float:
    height, width = frame.pixels.shape
    x0, y0 = np.clip(np.floor(corners_px.min(axis=0)).astype(int), 0, (width - 1, height - 1))
    x1, y1 = np.clip(np.ceil(corners_px.max(axis=0)).astype(int), (x0, y0), (width - 1, height - 1))
    inside = np.zeros((y1 - y0 + 1, x1 - x0 + 1), np.uint8)
    cv2.fillConvexPoly(inside, np.round(corners_px - (x0, y0)).astype(np.int32), 1)
    return float(np.percentile(frame.pixels[y0 : y1 + 1, x0 : x1 + 1][inside > 0], BRIGHT_SHARE))
