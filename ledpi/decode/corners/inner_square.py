"""A panel's corners by its inner lines alone, where what is around it does not show where its sides are.

Something as bright as the panel may touch it, or something hide its rim: what is within the panel stays as it is. The
homography of the lattice whose lines are where the cells meet has the corners where its rim is: first by where light is
darkest across each line, then by what `inner_lines` makes of it.
"""

from __future__ import annotations

import math

import numpy as np

from ledpi.decode.corners.adjust import BUILT_PX, FARTHEST, HUBER, LEAST_CELLS, LEAST_VARIANCE, MOVES, REACH_PX, design
from ledpi.decode.corners.inner_lines import NOT_SEEN_PX2, PLACES, Homographies, inner_lines, lens_moves
from ledpi.decode.corners.sides import Patches, Points, areas, as_corners, as_points, bends
from ledpi.decode.corners.whole import NO_RIM_WALL, RIM_WALL
from ledpi.geometry import corners_apart, quad_side
from ledpi.kernels import inner_square as kernel
from ledpi.kernels.edges import MOST_CELLS
from ledpi.kernels.light import can_read
from ledpi.records import Floats, Frame, Intrinsics, Mask, Quad, Rejected

NO_LINES = Rejected(stage="edges", reason="no_inner_lines")
AT_BORDER = Rejected(stage="edges", reason="at_picture_border")

# Of a pitch, to either side of a line, where it is sought at first: `inner_lines` sees no further than a wall and its
# blur, and beside that light is even too.
SHIFT_STEP = 0.05
DIP = 0.97  # of the darker of both ends, at least so dark is a line: it is not where either cell is dead
_SHIFTS = SHIFT_STEP * np.arange(-5, 6)
ROUGH_ROUNDS, ROUNDS = 2, 5
NEAR_PX = 0.05  # a round that moves the corners no further is the last
MOST_SHARE = 0.1  # of the side: a round that moves them further has lost its way
LEAST_SHOWN = 0.75  # of the places where cells meet must show a line, and be darkest there to a step
MAX_AWAY = 0.06  # of a pitch: root mean square of the lines about their lattice
# Of the corners. Panels leave 0.04 at 1 m, 0.1 at 3 m; lattices that lie a cell aside, with the dark beside a panel for
# their last column, 0.3 to 0.6.
MAX_SIGMA_PX = 0.25
# Of the side: lines do not tell whether the rim has half a wall, as a lattice of walls has it, or ends without one, as
# cells of one size do. Anywhere between.
HALF_WALL_SIGMA = RIM_WALL * NO_RIM_WALL / math.sqrt(3)
SAME = 0.02  # of a pitch: corners no further apart
# Of a pitch, and pixels for what moves: what its sides tell of a panel is no further from where it is expected.
NEAR, NEAR_BY_PX = 0.05, 0.5
ALIKE, ASIDE = 1.25, 0.4  # of two squares: times the other's pitch, and pitches apart, from which on they are two
_CORNERS = np.array([0, 1, 1, 0.0]), np.array([0, 0, 1, 1.0])


def by_inner_lines(frame: Frame, near: Floats, cells: int, intrinsics: Intrinsics | None = None) -> Quad | Rejected:
    """The grid of `cells` × `cells` whose corners are about `near` (4, 2), to a tenth of a cell."""
    if cells < LEAST_CELLS:
        return NO_LINES
    told = kernel.told if can_read(frame) and cells <= MOST_CELLS else _told
    at, sigma_px = told(frame, near, cells, intrinsics)
    if not math.isfinite(sigma_px):
        return NO_LINES
    height, width = frame.pixels.shape
    if at.min() < 1 or at[:, 0].max() > width - 2 or at[:, 1].max() > height - 2:
        return AT_BORDER
    bend_px = float(np.abs(bends(as_points(at[None]), intrinsics).imag).max())
    quad = Quad(corners_px=at, corner_sigma_px=sigma_px, bend_px=bend_px, told_by="lines")
    return quad.less_sure_of_size(HALF_WALL_SIGMA * quad_side(at.tolist()))


def _told(frame: Frame, near: Floats, cells: int, intrinsics: Intrinsics | None) -> tuple[Floats, float]:
    """Its corners, and their deviation; not a number where there is none. The reference of kernels/inner_square.c."""
    corners, nowhere = as_points(np.asarray(near, np.float64)[None]), (near, math.nan)
    for number in range(ROUGH_ROUNDS + ROUNDS):
        side_px = math.sqrt(max(float(areas(corners)[0]), 0.0))
        if not side_px > 2 * cells:
            return nowhere
        lines = _Lines(frame, corners, cells)
        step, sigma_px, away_px = lines.rough() if number < ROUGH_ROUNDS else lines.exact(intrinsics)
        moved = float(np.abs(step).max())
        if not moved < MOST_SHARE * side_px:
            return nowhere
        corners = corners + step
        if moved < NEAR_PX and number >= ROUGH_ROUNDS:
            break
    pitch_px = side_px / cells
    if not (moved < max(2 * sigma_px, NEAR_PX) and sigma_px < MAX_SIGMA_PX and away_px < MAX_AWAY * pitch_px):
        return nowhere
    darkest, is_dip = _Lines(frame, corners, cells).darkest()
    if (is_dip & (np.abs(darkest) < 1.5 * SHIFT_STEP)).mean() < LEAST_SHOWN:
        return nowhere
    return as_corners(corners)[0], sigma_px


def is_same(quad: Quad, other: Quad, cells: int) -> bool:
    """Whether two are of one thing, and so exactly that looking at both tells no more than at one."""
    apart_px = corners_apart(quad.corners_px.tolist(), other.corners_px.tolist())
    return apart_px < SAME * _pitch_px(other.corners_px, cells)


def is_near(quad: Quad, expected: Floats, cells: int) -> bool:
    """Whether a panel that is expected to have these corners (4, 2) may be where its sides seem to be.

    What touches it draws a side by more.
    """
    apart_px = corners_apart(quad.corners_px.tolist(), expected.tolist())
    return apart_px < NEAR * _pitch_px(expected, cells) + NEAR_BY_PX


def is_aside(quad: Quad, other: Quad, cells: int) -> bool:
    """Whether two overlap that are alike in size: one of them is a part of the other's cells, and of what is beside.

    Where sides tell where a panel is, its lines tell it a row or a column aside as well.
    """
    pitch_px, other_px = _pitch_px(quad.corners_px, cells), _pitch_px(other.corners_px, cells)
    away_px = math.dist(quad.corners_px.mean(axis=0), other.corners_px.mean(axis=0))
    return 1 / ALIKE < pitch_px / other_px < ALIKE and ASIDE * other_px < away_px < cells * other_px


def _pitch_px(corners: Floats, cells: int) -> float:
    return math.dist(corners[0], corners[2]) / (cells * math.sqrt(2))


class _Lines:
    """The places where cells meet in a grid whose corners (1, 4) are roughly known: what moves it to where they are."""

    def __init__(self, frame: Frame, found: Points, cells: int) -> None:
        self._found, self._cells = found, cells
        self._patches = Patches(frame, found, REACH_PX)
        self._at, self._inner = design(cells), 2 * cells * (cells - 1)
        self._homographies = Homographies.of(found - self._patches.first)
        self._along_u = self._at.by_u[: self._inner]
        self._u, self._v = self._at.u[: self._inner], self._at.v[: self._inner]
        _, by_u, by_v = self._homographies.at(self._u, self._v)
        # Pixels across a line, by a unit of u or v.
        self._scale = np.abs((by_u.conj() * by_v).imag[0]) / np.abs(np.where(self._along_u, by_v, by_u)[0])
        self._slopes = self._at.moves[: self._inner] * self._scale[:, None]

    def darkest(self) -> tuple[Floats, Mask]:
        """(K,) how far from each place light is darkest, in pitches along u or v, and whether it is a dip."""
        u, v, along_u = self._u[:, None, None], self._v[:, None, None], self._along_u[:, None, None]
        across, along = _SHIFTS[:, None] / self._cells, (PLACES - 0.5) / self._cells
        places = u + np.where(along_u, across, along), v + np.where(along_u, along, across)
        points = self._homographies.at(places[0].ravel(), places[1].ravel())[0]
        light = self._patches.light_at(points.astype(np.complex64)).reshape(*places[0].shape).mean(axis=2)
        is_dip = light.min(axis=1) < DIP * np.minimum(light[:, 0], light[:, -1])
        return np.asarray(_SHIFTS[light.argmin(axis=1)], np.float64), np.asarray(is_dip)

    def rough(self) -> tuple[Points, float, float]:
        """How far off the corners are by that, (1, 4); their deviation, and that of the lines, in pixels."""
        pitch_px, (darkest, is_dip) = self._scale / self._cells, self.darkest()
        return self._moved(darkest * pitch_px, np.square(SHIFT_STEP * pitch_px), is_dip)

    def exact(self, intrinsics: Intrinsics | None) -> tuple[Points, float, float]:
        """The same, by what is even and odd in the light across the lines."""
        pitch_px = self._scale.reshape(1, 2, -1).mean(axis=2) / self._cells
        moved_px = lens_moves(self._found, self._cells, intrinsics)
        seen, variance = inner_lines(self._patches, self._homographies, pitch_px, moved_px, self._cells)
        return self._moved(seen[0], variance[0] + BUILT_PX**2, np.asarray(variance[0] < NOT_SEEN_PX2))

    def _moved(self, seen: Floats, variance: Floats, shown: Mask) -> tuple[Points, float, float]:
        """The corners' step that explains best what is `seen`; not a number where too little is `shown`."""
        if shown.mean() < LEAST_SHOWN:
            return np.full((1, 4), np.nan, np.complex128), math.nan, math.nan
        weights = shown / variance
        _, left = self._solved(seen, weights)
        ratio = np.minimum(np.square(left) * weights, FARTHEST**2).sum() / max(shown.sum() - MOVES, 1)
        weights /= max(ratio, LEAST_VARIANCE)
        weights *= np.minimum(1.0, HUBER / np.maximum(np.abs(left) * np.sqrt(weights), HUBER))
        moves, left = self._solved(seen, weights)
        covariance = np.linalg.inv((self._slopes.T * weights) @ self._slopes)
        _, by_u, by_v = self._homographies.at(*_CORNERS)
        by_move = by_u[0, :, None] * self._at.corners[:, 0] + by_v[0, :, None] * self._at.corners[:, 1]  # (4, 8)
        both = np.concatenate([by_move.real, by_move.imag])
        sigma_px = math.sqrt(float(((both @ covariance) * both).sum(axis=1).mean()))
        away_px = math.sqrt(float((weights * np.square(left)).sum() / weights.sum()))
        return np.asarray((by_move @ moves)[None], np.complex128), sigma_px, away_px

    def _solved(self, seen: Floats, weights: Floats) -> tuple[Floats, Floats]:
        """The homography's changes (8,) that explain best what is seen, and what they leave."""
        weighted = self._slopes.T * weights
        moves = np.asarray(np.linalg.solve(weighted @ self._slopes, weighted @ seen), np.float64)
        return moves, seen - self._slopes @ moves
