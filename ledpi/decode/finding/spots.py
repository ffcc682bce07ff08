"""Panels without a diffuser: as many bright spots as cells, in a lattice, with little light between.

No square is lit there for `find` to see, or one that ends where the outermost spots do. The spots' centres are the
cells', so the homography through all of them says where the corners of the grid are: half a pitch beyond the outermost.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from ledpi.decode.finding.four_sides import in_order
from ledpi.decode.finding.lit import threshold_of
from ledpi.geometry import apply_homography, square_box
from ledpi.records import Floats, Mask, Pixels

# Of a spot's brightness in the picture, what is two pixels around it has on average: half of its light, as sRGB has it.
# At one of the pyramid's levels, where the pitch is 4 to 8.5 pixels, that is half-way to the next spot or beyond: there
# LEDs of a sixth of the pitch (a deviation) leave 0.6 to 0.74, blur included; cells behind a diffuser, 0.81 and more.
MAX_AROUND = 0.75
AROUND_PX = 2
LINK = 1.6  # times the distance to the nearest: neighbours along a lattice's other axis, seen up to 50° from the side
LIKE = 2.0  # as many times as far above the darkest around a spot may be
MOST_MORE = 1.3  # times as many may be linked to each other as there are cells
MAX_SPOTS = 200  # that are looked at: more is texture
OFF_LATTICE = 0.25  # of a pitch: spots further off are none of a lattice


def group_sizes(cells: int) -> range:
    """How many spots a group may have in which there may be a lattice of `cells` × `cells`, with specks beside it."""
    return range(cells * cells, math.ceil(MOST_MORE * cells * cells))


def spots_in(picture: Pixels, above: Pixels, contrast: Pixels, share: int) -> Floats:
    """(M, 3) x and y of pixels that are lit by `share`, as bright as any beside them, and brighter than what is around.

    Third, how far they are above the darkest. Of pixels side by side that are alike the first. The reference of
    kernels/spots.c.
    """
    height, width = picture.shape
    reach, sides = AROUND_PX, range(-AROUND_PX, AROUND_PX + 1)
    if height <= 2 * reach or width <= 2 * reach:
        return np.empty((0, 3))
    values = picture.astype(np.int32)
    at = {(y, x): values[reach + y : height - reach + y, reach + x : width - reach + x] for y in sides for x in sides}
    own, inside = at[0, 0], (slice(reach, height - reach), slice(reach, width - reach))
    beside = [place for place in at if place != (0, 0) and max(map(abs, place)) == 1]
    around = [place for place in at if max(map(abs, place)) == reach]
    top = above[inside] > threshold_of(share, contrast[inside])
    for place in beside:
        top &= own > at[place] if place < (0, 0) else own >= at[place]
    top &= sum(at[place] for place in around) < MAX_AROUND * len(around) * own
    y, x = np.nonzero(top)
    return np.column_stack([x + reach, y + reach, above[inside][y, x]]).astype(np.float64)


def groups(spots: Floats, sizes: range) -> list[Floats]:
    """Of spots (M, 3) as `spots_in` has them those that are alike and neighbours, as many together as `sizes` has.

    The reference of kernels/spots.c.
    """
    if not sizes.start <= len(spots) <= MAX_SPOTS:
        return []
    points, height = spots[:, :2], spots[:, 2]
    apart = np.hypot(*(points[:, None] - points).transpose(2, 0, 1))
    np.fill_diagonal(apart, np.inf)
    alike = np.maximum(height[:, None], height) < LIKE * np.minimum(height[:, None], height)
    nearest = np.where(alike, apart, np.inf).min(axis=1)
    linked = alike & (apart < LINK * np.minimum(nearest[:, None], nearest))
    return [spots[sorted(group)] for group in _linked(linked) if len(group) in sizes]


def lattice(group: Floats, cells: int) -> Floats | None:
    """Corners (4, 2) of the grid of `cells` × `cells`, roughly, whose middles a group's spots are; None for none."""
    odd = np.abs(group[:, 2] - np.median(group[:, 2]))
    return _corners(group[np.argsort(odd, kind="stable")[: cells * cells], :2], cells)


def _linked(linked: Mask) -> list[list[int]]:
    """Of what is linked to each other, in one way or another."""
    others = [np.flatnonzero(row).tolist() for row in linked]
    seen: set[int] = set()
    found = []
    for start in range(len(others)):
        if start not in seen:
            seen.add(start)
            group = [start]
            for member in group:
                fresh = [other for other in others[member] if other not in seen]
                seen.update(fresh)
                group += fresh
            found.append(group)
    return found


def _corners(points: Floats, cells: int) -> Floats | None:
    """Of the grid whose cells' middles these `points` (cells², 2) are; None where they are no lattice."""
    hull = cv2.convexHull(points.astype(np.float32))
    for tolerance in (0.02, 0.04, 0.06, 0.08):
        outer = cv2.approxPolyDP(hull, tolerance * cv2.arcLength(hull, True), True)[:, 0]
        if len(outer) <= 4:
            break
    if len(outer) != 4:
        return None
    last = cells - 1
    to_grid = cv2.getPerspectiveTransform(outer.astype(np.float32), square_box(0, last).astype(np.float32))
    at = apply_homography(to_grid, points)
    whole = np.round(at)
    if np.abs(at - whole).max() > OFF_LATTICE or len(np.unique(whole, axis=0)) != len(points):
        return None
    if whole.min() < 0 or whole.max() > last:
        return None
    return _outer(whole, points, cells)


def _outer(grid: Floats, points: Floats, cells: int) -> Floats | None:
    """The corners (4, 2), clockwise in the picture, of the grid of which `grid` (N, 2) is at `points`."""
    homography, _ = cv2.findHomography(grid.astype(np.float64), points.astype(np.float64))
    if homography is None:
        return None
    corners = apply_homography(homography, rim_of(cells))
    return np.array(in_order(corners.tolist()))


def rim_of(cells: int) -> Floats:
    """(4, 2) corners of the grid, in pitches from the middle of its first cell."""
    return square_box(-0.5, cells - 0.5)
