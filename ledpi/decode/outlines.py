"""The outlines of what is lit throughout in a black and white picture, as far as they may be a panel's."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ledpi.kernels.library import COMPILED
from ledpi.kernels.outlines import OUTLINE, Outliner
from ledpi.records import Floats, Pixels

NARROWEST = 3  # pixels, across and down: less is a speck
SPOT_LENGTHS = range(6, 64)  # around the box of a bare LED: less is a speck, what is longer is shorter a level on
MIN_AREA = 0.25  # over that of the box around; a square's is at least 1/2
# Of the pixels within an outline. The walls between cells leave some dark; of a ring, which is what lies beside a dark
# bezel, more than a third are.
MIN_LIT = 0.64


@dataclass(frozen=True, slots=True, eq=False)
class Outlined:
    """What is lit in one picture."""

    points: NDArray[np.int32]  # (P, 2) x, y of every pixel on an outline, one outline after the other
    outlines: NDArray[Any]  # (N,) of OUTLINE: which points each has, its box, and its area
    at_border: int  # how many besides touch the picture's border
    spots: Floats  # (M, 3) of each spot the middle's x and y, and the outline's length


class Outlines:
    """Finds them in pictures of one size, in room that it keeps."""

    def __init__(self, height: int, width: int, *, compiled: bool = COMPILED) -> None:
        self._outliner = Outliner(height, width) if compiled else None

    def of(self, lit: Pixels, shortest: int) -> Outlined:
        """Those in `lit` (0 or 255) of things whose boxes are `shortest` around, at least; until the next call."""
        if self._outliner is None:
            return _by_opencv(lit, shortest)
        return Outlined(
            *self._outliner.outlines(
                lit,
                shortest=shortest,
                narrowest=NARROWEST,
                least_area=MIN_AREA,
                least_lit=MIN_LIT,
                spot_lengths=(SPOT_LENGTHS.start, SPOT_LENGTHS.stop),
            )
        )


def _by_opencv(lit: Pixels, shortest: int) -> Outlined:
    _, things, boxes, _ = cv2.connectedComponentsWithStats(lit, connectivity=8)
    chosen, table, spots, at_border, first = [np.empty((0, 2), np.int32)], [], [], 0, 0
    for number, (x, y, width, height, pixels) in enumerate(boxes[1:].tolist(), 1):
        around, right, bottom = 2 * (width + height) - 4, x + width - 1, y + height - 1
        wanted, small = around >= shortest and min(width, height) >= NARROWEST, around in SPOT_LENGTHS
        if x <= 0 or y <= 0 or right + 1 >= lit.shape[1] or bottom + 1 >= lit.shape[0]:
            at_border += wanted
            continue
        own = (things[y : bottom + 1, x : right + 1] == number).astype(np.uint8)
        ((points, *_), _) = cv2.findContours(own, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE, offset=(x, y))
        if small:
            spots.append((0.5 * (x + right), 0.5 * (y + bottom), len(points)))
        area = cv2.contourArea(points)
        within = area + 0.5 * len(points) + 1  # pixels, by Pick's theorem
        if wanted and area >= MIN_AREA * width * height and pixels >= MIN_LIT * within:
            chosen.append(points[:, 0])
            table.append((first, len(points), x, y, right, bottom, area))
            first += len(points)
    return Outlined(np.concatenate(chosen), np.array(table, OUTLINE), at_border, np.array(spots).reshape(-1, 3))
