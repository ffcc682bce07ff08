"""The outlines of what is lit throughout in a black and white picture, as far as they may be a panel's."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from ledpi.kernels.library import COMPILED
from ledpi.kernels.outlines import OUTLINE, Outliner
from ledpi.records import Floats, Pixels

MAX_HOLE = 0.6  # length of a hole's outline over the outer one's; the walls between cells leave small ones
NARROWEST = 3  # pixels, across and down: less is a speck
SPOT_LENGTHS = (6, 64)  # outline of a bare LED: less is a speck, what is longer is shorter a level on
MIN_AREA = 0.25  # over that of the box around; a square's is at least 1/2


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
        """Those of at least `shortest` pixels in `lit` (0 or 255). They last until the next call."""
        if self._outliner is None:
            return _by_opencv(lit, shortest)
        return Outlined(
            *self._outliner.outlines(
                lit,
                shortest=shortest,
                narrowest=NARROWEST,
                longest_hole=MAX_HOLE,
                least_area=MIN_AREA,
                spot_lengths=SPOT_LENGTHS,
            )
        )


def _by_opencv(lit: Pixels, shortest: int) -> Outlined:
    # Every pixel of an outline, so that its number of points is its length and tells a speck at no cost.
    found, tree = cv2.findContours(lit, cv2.RETR_CCOMP, cv2.CHAIN_APPROX_NONE)
    chosen, table, at_border, first = [np.empty((0, 2), np.int32)], [], 0, 0
    for points, longest_hole in _filled(found, tree, shortest):
        x, y, width, height = cv2.boundingRect(points)
        if min(width, height) < NARROWEST:
            continue
        if x <= 0 or y <= 0 or x + width >= lit.shape[1] or y + height >= lit.shape[0]:
            at_border += 1
            continue
        area = cv2.contourArea(points)
        if area >= MIN_AREA * width * height:
            chosen.append(points[:, 0])
            table.append((first, len(points), x, y, x + width - 1, y + height - 1, longest_hole, area))
            first += len(points)
    outer = () if tree is None else (tree[0, :, 3] < 0).tolist()
    small = [o for o, own in zip(found, outer, strict=False) if own and SPOT_LENGTHS[0] <= len(o) < SPOT_LENGTHS[1]]
    boxes = np.array([cv2.boundingRect(points) for points in small], np.float64).reshape(-1, 4)
    lengths = np.array([len(points) for points in small], np.float64)
    spots = np.column_stack([boxes[:, :2] + 0.5 * (boxes[:, 2:] - 1), lengths])
    return Outlined(np.concatenate(chosen), np.array(table, OUTLINE), at_border, spots)


def _filled(
    found: Sequence[NDArray[np.int32]], tree: NDArray[np.int32] | None, shortest: int
) -> Iterator[tuple[NDArray[np.int32], int]]:
    """The outer outlines of what is lit throughout: a ring around something dark is what lies beside a dark bezel.

    `found` and `tree` as `cv2.findContours` gives them: a line of the tree holds next, previous, first hole, parent.
    """
    if tree is None:
        return
    links = tree[0].tolist()
    for outline, (_, _, hole, parent) in zip(found, links, strict=True):
        if parent >= 0 or len(outline) < shortest:
            continue
        longest = 0
        while hole >= 0:
            longest = max(longest, len(found[hole]))
            hole = links[hole][0]
        if longest < MAX_HOLE * len(outline):
            yield outline, longest
