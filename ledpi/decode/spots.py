"""Panels without a diffuser: as many bright spots as cells, in a lattice, with little light between.

No square is lit there for `find` to see. The spots' centres are the cells', so the homography through all of them says
where the corners of the grid are: half a pitch beyond the outermost.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from numpy.typing import NDArray

from ledpi.records import Floats, Frame, Quad, Rejected
from ledpi.tone import linear_light

NO_SPOTS = Rejected(stage="edges", reason="no_spots")
NOT_IN_LINE = Rejected(stage="edges", reason="spots_not_in_line")
AT_BORDER = Rejected(stage="edges", reason="at_picture_border")

LINK = 1.6  # times the distance to the nearest: neighbours along a lattice's other axis, seen up to 50° from the side
LIKE = 2.0  # as many times as long an outline may be
MOST_MORE = 1.3  # times as many may be linked to each other as there are cells
MAX_SPOTS = 200  # that are looked at: more is texture
OFF_LATTICE = 0.25  # of a pitch: spots further off are none of a lattice
ROUNDS = 2
REACH = 0.45  # of the pitch: as far around a centre as its spot's light is weighed
LEAST_SIGMA_PX = 0.05  # of a corner: lamps are not quite alike
MAX_RMS = 0.08  # of the pitch, of the spots about their lattice: LEDs sit where the grid has them


def group_sizes(cells: int) -> range:
    """How many spots a group may have in which there may be a lattice of `cells` × `cells`, with specks beside it."""
    return range(cells * cells, math.ceil(MOST_MORE * cells * cells))


def groups(spots: Floats, sizes: range) -> list[Floats]:
    """Of spots (M, 3; x, y, size) those that are alike and neighbours, as many together as `sizes` has.

    The reference of kernels/spots.c.
    """
    if not sizes.start <= len(spots) <= MAX_SPOTS:
        return []
    points, size = spots[:, :2], spots[:, 2]
    apart = np.hypot(*(points[:, None] - points).transpose(2, 0, 1))
    np.fill_diagonal(apart, np.inf)
    alike = np.maximum(size[:, None], size) < LIKE * np.minimum(size[:, None], size)
    nearest = np.where(alike, apart, np.inf).min(axis=1)
    linked = alike & (apart < LINK * np.minimum(nearest[:, None], nearest))
    return [spots[sorted(group)] for group in _linked(linked) if len(group) in sizes]


def lattice(group: Floats, cells: int) -> Floats | None:
    """Corners (4, 2) of the grid of `cells` × `cells`, roughly, whose middles a group's spots are; None for none."""
    odd = np.abs(group[:, 2] - np.median(group[:, 2]))
    return _corners(group[np.argsort(odd, kind="stable")[: cells * cells], :2], cells)


def _linked(linked: NDArray[np.bool_]) -> list[list[int]]:
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
    grid = np.array([[0, 0], [last, 0], [last, last], [0, last]], np.float32)
    to_grid = cv2.getPerspectiveTransform(outer.astype(np.float32), grid)
    at = cv2.perspectiveTransform(points[:, None].astype(np.float64), to_grid)[:, 0]
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
    corners = cv2.perspectiveTransform(_rim(cells)[:, None], homography)[:, 0]
    a, b = corners[2] - corners[0], corners[3] - corners[1]
    if a[0] * b[1] - a[1] * b[0] < 0:
        corners = corners[::-1]
    return np.asarray(np.roll(corners, -int(corners.sum(axis=1).argmin()), axis=0), np.float64)


def settle(frame: Frame, corners: Floats, cells: int) -> Quad | Rejected:
    """The grid whose corners are near `corners` (4, 2), by the centres of its spots' light."""
    table = linear_light(frame.transfer, mark_saturated=False)
    grid = np.stack(np.meshgrid(np.arange(cells), np.arange(cells)), axis=-1).reshape(-1, 2).astype(np.float64)
    pitch = min(math.dist(corners[k], corners[k - 1]) for k in range(4)) / cells
    rms = math.inf
    for _ in range(ROUNDS):
        to_picture = cv2.getPerspectiveTransform(_rim(cells).astype(np.float32), corners.astype(np.float32))
        expected = cv2.perspectiveTransform(grid[:, None], to_picture)[:, 0]
        seen = np.array([_centre(frame, table, x, y, REACH * pitch) for x, y in expected.tolist()])
        homography = cv2.findHomography(grid, seen)[0] if np.isfinite(seen).all() else None
        if homography is None:
            return NO_SPOTS
        rms = float(np.sqrt(np.square(seen - cv2.perspectiveTransform(grid[:, None], homography)[:, 0]).mean()))
        corners = cv2.perspectiveTransform(_rim(cells)[:, None], homography)[:, 0]
    if not rms < MAX_RMS * pitch:
        return NOT_IN_LINE
    height, width = frame.pixels.shape
    if corners.min() < 0 or corners[:, 0].max() > width - 1 or corners[:, 1].max() > height - 1:
        return AT_BORDER
    # The corners lie beyond the outermost spots: what the fit leaves of one is about the corner's error.
    return Quad(corners_px=np.ascontiguousarray(corners), corner_sigma_px=max(rms, LEAST_SIGMA_PX), of_spots=True)


def is_part_of(quad: Quad, grid: Quad) -> bool:
    """Whether a quad runs around the spots of a grid, or somewhere inside it."""
    side_px = math.dist(grid.corners_px[0], grid.corners_px[2]) / math.sqrt(2)
    apart = np.abs(quad.corners_px.mean(axis=0) - grid.corners_px.mean(axis=0)).max()
    return bool(apart < 0.5 * side_px)


def _rim(cells: int) -> Floats:
    """(4, 2) corners of the grid, in pitches from the middle of its first cell."""
    low, high = -0.5, cells - 0.5
    return np.array([[low, low], [high, low], [high, high], [low, high]])


def _centre(frame: Frame, table: NDArray[np.float32], x: float, y: float, reach_px: float) -> tuple[float, float]:
    """Of the light around (x, y) over what is darkest there."""
    height, width = frame.pixels.shape
    x0, x1, y0, y1 = round(x - reach_px), round(x + reach_px) + 1, round(y - reach_px), round(y + reach_px) + 1
    if x0 < 0 or y0 < 0 or x1 > width or y1 > height or x1 - x0 < 3 or y1 - y0 < 3:
        return math.nan, math.nan
    light = cv2.LUT(frame.pixels[y0:y1, x0:x1], table)
    across, down = np.arange(x0, x1) - x, np.arange(y0, y1) - y
    # A window that fades out: what is cut off at its border by whole pixels must not pull.
    window = np.maximum(0.0, 1.0 - (np.square(across) + np.square(down)[:, None]) / reach_px**2)
    weight = np.maximum(light - 0.5 * (light.min() + light.max()), 0.0) * window
    total = float(weight.sum())
    if total <= 0:
        return math.nan, math.nan
    return x + float((weight.sum(axis=0) * across).sum()) / total, y + float((weight.sum(axis=1) * down).sum()) / total
