"""Panels whose outline melts into something bright beside them: by the places where four of their cells meet.

Walls cross there, and without any the cells' corners are darkest: light has a minimum at each of (cells − 1)² places,
all within the panel, whatever touches it. The homography through them says where the grid's corners are.
"""

from __future__ import annotations

from functools import cache
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from ledpi.decode.finding.four_sides import in_order
from ledpi.geometry import apply_homography, square_box
from ledpi.kernels import crossings as kernel
from ledpi.kernels.library import compiled
from ledpi.records import Floats, Pixels

# Places (M, 2); of those in the middle of a lattice's nine which they are (S,), and the steps (S, 2, 2) along its axes.
Crosses: TypeAlias = tuple[Floats, NDArray[np.intp], Floats]

LEAST_CELLS = 4  # a side: of fewer there are not enough places to be sure of a lattice
# Share by which codes are lower there than two pixels around. On the pyramid's level where a pitch is 4 to 9 pixels,
# walls of 6 % of it leave 0.1 to 0.17, at 3 m 0.06; noise 0.02.
DEPTH = 0.05
AROUND_PX = 2
LEAST_AROUND = 16.0  # codes
MARGIN_PX = 3  # to a picture's border, within which nothing is known around
MOST_PLACES = 800  # in a picture; more is texture, and left out from the bottom
NEAREST = 8  # places that may be neighbours of one
# A pitch: twice what the next level sees well, where walls may be thinner than a pixel, and places a pixel off.
NEAREST_PX, FARTHEST_PX = 2.5, 18.0
OPPOSITE = 0.25  # of the shorter of two ways from a place: how far off straight on they may be
ACROSS = 0.4  # sine of the least angle between a lattice's axes
OFF_LATTICE = 0.2  # of a pitch
LIKE = 3.0  # as many times as deep may neighbours be
MISSING = 1  # places of a grid
MOST_GRIDS = 24  # in a picture; more is a pattern, of which any part looks like a panel
_STEPS = np.array([-1, 0, 1])
_UNIMODULAR = [[[1, 0], [0, 1]], [[1, 0], [1, 1]], [[1, 0], [-1, 1]], [[0, 1], [1, 1]], [[0, 1], [-1, 1]]]


def grids_in(picture: Pixels, cells: int) -> list[Floats]:
    """Corners (4, 2), clockwise in the picture, of grids of `cells` × `cells` whose cells seem to meet in a picture."""
    if cells < LEAST_CELLS:
        return []
    if not compiled():
        return lattice_grids(*crosses_in(picture), cells)
    crosses = kernel.crosses(picture)
    return list(kernel.grids(*crosses, cells)) if cells <= kernel.MOST_SIDE else lattice_grids(*crosses, cells)


def lattice_grids(points: Floats, middles: NDArray[np.intp], steps: Floats, cells: int) -> list[Floats]:
    """The grids that some places may be of (`Crosses`). The reference of kernels/grids.c."""
    found: dict[tuple[int, ...], Floats] = {}
    for middle, own_steps in zip(middles.tolist(), steps, strict=True):
        grown = _grown(points, points[middle], own_steps, cells)
        for members, corners in [] if grown is None else _windows(points, *grown, cells):
            found.setdefault(members, corners)
        if len(found) >= MOST_GRIDS:
            break
    return list(found.values())[:MOST_GRIDS]


def crosses_in(picture: Pixels) -> Crosses:
    """The places in a picture that are darker than what is around, and those with all but MISSING of nine around.

    The reference of kernels/crossings.c.
    """
    places = _places_in(picture)
    points, depth = places[:, :2], places[:, 2]
    middles, steps = [], []
    for middle in range(len(points)):
        ways = points - points[middle]
        shortest = _axes(ways, depth / depth[middle])
        if shortest is None:
            continue
        # A lattice that is seen from the side has a diagonal that is shorter than a step.
        all_axes = [np.array(axes) @ shortest for axes in _UNIMODULAR]
        nine = [_nine_of(ways, axes) for axes in all_axes]
        if max(nine) >= 9 - MISSING:
            middles.append(middle)
            steps.append(all_axes[nine.index(max(nine))])
    return points, np.array(middles, np.intp), np.array(steps).reshape(-1, 2, 2)


def _nine_of(ways: Floats, axes: Floats) -> int:
    """How many of nine places `ways` (M, 2) lead to, in steps of `axes` (2, 2); none where these are too long."""
    if axes[1] @ axes[1] > FARTHEST_PX**2:
        return 0
    at = ways @ np.linalg.inv(axes)
    whole = np.round(at)
    return int(((np.abs(at - whole).max(axis=1) < OFF_LATTICE) & (np.abs(whole).max(axis=1) <= 1)).sum())


def _places_in(picture: Pixels) -> Floats:
    """(M, 3) x, y of the places that are darker than what is around them, and by which share; row by row."""
    if min(picture.shape) <= 2 * MARGIN_PX:
        return np.empty((0, 3))
    light = cv2.boxFilter(picture.astype(np.float32), -1, (3, 3), normalize=False)  # whole numbers
    size = 2 * AROUND_PX + 1
    within, all_of_it = (cv2.boxFilter(light, -1, (s, s), normalize=False) for s in (size - 2, size))
    around = (all_of_it - within).astype(np.float64) / (4 * (size - 1))
    dark = (light <= cv2.erode(light, np.ones((3, 3), np.uint8))) & (light < (1 - DEPTH) * around)
    dark &= around > 9 * LEAST_AROUND
    inside = np.zeros_like(dark)
    inside[MARGIN_PX:-MARGIN_PX, MARGIN_PX:-MARGIN_PX] = True
    y, x = (each[:MOST_PLACES] for each in np.nonzero(dark & inside))
    nine = light[y[:, None, None] + _STEPS[:, None], x[:, None, None] + _STEPS].astype(np.float64)
    return np.column_stack([np.column_stack([x, y]) + _lowest(nine), 1 - light[y, x] / around[y, x]])


def _lowest(nine: Floats) -> Floats:
    """(M, 2) x, y from the middle of 3 × 3 pixels (M, 3, 3) to the lowest place of the quadratic through them."""
    by_x, by_y = (nine @ _STEPS).mean(axis=1) / 2, (_STEPS @ nine).mean(axis=1) / 2
    bend = np.array([1.0, -2.0, 1.0])
    xx, yy = (nine @ bend).mean(axis=1), (bend @ nine).mean(axis=1)
    xy = _STEPS @ nine @ _STEPS / 4
    turn = np.maximum(xx * yy - xy * xy, 1e-3)
    away = np.column_stack([xy * by_y - yy * by_x, xy * by_x - xx * by_y]) / turn[:, None]
    return np.asarray(away.clip(-1, 1), np.float64)


def _axes(ways: Floats, depth: Floats) -> Floats | None:
    """(2, 2) the steps along either of two lines on which a place has neighbours straight on both ways.

    The shortest. `ways` (M, 2) lead from it to others, which are so many times as deep, `depth` (M,).
    """
    far = np.square(ways).sum(axis=1)
    near = np.flatnonzero((far >= NEAREST_PX**2) & (far <= FARTHEST_PX**2))
    near = near[np.maximum(depth[near], 1 / depth[near]) < LIKE]
    near = near[np.argsort(far[near], kind="stable")][:NEAREST]
    ways, far = ways[near], far[near]
    i, k = _pairs(len(near))
    straight = np.square(ways[i] + ways[k]).sum(axis=1) < OPPOSITE**2 * np.minimum(far[i], far[k])
    if straight.sum() < 2:
        return None
    steps = 0.5 * (ways[i] - ways[k])[straight]
    length = np.square(steps).sum(axis=1)
    one = steps[length.argmin()]
    across = np.square(one[0] * steps[:, 1] - one[1] * steps[:, 0]) > ACROSS**2 * (one @ one) * length
    if not across.any():
        return None
    return np.stack([one, steps[across][length[across].argmin()]])


@cache
def _pairs(count: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Each two of so many, the nearer first."""
    return np.triu_indices(count, 1)


def _grown(points: Floats, middle: Floats, steps: Floats, cells: int) -> tuple[NDArray[np.intp], Floats] | None:
    """The lattice around a place, as far as a grid may reach: which `points` are of it, and where in it (K, 2)."""
    to_picture = np.vstack([np.column_stack([steps.T, middle]), [0.0, 0.0, 1.0]])
    for reach in range(1, cells - 2):
        seen = apply_homography(np.linalg.inv(to_picture), points)
        whole = np.round(seen)
        off = np.abs(seen - whole).max(axis=1)
        members = np.flatnonzero((off < OFF_LATTICE) & (np.abs(whole).max(axis=1) <= reach))
        members = members[np.argsort(off[members], kind="stable")]
        numbers = whole[members] @ (2 * reach + 1, 1)
        members = members[np.unique(numbers, return_index=True)[1]]  # the nearest to each
        if len(members) < 9 - MISSING:
            return None
        fitted = _fitted(whole[members], points[members])
        if fitted is None or abs(np.linalg.det(fitted)) < 1e-9:
            return None
        to_picture = fitted
    return members, whole[members]


def _fitted(at: Floats, points: Floats) -> Floats | None:
    """(3, 3) homography from places `at` (K, 2) to `points` (K, 2), or None where there is none.

    By linear least squares, in a tenth of OpenCV's time: how far off points are counts by how far away they are, which
    is alike within a panel.
    """
    (u, v), (x, y) = at.T, (points - points[0]).T
    both = np.zeros((2, len(at), 8))
    both[0, :, 0], both[0, :, 1], both[0, :, 2], both[0, :, 6], both[0, :, 7] = u, v, 1.0, -x * u, -x * v
    both[1, :, 3], both[1, :, 4], both[1, :, 5], both[1, :, 6], both[1, :, 7] = u, v, 1.0, -y * u, -y * v
    flat = both.reshape(-1, 8)
    try:
        fitted = np.append(np.linalg.solve(flat.T @ flat, flat.T @ np.concatenate([x, y])), 1.0).reshape(3, 3)
    except np.linalg.LinAlgError:
        return None
    fitted[:2] += points[0][:, None] * fitted[2]
    return np.asarray(fitted, np.float64)


def _windows(
    points: Floats, members: NDArray[np.intp], at: Floats, cells: int
) -> list[tuple[tuple[int, ...], Floats]]:
    """Of a lattice's `members` (K,) of points at the places `at` (K, 2) those that a grid may have, and its corners."""
    side, found = cells - 1, []
    low, high = at.min(axis=0).astype(int).tolist(), at.max(axis=0).astype(int).tolist()
    for x in range(low[0], high[0] - side + 2):
        for y in range(low[1], high[1] - side + 2):
            own = np.flatnonzero(((at >= (x, y)) & (at < (x + side, y + side))).all(axis=1))
            if len(own) >= side * side - MISSING:
                corners = _corners(points[members[own]], at[own] - (x, y), cells)
                if corners is not None:
                    found.append((tuple(sorted(members[own].tolist())), corners))
    return found


def _corners(points: Floats, at: Floats, cells: int) -> Floats | None:
    """(4, 2) of the grid whose cells meet in `points` (K, 2), clockwise from the one nearest the picture's top left.

    `at` (K, 2) counts them from the first.
    """
    homography = _fitted(at, points)
    if homography is None:
        return None
    corners = apply_homography(homography, square_box(-1.0, cells - 1.0))
    return np.array(in_order(corners.tolist()))
