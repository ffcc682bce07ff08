"""The outlines of what is lit throughout in a black and white picture, as far as they may be a panel's.

The reference of kernels/outlines.c.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ledpi.records import Pixels

NARROWEST = 3  # pixels, across and down: less is a speck
MIN_AREA = 0.25  # over that of the box around; a square's is at least 1/2
# Of the pixels within an outline. The walls between cells leave some dark; of a ring, which is what lies beside a dark
# bezel, more than a third are.
MIN_LIT = 0.64


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """Around one thing."""

    points: NDArray[np.int32]  # (P, 2) x, y of every pixel on it
    area: float


def outlines_in(lit: Pixels, shortest: int) -> tuple[list[Outline], int]:
    """Those in `lit` (0 or 255) of things whose boxes are `shortest` around, at least.

    And how many touch the picture's border.
    """
    _, things, boxes, _ = cv2.connectedComponentsWithStats(lit, connectivity=8)
    outlines, at_border = [], 0
    for number, (x, y, width, height, pixels) in enumerate(boxes[1:].tolist(), 1):
        around, right, bottom = 2 * (width + height) - 4, x + width - 1, y + height - 1
        wanted = around >= shortest and min(width, height) >= NARROWEST
        if x <= 0 or y <= 0 or right + 1 >= lit.shape[1] or bottom + 1 >= lit.shape[0]:
            at_border += wanted
            continue
        if not wanted:
            continue
        own = (things[y : bottom + 1, x : right + 1] == number).astype(np.uint8)
        ((points, *_), _) = cv2.findContours(own, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE, offset=(x, y))
        area = cv2.contourArea(points)
        within = area + 0.5 * len(points) + 1  # pixels, by Pick's theorem
        if area >= MIN_AREA * width * height and pixels >= MIN_LIT * within:
            outlines.append(Outline(points[:, 0], area))
    return outlines, at_border
