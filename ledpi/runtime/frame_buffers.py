"""Memory for pictures, asked for once: each frame that is kept has a room there until it is given back."""

from __future__ import annotations

import threading
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ledpi.core.records import Decoded, Frame


class KeptFrame(NamedTuple):
    """A frame of the past."""

    slot: int  # where its picture is
    frame: Frame  # without its picture
    decoded: Decoded
    search_budget: int
    side_bytes: int  # that all of this takes, beside the picture


class FrameBuffers:
    """`frames` rooms of H × W bytes. What keeps frames in them is derived from it; any thread may give one back."""

    def __init__(self, frames: int, height: int, width: int) -> None:
        self.frames = frames
        self.seen = 0  # frames that came
        self._pictures = np.empty((frames, height, width), np.uint8)  # the system gives it as it is first written
        self._changing = threading.Lock()
        self._free = list(range(frames))  # the last one is taken first: it was written before

    def picture_of(self, kept: KeptFrame) -> Frame:
        """The frame with its picture, until that is given back."""
        return replace(kept.frame, pixels=self._pictures[kept.slot].view())

    def give_back(self, kept: KeptFrame) -> None:
        """What was taken is written."""
        with self._changing:
            self._free.append(kept.slot)

    @property
    def room(self) -> int:
        """How many pictures fit before there is no free room."""
        with self._changing:
            return len(self._free)


def follows(new: Frame, old: Frame) -> bool:
    """Whether a recording may hold both, one after the other."""
    return new.seq > old.seq and new.row0_readout_ns > old.row0_readout_ns
