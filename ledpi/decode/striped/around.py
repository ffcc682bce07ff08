"""Four-sided figures around the convex outlines of squares whose corners may be cut off."""

from __future__ import annotations

import math
from functools import cache
from itertools import combinations

import cv2
import numpy as np

from ledpi.decode.corners.sides import Points, as_corners, as_points, cross
from ledpi.kernels import around as kernel
from ledpi.kernels.library import compiled
from ledpi.records import Floats, Integers, Pixels

MAX_OUTLINE = 12  # corners of an outline, of which four sides are chosen
OUTLINE_PX = 1.0  # by which an outline with few corners may be off, at first
LEAST_TURN = 0.05  # sine of the angle between neighbouring sides
MOST_WAYS, ALIKE = 2, math.cos(4 * math.radians(10))  # of rectangles; sides 10° apart run the same way


def few_corners(hull: Pixels) -> Floats:
    """(K, 2) the hull's corners, or fewer that are close to it."""
    tolerance = OUTLINE_PX
    few = cv2.approxPolyDP(hull, tolerance, True)
    while len(few) > MAX_OUTLINE:
        tolerance *= 1.5
        few = cv2.approxPolyDP(hull, tolerance, True)
    corners: Floats = few[:, 0].astype(np.float64)
    return corners


def smallest_square_around(outline: Floats) -> Floats | None:
    """(4, 2) corners of the smallest quadrilateral on four sides of a convex outline (K, 2), first nearest the origin.

    Clockwise in the picture, as the outline. A square with a corner cut off is that square again: no other side can be
    left out at the cost of so little.
    """
    if len(outline) < 4:
        return None
    start = np.ascontiguousarray(outline).view(np.complex128)[:, 0]
    if float((start[:-1].conj() * start[1:]).imag.sum() + (start[-1].conj() * start[0]).imag) < 0:
        start = start[::-1]
    best = kernel.smallest_square(start) if compiled() else _smallest(start)
    return None if best is None else as_corners(np.roll(best, -int((best.real + best.imag).argmin())))


def _smallest(start: Points) -> Points | None:
    """`kernel.smallest_square`, in numpy: of all ways of choosing four sides."""
    along = np.roll(start, -1) - start
    chosen = _fours(len(start))
    on, way = start[chosen], along[chosen]
    onward, next_way = np.roll(on, -1, axis=1), np.roll(way, -1, axis=1)
    turn = cross(way, next_way)
    convex = (turn > LEAST_TURN * np.abs(way) * np.abs(next_way)).all(axis=1)
    if not convex.any():
        return None
    corners = on[convex] + way[convex] * (cross(onward - on, next_way)[convex] / turn[convex])
    areas = 0.5 * cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
    smallest: Points = corners[np.where(areas > 0, areas, np.inf).argmin()]
    return smallest


@cache
def _fours(count: int) -> Integers:
    """(…, 4) all ways of choosing four of `count`, in order."""
    return np.array(list(combinations(range(count), 4)))


def rectangles_around(outline: Floats) -> list[Floats]:
    """(4, 2) corners of the rectangles around a convex outline (K, 2) that lie along its longest sides: MOST_WAYS.

    Sides count together that run the same way or across it.
    """
    points = as_points(outline)
    along = np.roll(points, -1) - points
    length = np.abs(along)
    fourfold = (along / np.maximum(length, 1e-9)) ** 4  # the same for a side and one across it
    rectangles: list[Floats] = []
    left = length.copy()
    for _ in range(MOST_WAYS):
        alike = np.asarray((fourfold.conj() * fourfold[int(left.argmax())]).real > ALIKE)
        way = complex((left * alike * fourfold).sum()) ** 0.25
        if not abs(way) > 0:
            break
        turned = points / (way / abs(way))
        (x0, x1), (y0, y1) = ((w.min(), w.max()) for w in (turned.real, turned.imag))
        corners = np.array([x0 + 1j * y0, x1 + 1j * y0, x1 + 1j * y1, x0 + 1j * y1]) * (way / abs(way))
        rectangles.append(as_corners(np.roll(corners, -int((corners.real + corners.imag).argmin()))))
        left = np.where(alike, 0.0, left)
    return rectangles
