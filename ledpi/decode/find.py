"""Finds lit, four-sided things in a picture: everything that may be a panel, roughly placed.

A panel is brighter than what is next to it. A pixel is "lit" where it is nearer to the brightest than to the darkest
within a small window around it (Bernsen's threshold), so that every bright thing gets a dark moat, however bright
the room is further away. On a picture shrunk far enough the cells of a panel melt into one, so this is done on a
pyramid.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from ledpi.decode.outlines import Outline, Outlines
from ledpi.decode.spots import lattices
from ledpi.kernels import outlines as kernel
from ledpi.kernels.library import COMPILED
from ledpi.records import Floats, Frame, Pixels, Rejected

TOO_SMALL = Rejected(stage="find", reason="too_small")
NOT_FOUR_SIDED = Rejected(stage="find", reason="not_four_sided")
AT_BORDER = Rejected(stage="find", reason="at_picture_border")

LEVELS = 3  # halvings; the cells of a panel that fills the picture's height melt together at an eighth
THRESHOLDS = ((0.5,), (0.5, 0.7), (0.6,))  # by level: share of the way from the darkest to the brightest
WINDOW = 13  # pixels of the level
MIN_CONTRAST = 16  # grey levels from the darkest in the window: less is noise and texture
# Shortest outline by level, in its pixels: of the smallest panel in scope, foreshortened by 60°; then of what the level
# before sees better.
SHORTEST = (10, 24, 24)
MAX_MISFIT = 0.15  # logarithm of the four sides' area over the outline's
PIXEL_MISFIT = 0.6  # allowed on top, over the side in pixels: steps of whole pixels make small outlines ragged
MIN_SIDE = 0.3  # shortest side over the root of the area; that of a panel turned by 80° is 0.4
MAX_CUT_OFF = 0.05  # of the area: what a dead cell at a corner takes of the outline's hull is half of 1/16
BLUR_MISFIT = 0.002  # by how much a coarser outline, a pixel less certain, must fit better to be preferred
MIN_SOLIDITY = 0.8  # area over that of the convex hull
SAME_CORNERS = 0.25  # of the side: of outlines in one place, what is no further off is the same
SLENDER = 0.85  # area over that of the square of the same outline, below which corners are where sides cross


Corners = list[list[float]]  # four of x, y; numbers by numbers, as arrays this small only cost


@dataclass(frozen=True, slots=True)
class Candidate:
    """Where a panel may be."""

    corners: Floats  # (4, 2), clockwise as seen in the picture, first the one nearest the top left
    side_px: float
    misfit: float  # of the outline to the four sides, 0 is perfect
    tolerance_px: float  # how far off the sides may be: 1.5 pixels of the picture that they were found in
    spots: bool = False  # a lattice of bright spots, the grid of whose cells this is

    @property
    def centre_px(self) -> tuple[float, float]:
        """Mean of the corners."""
        x, y = (0.25 * self.corners.sum(axis=0)).tolist()
        return x, y


class Finder:
    """Keeps the pictures it works on, for frames of one size."""

    def __init__(self, width: int, height: int, smallest_px: float, cells: int = 4) -> None:
        """`smallest_px`: side of the smallest panel that can be read. `cells`: along a side."""
        self._cells = cells
        self._smallest_px = smallest_px
        sizes = [(max(1, height >> level), max(1, width >> level)) for level in range(1, LEVELS + 1)]
        self._levels = [np.empty(size, np.uint8) for size in sizes]
        self._work = [tuple(np.empty(size, np.uint8) for _ in range(4)) for size in sizes]
        self._outlines = [Outlines(*size) for size in sizes]
        self._window = np.ones((WINDOW, WINDOW), np.uint8)
        self._melt = np.ones((3, 3), np.uint8)
        # Finding compares neighbours only; a square root gives dark linear pictures the contrast they need.
        self._brighten = np.round(255 * np.sqrt(np.arange(256) / 255)).astype(np.uint8)

    def find(self, frame: Frame) -> tuple[list[Candidate], list[Rejected]]:
        """Candidates, best outline first, no two of the same thing, lattices of spots last; and what was dropped."""
        found: list[Candidate] = []
        grids: list[Candidate] = []
        dropped: list[Rejected] = []
        above: Pixels = frame.pixels
        for index, picture in enumerate(self._levels):
            cv2.resize(above, (picture.shape[1], picture.shape[0]), dst=picture, interpolation=cv2.INTER_AREA)
            if index == 0 and frame.transfer == "linear":
                cv2.LUT(picture, self._brighten, dst=picture)
            above = picture
            for lit in self._lit(index):
                outlines, at_border, spots = self._outlines[index].of(lit, SHORTEST[index])
                grids += [_grid(corners, 2 << index) for corners in lattices(spots, self._cells)]
                dropped.extend([AT_BORDER] * at_border)
                for outline in outlines:
                    result = _candidate(outline, 2 << index)
                    if isinstance(result, Rejected):
                        dropped.append(result)
                    elif result.side_px < self._smallest_px:
                        dropped.append(TOO_SMALL)
                    else:
                        found.append(result)
        return _distinct(found) + _distinct(grids), dropped

    def _lit(self, index: int) -> Iterator[Pixels]:
        """What is lit at one level, 0 or 255, by each threshold; each until the next is asked for."""
        picture = self._levels[index]
        brightest, darkest, threshold, lit = self._work[index]
        cv2.dilate(picture, self._window, dst=brightest)
        cv2.erode(picture, self._window, dst=darkest)
        for share in THRESHOLDS[index]:
            cv2.addWeighted(brightest, share, darkest, 1.0 - share, 0.0, dst=threshold)
            cv2.max(threshold, cv2.add(darkest, MIN_CONTRAST), dst=threshold)
            cv2.compare(picture, threshold, cv2.CMP_GT, dst=lit)
            cv2.morphologyEx(lit, cv2.MORPH_CLOSE, self._melt, dst=lit)
            if index:  # thin bridges to the surroundings, which the closing has made
                cv2.morphologyEx(lit, cv2.MORPH_OPEN, self._melt, dst=lit)
            yield lit


def _grid(corners: Floats, scale: int) -> Candidate:
    """Of a lattice of spots, in pixels that are `scale` of the picture's."""
    in_picture = (corners + 0.5) * scale - 0.5
    side_px = math.sqrt(0.5 * abs(_twice_area(in_picture.tolist())))
    return Candidate(corners=in_picture, side_px=side_px, misfit=0.0, tolerance_px=0.5 * scale, spots=True)


def _candidate(outline: Outline, scale: int) -> Candidate | Rejected:
    """A candidate, or why it is none."""
    area = outline.area
    hull = cv2.convexHull(outline.points)
    if area < MIN_SOLIDITY * cv2.contourArea(hull):
        return NOT_FOUR_SIDED
    corners = _four_sides(hull, math.sqrt(area))
    if corners is None:
        return NOT_FOUR_SIDED
    quad_area = 0.5 * abs(_twice_area(corners))
    misfit = abs(math.log(max(quad_area, 1e-3) / area))
    if misfit > MAX_MISFIT + PIXEL_MISFIT / math.sqrt(area):
        return NOT_FOUR_SIDED
    if area < SLENDER * (0.25 * sum(math.dist(corners[k], corners[k - 1]) for k in range(4))) ** 2:
        corners = _through_sides(corners, outline.points)
        quad_area = 0.5 * abs(_twice_area(corners))
    # An outline runs through the centres of the outermost lit pixels: half a pixel inside the edge.
    growth = 1.0 + 1.0 / max(2.0, math.sqrt(quad_area))
    middle_x, middle_y = (0.25 * sum(corner[axis] for corner in corners) for axis in (0, 1))
    grown = [[middle_x + (x - middle_x) * growth, middle_y + (y - middle_y) * growth] for x, y in corners]
    return Candidate(
        corners=(_clockwise(grown) + 0.5) * scale - 0.5,
        side_px=(math.sqrt(quad_area) + 1.0) * scale,
        misfit=misfit,
        tolerance_px=1.5 * scale,
    )


def _four_sides(hull: Pixels, size: float) -> Corners | None:
    """The corners of the four-sided polygon nearest to the hull: ever coarser, else the smallest box around it."""
    for tolerance in (0.1, 0.15, 0.2, 0.3, 0.4):
        polygon = cv2.approxPolyDP(hull, tolerance * size, True)
        if len(polygon) == 5:
            corners = _with_corner(polygon[:, 0].tolist(), size)
            if corners is not None:
                return corners
        if len(polygon) <= 4:
            break
    if len(polygon) == 4:
        corners = polygon[:, 0].tolist()
        shortest = min(math.dist(corners[k], corners[k - 1]) for k in range(4))
        # With a side this short it is a triangle with a corner cut off.
        return corners if shortest > MIN_SIDE * size else None
    box: Corners = cv2.boxPoints(cv2.minAreaRect(hull)).tolist()
    return box


def _with_corner(five: Corners, size: float) -> Corners | None:
    """The quad of a pentagon whose one side cuts off its corner, dead or hidden; None where no side does."""
    best, least = None, MAX_CUT_OFF * size * size
    for k in range(5):
        (ax, ay), (bx, by), (cx, cy), (dx, dy) = (five[(k + i) % 5] for i in range(4))  # bc is to go: ab and dc meet
        turn = (bx - ax) * (cy - dy) - (by - ay) * (cx - dx)
        if abs(turn) < 1e-9:
            continue
        share = ((dx - ax) * (cy - dy) - (dy - ay) * (cx - dx)) / turn
        x, y = ax + share * (bx - ax), ay + share * (by - ay)
        added = 0.5 * abs((bx - x) * (cy - y) - (by - y) * (cx - x))
        # Beyond b and beyond c, else they meet on the other side.
        beyond = share > 1 and (x - cx) * (cx - dx) + (y - cy) * (cy - dy) > 0
        if beyond and added < least:
            best, least = [[x, y], five[(k + 3) % 5], five[(k + 4) % 5], five[k]], added
    if best is None or min(math.dist(best[k], best[k - 1]) for k in range(4)) < MIN_SIDE * size:
        return None
    return best


def _through_sides(corners: Corners, outline: NDArray[np.int32], *, compiled: bool = COMPILED) -> Corners:
    """Where straight lines through each side's part of the outline cross; `corners` where they do not.

    Of a slender shape the outline's own corners are blunt, and may lie far inside.
    """
    if compiled:
        return kernel.through_sides(corners, outline)
    start = np.array(corners, np.float64)
    along = np.roll(start, -1, axis=0) - start
    length = np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-9)
    along /= length[:, None]
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    points = outline[:, 0] - start[:, None]  # (4, P, 2)
    t, d = (points @ along[:, :, None])[..., 0], (points @ across[:, :, None])[..., 0]
    own = np.abs(d) == np.abs(d).min(axis=0)
    w = (own & (t > 0.15 * length[:, None]) & (t < 0.85 * length[:, None])).astype(float)
    count = np.maximum(w.sum(axis=1), 1e-9)
    t0, d0 = (w * t).sum(axis=1) / count, (w * d).sum(axis=1) / count
    off = t - t0[:, None]
    slope = (w * off * d).sum(axis=1) / np.maximum((w * off * off).sum(axis=1), 1e-9)
    on = start + along * t0[:, None] + across * d0[:, None]
    way = along + across * slope[:, None]
    before, way_before = np.roll(on, 1, axis=0), np.roll(way, 1, axis=0)
    turn = way_before[:, 0] * way[:, 1] - way_before[:, 1] * way[:, 0]
    gap = on - before
    if (count < 3).any() or (np.abs(turn) < 0.05).any():
        return corners
    share = (gap[:, 0] * way[:, 1] - gap[:, 1] * way[:, 0]) / turn
    crossings: Corners = (before + way_before * share[:, None]).tolist()
    return crossings


def _twice_area(corners: Corners) -> float:
    """Positive where the corners run clockwise in the picture."""
    (x0, y0), (x1, y1), (x2, y2), (x3, y3) = corners
    return (x2 - x0) * (y3 - y1) - (x3 - x1) * (y2 - y0)


def _clockwise(corners: Corners) -> Floats:
    """(4, 2) clockwise as seen in the picture, first the corner nearest the top left."""
    order = [0, 1, 2, 3] if _twice_area(corners) > 0 else [3, 2, 1, 0]
    nearest = min(range(4), key=lambda i: sum(corners[order[i]]))
    return np.array([corners[i] for i in order[nearest:] + order[:nearest]], np.float64)


def _farthest(corners: Floats, others: Floats) -> float:
    """From a corner of one quad to the nearest of the other, at most."""
    pairs: list[Corners] = [corners.tolist(), others.tolist()]
    return max(min(math.dist(a, b) for b in pairs[1]) for a in pairs[0])


def _distinct(found: list[Candidate]) -> list[Candidate]:
    """One candidate of each thing, the one whose outline fits best."""
    kept: list[tuple[float, float, Candidate]] = []
    for candidate in sorted(found, key=lambda c: c.misfit + BLUR_MISFIT * c.tolerance_px):
        x, y = candidate.centre_px
        for other_x, other_y, other in kept:
            larger, smaller = max(candidate.side_px, other.side_px), min(candidate.side_px, other.side_px)
            near = math.hypot(x - other_x, y - other_y) < 0.25 * larger and smaller > 0.7 * larger
            if near and _farthest(candidate.corners, other.corners) < SAME_CORNERS * larger:
                break
        else:
            kept.append((x, y, candidate))
    return [candidate for _, _, candidate in kept]
