"""A frame's picture, and the same in halves, quarters and eighths, in room that is kept."""

from __future__ import annotations

import cv2
import numpy as np

from ledpi.core.records import Frame, Pixels

LEVELS = 3  # halvings; the cells of a panel that fills the picture's height melt together at an eighth
# Finding compares neighbours only; a square root gives dark linear pictures the contrast they need.
_BRIGHTEN = np.round(255 * np.sqrt(np.arange(256) / 255)).astype(np.uint8)


class Pyramid:
    """Pictures of frames of one size, each smaller than the last."""

    def __init__(self, height: int, width: int) -> None:
        self.smaller: list[Pixels] = [
            np.empty((max(1, height >> halvings), max(1, width >> halvings)), np.uint8)
            for halvings in range(1, LEVELS + 1)
        ]

    def of(self, frame: Frame) -> list[Pixels]:
        """The frame's picture, and smaller ones; until the next."""
        above: Pixels = frame.pixels
        for picture in self.smaller:
            cv2.resize(above, picture.shape[::-1], dst=picture, interpolation=cv2.INTER_AREA)
            if above is frame.pixels and frame.transfer == "linear":
                cv2.LUT(picture, _BRIGHTEN, dst=picture)
            above = picture
        return [frame.pixels, *self.smaller]
