"""Memory for pictures, asked for once: each frame that is kept has a room there until it is given back."""

from __future__ import annotations

import threading
from abc import ABC, abstractmethod
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ledpi.core.records import Decoded, Frame

# Of what was decoded, as Python holds it; a little more than it is.
_MARKER_BYTES, _FRAME_BYTES, _LINE_BYTES = 4096, 2048, 320


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
