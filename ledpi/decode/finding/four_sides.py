"""The four sides of things by their outlines, and one square of each thing.

An outline's hull is boiled down to its most significant corners (Douglas and Peucker): the two that are farthest apart,
then the one farthest from what is a polygon already. Four make a square seen from anywhere; where there are five, one
of the five sides may cut a corner off that is dead or hidden.

The reference of kernels/four_sides.c and distinct.c.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from ledpi.decode.finding.outlines import Outline
from ledpi.geometry import quad_area
from ledpi.records import Floats, Mask

SIGNIFICANT = 0.1  # of the root of the area: corners less far from the polygon without them are none
ALIKE = 2 / 3  # of how far the fifth is: where the sixth is as significant as that, there is no telling them apart
MAX_MISFIT = 0.15  # logarithm of the four sides' area over the outline's
PIXEL_MISFIT = 0.6  # allowed on top, over the side in pixels: steps of whole pixels make small outlines ragged
MIN_SIDE = 0.3  # shortest side over the root of the area; that of a panel turned by 80° is 0.4
MAX_CUT_OFF = 0.05  # of the area: what a dead cell at a corner takes of the outline's hull is half of 1/16
MIN_SOLIDITY = 0.8  # area over that of the convex hull
SLENDER = 0.85  # area over that of the square of the same outline, below which corners are where sides cross
TOLERANCE = 1.5  # pixels of the picture that the outline is in: how far off the sides may be
BLUR_MISFIT = 0.002  # by how much a coarser outline, a pixel less certain, must fit better to be preferred
NEAR, LIKE, SAME_CORNERS = 0.25, 0.7, 0.25  # of the side: of squares in one place, what is no further off is the same
CELL = (0.2, 1.2)  # of a panel's pitch: sides of what is seen of its cells, from their bright middles to all of them
MOST_COMPARED = 512  # squares with each other: more are texture, and would take milliseconds

Corners = list[list[float]]  # x, y; numbers by numbers, as arrays this small only cost


def square_of(outline: Outline, scale: float) -> list[float] | None:
    """The square that an outline shows: eight numbers of its corners, its side, misfit, tolerance; None where none.

    Corners run clockwise in the picture from the one nearest the top left. The outline's pixels are `scale` of the
    frame's, which is where squares are.
    """
    area, hull = outline.area, cv2.convexHull(outline.points)[:, 0]
    if area < MIN_SOLIDITY * cv2.contourArea(hull):
        return None
    # Down the right side first, so that what is as good as something else is taken in the same order as in C.
    hull = hull if cv2.contourArea(hull, oriented=True) > 0 else hull[::-1]
    size, first = math.sqrt(area), min(range(len(hull)), key=lambda k: (hull[k, 1], -hull[k, 0]))
    corners = _four_sides(np.roll(hull, -first, axis=0).tolist(), size)
    if corners is None:
        return None
    of_quad = abs(quad_area(corners))
    misfit = abs(math.log(max(of_quad, 1e-3) / area))
    if misfit > MAX_MISFIT + PIXEL_MISFIT / size:
        return None
    if area < SLENDER * (0.25 * sum(math.dist(corners[k], corners[k - 1]) for k in range(4))) ** 2:
        corners = _through_sides(corners, outline.points)
        of_quad = abs(quad_area(corners))
    # An outline runs through the centres of the outermost lit pixels: half a pixel inside the edge.
    growth = 1.0 + 1.0 / max(2.0, math.sqrt(of_quad))
    middle = [0.25 * sum(corner[axis] for corner in corners) for axis in (0, 1)]
    grown = [[m + (p - m) * growth for p, m in zip(corner, middle, strict=True)] for corner in corners]
    in_picture = [(p + 0.5) * scale - 0.5 for corner in in_order(grown) for p in corner]
    return [*in_picture, (math.sqrt(of_quad) + 1.0) * scale, misfit, TOLERANCE * scale]


def distinct(squares: Floats) -> Floats:
    """Of squares (K, 11) one of each thing, that which fits best; the best first."""
    kept: list[Floats] = []
    for square in squares[np.argsort(squares[:, 9] + BLUR_MISFIT * squares[:, 10], kind="stable")]:
        if not any(_same(square, other) for other in kept):
            kept.append(square)
    return np.array(kept).reshape(-1, squares.shape[1])


def set_aside(squares: Floats, kept: Floats) -> Floats:
    """Of squares (K, 11), `distinct` of which are `kept` (M, 11), those that may be of another thing all the same.

    As a panel within a bright frame: in the place of one that is kept, but with all corners further off than either's
    tolerance. The best first.
    """
    if not 0 < len(squares) <= MOST_COMPARED:
        return squares[:0]
    like, apart = _alike(squares, kept)
    left = squares[like.any(axis=1) & ~(like & ~apart).any(axis=1)]
    if len(left) < 2:
        return left
    left = left[np.argsort(left[:, 9] + BLUR_MISFIT * left[:, 10], kind="stable")]
    like, apart = _alike(left, left)
    again = like & ~apart
    chosen: list[int] = []
    for k in range(len(left)):
        if not again[k, chosen].any():
            chosen.append(k)
    return left[chosen]


def without_cells(squares: Floats, cells: int) -> Floats:
    """Of squares (K, 11) those that are no cells of another one of `cells` × `cells`, of which a row's are seen."""
    kept = np.ones(len(squares), np.bool_)
    if len(squares) > MOST_COMPARED:
        return squares
    middles, sides = squares[:, :8].reshape(-1, 4, 2).mean(axis=1), squares[:, 8]
    for square in squares:
        corners, pitch = square[:8].reshape(4, 2), square[8] / cells
        along, to = np.roll(corners, -1, axis=0) - corners, middles[:, None] - corners
        inside = (along[:, 0] * to[..., 1] - along[:, 1] * to[..., 0] > 0).all(axis=1)
        within = inside & (sides > CELL[0] * pitch) & (sides < CELL[1] * pitch)
        if within.sum() >= cells:
            kept &= ~within
    return squares[kept]


def _same(square: Floats, other: Floats) -> bool:
    """Whether two are of one thing."""
    larger, smaller = max(square[8], other[8]), min(square[8], other[8])
    a, b = square[:8].reshape(4, 2), other[:8].reshape(4, 2)
    corners = np.hypot(*(a[:, None] - b).transpose(2, 0, 1)).min(axis=1).max()
    middles = np.hypot(*(a.mean(axis=0) - b.mean(axis=0)))
    return bool(smaller > LIKE * larger and middles < NEAR * larger and corners < SAME_CORNERS * larger)


def _alike(squares: Floats, others: Floats) -> tuple[Mask, Mask]:
    """(K, M) which squares (K, 11) are the same as which others (M, 11), as by `_same`, and apart at all corners."""
    a, b = (np.ascontiguousarray(of[:, :8]).view(np.complex128).T for of in (squares, others))
    corners = np.abs(a[:, :, None] - b[:, None, None]).min(axis=0)  # (4, K, M) from each of a's to the nearest of b's
    middles = 0.25 * np.abs(a.sum(axis=0)[:, None] - b.sum(axis=0))
    larger, smaller = np.maximum(squares[:, None, 8], others[:, 8]), np.minimum(squares[:, None, 8], others[:, 8])
    like = (smaller > LIKE * larger) & (middles < NEAR * larger) & (corners.max(axis=0) < SAME_CORNERS * larger)
    return like, corners.min(axis=0) > np.maximum(squares[:, None, 10], others[:, 10])


def _four_sides(hull: Corners, size: float) -> Corners | None:
    """Corners of the four-sided figure that a hull is about."""
    polygons, away = _significant(hull)
    if away[5] > SIGNIFICANT * size and away[6] <= max(SIGNIFICANT * size, ALIKE * away[5]):
        corners = _with_corner(polygons[5], size)
        if corners is not None:
            return corners
    if not away[4] > SIGNIFICANT * size:
        return None
    corners = polygons[4]
    shortest = min(math.dist(corners[k], corners[k - 1]) for k in range(4))
    # With a side this short it is a triangle with a corner cut off.
    return corners if shortest > MIN_SIDE * size else None


def _significant(hull: Corners) -> tuple[dict[int, Corners], dict[int, float]]:
    """The polygons of a hull's 3 to 6 most significant corners; how far out the last of each is, 0 if there is none."""

    def farthest_from(k: int) -> int:
        others = [(k + i) % len(hull) for i in range(len(hull))]
        return max(others, key=lambda i: (hull[i][0] - hull[k][0]) ** 2 + (hull[i][1] - hull[k][1]) ** 2)

    def farthest_out(a: int, b: int) -> tuple[float, int]:
        (ax, ay), (bx, by) = hull[a], hull[b]
        between = [(a + i) % len(hull) for i in range((b - a) % len(hull))]
        away = [abs((bx - ax) * (hull[i][1] - ay) - (by - ay) * (hull[i][0] - ax)) for i in between]
        best = away.index(max(away))
        return away[best] / max(math.sqrt((bx - ax) ** 2 + (by - ay) ** 2), 1e-9), between[best]

    first = farthest_from(farthest_from(0))
    chosen, polygons, out = [first, farthest_from(first)], {}, dict.fromkeys(range(3, 7), 0.0)
    for count in out:
        chords = [farthest_out(a, b) for a, b in zip(chosen, chosen[1:] + chosen[:1], strict=True)]
        away, at = max(chords, key=lambda chord: chord[0])
        if not away > 0:
            break
        chosen.insert(chords.index((away, at)) + 1, at)
        polygons[count], out[count] = [hull[k] for k in chosen], away
    return polygons, out


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


def _through_sides(corners: Corners, outline: NDArray[np.int32]) -> Corners:
    """Where straight lines through each side's part of the outline cross; `corners` where they do not.

    Of a slender shape the outline's own corners are blunt, and may lie far inside.
    """
    start = np.array(corners, np.float64)
    along = np.roll(start, -1, axis=0) - start
    length = np.maximum(np.hypot(along[:, 0], along[:, 1]), 1e-9)
    along /= length[:, None]
    across = np.stack([-along[:, 1], along[:, 0]], axis=1)
    points = outline - start[:, None]  # (4, P, 2)
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


def in_order(corners: Corners) -> Corners:
    """Clockwise as seen in the picture, first the corner nearest the top left."""
    order = corners if quad_area(corners) > 0 else corners[::-1]
    nearest = min(range(4), key=lambda k: sum(order[k]))
    return order[nearest:] + order[:nearest]
