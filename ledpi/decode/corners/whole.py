"""Whether a quad shows a panel's cells where a whole panel's would be, and where the panel is if it does not.

Every cell is brighter in its middle, or has gaps to its neighbours, or both. Where a side is hidden, a row of cells is
dead, or a bright thing touches, the quad that is seen is no longer n × n cells: they and their gaps lie elsewhere in
it. So the light along it is explained as that of n whole cells, and of the same cells with a side further in or out;
if one of those explains it better, the quad is not the panel.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ledpi.decode.corners.sides import REACH_PX, Coordinates, Patches, Points, Shares, areas, as_corners, as_points
from ledpi.geometry import box, in_square, unit_square_to
from ledpi.records import Floats, Frame, Mask

ALONG = 40  # places along the quad
ALONG_AT = (np.arange(ALONG) + 0.5) / ALONG
BEND_ALONG = Shares.at(ALONG_AT).bend
ACROSS_CELL = (0.3, 0.7)  # of a cell: where the light along the quad is taken, and averaged
NEAR_EDGE = 0.06  # of the quad: so near to its ends the blurred edge is seen
# Of the panel's side that may be hidden, or too much. No place is told by less than three cells and a half of four, but
# what may be a whole row is looked at too: else that would pass as what comes nearest.
SHARE_STEP = 0.02
SHARES = SHARE_STEP * np.arange(-5, 15)
WHOLE, MOST = 5, 0.15
SMALLER = 2 * len(SHARES) + 2  # of the explanations: a panel that ends by 6 % of the side further in, all around
ENDS = ((1.0, 0.0), (0.0, 1.0), (1.0, 1.0))  # where it is: the last as bare LEDs have it, dark all around
# Of the side: cells of one size with walls between them, but none at the rim, lie as if the rim had half a wall and hid
# it. Its sides are where light ends all the same. (Where cells are 10 % of a pitch apart, 0.0128, and told as 0.02.)
NO_RIM_WALL = 0.025
RIM_WALL = 0.6  # of what is told then
GAP, BLUR_PX = 0.03, 0.9  # half a gap, of the pitch; and what blurs it, as deviations
BLUR_STEP = 0.15  # logarithm, between the explanations that are made
BLUR_STEPS = range(-40, 1)  # from a picture 360 px high of 8 cells a side, all in focus, to a blur as wide as the quad
BETTER = 0.6  # what is left unexplained, of that of whole cells: less is a better explanation
# Of the mean light, and of what whole cells leave: more than either, and nothing that is tried explains it.
LITTLE_LEFT, CLEARLY_BETTER = 0.06, 0.15
NOTHING_LEFT = 0.02  # of the mean light: whole cells explain this well whatever noise and bands there are
# Cells show where the panel ends if a smaller one would leave so many times as much unexplained, and more than noise
# and bands do. (Of panels with walls, or cells brighter in their middle, it leaves 0.02 to 0.14; of even ones about as
# much as whole cells.)
CELLS_SHOW, LEAST_SHOWN = 1.5, 0.015


def hidden_shares(frame: Frame, corners: Points, bend_px: Points, cells: int) -> tuple[Floats, Mask]:
    """(N, 2, 2) share of the panel's side that quads (N, 4) lack: at the left and right, then at the top and bottom.

    Negative where the quad is too large; 0 where it is whole, and where nothing tells, as of a lamp that is even all
    over; not a number where no such share explains what is seen. And (N,) whether anything tells. `bend_px` (N, 4, 2)
    is the sides' `bends`: the lens moves the rows of gaps with them.
    """
    side_px, most_bent = np.sqrt(np.abs(areas(corners))), np.abs(bend_px.imag).max(axis=(1, 2))
    blurs = (BLUR_PX + most_bent + GAP * side_px / cells) / np.maximum(side_px, 1.0)
    light = _light_along(frame, corners, bend_px, cells)
    hidden, shown = np.zeros((len(corners), 2, 2)), np.zeros((len(corners), 2), bool)
    for into, show, along, blur in zip(hidden, shown, light, blurs.tolist(), strict=True):
        if not blur > 0:  # the quad is nowhere
            continue
        axes, left = explanations(cells, _step(blur)).left(along)
        show[:] = left[:, SMALLER] > np.maximum(CELLS_SHOW**2 * left[:, WHOLE], LEAST_SHOWN**2)
        for axis in axes:
            best = int(left[axis].argmin())
            if left[axis, best] < BETTER * left[axis, WHOLE]:
                end, share = divmod(best, len(SHARES))
                into[axis] = _share(left[axis, end * len(SHARES) :][: len(SHARES)], share) * np.array(ENDS[end])
                show[axis] = True
    return hidden, np.asarray(shown.all(axis=1))


def without_rim_walls(hidden: Floats) -> tuple[Floats, Floats]:
    """Shares (N, 2, 2) less what is only the half wall that a rim lacks, and about how wide that is (N,) at most."""
    lacks = (hidden[..., 0] == hidden[..., 1]) & (hidden[..., 0] > 0) & (hidden[..., 0] < NO_RIM_WALL)
    walls: Floats = RIM_WALL * np.where(lacks, hidden[..., 0], 0.0).max(axis=1)
    return np.where(lacks[..., None], 0.0, hidden), walls


def _light_along(frame: Frame, corners: Points, bend_px: Points, cells: int) -> Floats:
    """(N, 2, ALONG) light along quads (N, 4), from left to right and from top to bottom, its mean 1."""
    patches = Patches(frame, corners, REACH_PX)
    light = patches.light_at(_grid(corners - patches.first, bend_px, cells)).mean(axis=2)
    light /= np.maximum(light.mean(axis=2, keepdims=True), 1e-6)
    return np.asarray(light, np.float64)


def completed(corners: Points, hidden: Floats) -> Points:
    """The corners (4,) of a quad that lacks `hidden` (2, 2) of its panel, of the whole panel."""
    seen = 1 - hidden.sum(axis=1)
    whole = box(*(-hidden[:, 0] / seen), *(1 + hidden[:, 1] / seen))
    return as_points(in_square(as_corners(corners), whole))


def _share(left: Floats, best: int) -> float:
    """The share with the least left unexplained, between the SHARES by the parabola through its neighbours."""
    if not 0 < best < len(SHARES) - 1:
        return math.nan
    before, here, after = left[best - 1 : best + 2].tolist()
    tilt, bend = 0.5 * (before - after), max(before + after - 2 * here, 1e-12)
    share = float(SHARES[best]) + SHARE_STEP * tilt / bend
    least = here - 0.5 * tilt * tilt / bend
    return share if abs(share) < MOST and least < max(LITTLE_LEFT**2, CLEARLY_BETTER * left[WHOLE]) else math.nan


def _grid(corners: Points, stretch_px: Points, cells: int) -> Coordinates:
    """(N, 2, lines, ALONG) points: on lines from left to right, and on lines from top to bottom.

    `stretch_px` (N, 4, 2) is how far along each side the lens moves its thirds.
    """
    onward, back = stretch_px.real[:, :2], -stretch_px.real[:, 2:, ::-1]  # sides 2 and 3 run the other way
    length = np.abs(corners[:, 1:3] - corners[:, :2])
    shift = (0.5 * (onward + back) / length[..., None]) @ BEND_ALONG  # (N, 2, ALONG)
    across = ((np.arange(cells)[:, None] + ACROSS_CELL) / cells).reshape(-1, 1)
    lines = len(across)  # each looks elsewhere within a place: else a thin gap falls between two
    at = ALONG_AT + ((np.arange(lines)[:, None] + 0.5) / lines - 0.5) / ALONG
    homographies = np.array([unit_square_to(quad) for quad in as_corners(corners)])[..., None, None]
    by_u, by_v, start = (homographies[:, 0] + 1j * homographies[:, 1]).swapaxes(0, 1)
    g, h = homographies[:, 2, :2].swapaxes(0, 1)
    grid = np.empty((len(corners), 2, lines, ALONG), np.complex64)
    for k, (u, v) in enumerate(((at + shift[:, :1], across), (across, at + shift[:, 1:]))):
        grid[:, k] = (by_u * u + (by_v * v + start)) / (g * u + (h * v + 1))
    return grid


@dataclass(frozen=True, slots=True, eq=False)
class Explanations:
    """Of light along a quad, by cells of which so much is hidden at one end."""

    bases: Floats  # (columns, ALONG) orthonormal within each explanation, 0 near the ends
    first: NDArray[np.intp]  # (explanations + 1,) where the columns of each begin, and the last ones end
    counted: Floats  # (ALONG,) 1, and 0 near the ends

    def left(self, light: Floats) -> tuple[list[int], Floats]:
        """Mean square that each leaves of light (2, ALONG): the axes of which whole cells leave any, and (2, E)."""
        all_of_it = np.square(light) @ self.counted
        explained = np.add.reduceat(np.square(light @ self.bases.T), self.first[:-1], axis=1)
        rest: Floats = np.maximum(all_of_it[:, None] - explained, 1e-9) / self.counted.sum()
        return np.flatnonzero(rest[:, WHOLE] > NOTHING_LEFT**2).tolist(), rest


def usual_blur_steps(cells: int, smallest_px: float, largest_px: float) -> range:
    """The `explanations` that sides so long ask for."""
    first, last = (_step((BLUR_PX + GAP * side_px / cells) / side_px) for side_px in (largest_px, smallest_px))
    return range(first, last + 1)


def _step(blur: float) -> int:
    return min(max(round(math.log(blur) / BLUR_STEP), BLUR_STEPS[0]), BLUR_STEPS[-1])


@lru_cache(maxsize=32)  # 160 kB each, made in 4 ms; the usual ones are 16
def explanations(cells: int, blur_step: int) -> Explanations:
    """Of light along a quad by `cells`, of which more or less is hidden.

    `blur_step`: logarithm of a gap's deviation, as a share of the quad, in BLUR_STEP.
    """
    along = ALONG_AT
    counted = np.asarray((along > NEAR_EDGE) & (along < 1 - NEAR_EDGE))
    width = cells * math.exp(blur_step * BLUR_STEP)
    bases, first = [], [0]
    for before, after in ((share * left, share * right) for left, right in ENDS for share in SHARES.tolist()):
        at = (before + along * (1 - before - after)) * cells  # in cells of the whole panel
        cell = np.clip(np.floor(at), 0, cells - 1)
        y = 2 * (at - cell) - 1
        columns = [sum(np.exp(-0.5 * np.square((at - gap) / width)) for gap in range(1, cells)) * counted]
        for k in range(cells):
            inside = (cell == k) & counted
            if inside.sum() > 2:
                columns += [inside * 1.0, inside * y * y]
        bases.append(np.linalg.qr(np.stack(columns, axis=1))[0])
        first.append(first[-1] + len(columns))
    columns_first = np.ascontiguousarray(np.concatenate(bases, axis=1).T)
    return Explanations(columns_first, np.array(first, np.intp), counted.astype(np.float64))
