"""What the cells of a panel have in common: the light at a point of each, from itself and from across its borders.

All cells are built alike and seen through one lens, so at each lattice point the light of all cells lies in the space
that few unknowns span: the profile there, times each cell's own gain, and what the optics mix in of its neighbours',
times theirs. An orthonormal basis of that space is what to project out (`evidence` has the equation).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ledpi.decode.cells import INSET, CellSamples, Singles

Integers = NDArray[np.int64]
Mask = NDArray[np.bool_]

# How far across a cell's border its light reaches: lens, pixel and interpolation together have a standard deviation of
# 0.8 to 1.1 px in a focused picture.
BORDER_PX = 2.5


@dataclass(frozen=True, slots=True, kw_only=True)
class Sources:
    """What may light up each lattice point: P columns of `shared_light`, those of one point after each other."""

    point: Integers  # (P,)
    column: Integers  # (P,)
    first: Integers  # (points,) where each point's begin


def border_points(samples: CellSamples) -> tuple[int, int]:
    """How many points at either end of a cell a neighbour may light up: across, down."""
    k, (width, height) = samples.lattice.k, samples.cell_px
    return _border_points(k, width), _border_points(k, height)


def _border_points(k: int, cell_px: float) -> int:
    step = cell_px * (1 - 2 * INSET) / k
    return min(max(math.ceil((BORDER_PX - INSET * cell_px) / step - 0.5), 0), k // 2)


# The cells whose light meets at a point, as (down, across) from its own: near a corner; near a side. The first two of
# the former also serve near the left and the right side. Neighbours across a corner add too little to matter.
_MEETINGS = [[(0, 0), (0, x), (y, 0)] for y in (-1, 1) for x in (-1, 1)] + [[(0, 0), (y, 0), (0, 1)] for y in (-1, 1)]


@cache
def sources_of(k: int, border: tuple[int, int]) -> Sources:
    """For k × k points a cell, of which the outer `border` (across, down) are near a border."""
    across, down = (np.where(np.arange(k) < b, -1, np.where(np.arange(k) >= k - b, 1, 0)).tolist() for b in border)
    point: list[int] = []
    column: list[int] = []
    first: list[int] = []
    for at, (y, x) in enumerate((y, x) for y in down for x in across):
        meeting = 4 + (y > 0) if y and not x else 2 * (y > 0) + (x > 0)
        count = 1 + (x != 0) + (y != 0)
        first.append(len(point))
        point += [at] * count
        column += [3 * meeting + i for i in range(count)]
    return Sources(point=np.array(point), column=np.array(column), first=np.array(first))


def _meeting(values: Singles, cells: int) -> Singles:
    """(cells, 18): the values (cells,) of the cells that meet, in each of `_MEETINGS`; 0 beyond the rim."""
    return np.append(values, np.float32(0)).take(meeting_cells(cells))


@cache
def meeting_cells(cells: int) -> Integers:
    """(cells, 18): which cells meet there; beyond the rim there is one more."""
    around = np.full((cells + 2, cells + 2), cells * cells)
    around[1:-1, 1:-1] = np.arange(cells * cells).reshape(cells, cells)
    met = [around[1 + y : 1 + y + cells, 1 + x : 1 + x + cells].reshape(-1) for m in _MEETINGS for y, x in m]
    return np.stack(met, axis=1)


def shared_light(gain: Singles, cells: int) -> Singles:
    """(cells, 18): for each of `_MEETINGS`, an orthonormal basis of what the cells may show at one point, whitened."""
    shown = (_meeting(gain, cells) / np.sqrt(gain)[:, None]).reshape(len(gain), -1, 3)
    own, second, third = (shown[:, :, i] for i in range(3))  # (cells, meetings) each; Gram and Schmidt
    own /= np.sqrt((own * own).sum(axis=0))
    second -= own * (own * second).sum(axis=0)
    second /= np.maximum(np.sqrt((second * second).sum(axis=0)), 1e-6)
    third -= own * (own * third).sum(axis=0) + second * (second * third).sum(axis=0)
    third /= np.maximum(np.sqrt((third * third).sum(axis=0)), 1e-6)
    return np.asarray(shown.reshape(len(gain), -1), np.float32)


def shared_blinking_light(
    gain: Singles, white: Mask, lights: Singles, cells: int, sources: Sources, root: Singles
) -> Singles:
    """(cells, P): the same at each point, where each cell blinks as its class is believed to.

    `white` (cells,) which are of the white class, `lights` (2, cells, points) what either class makes of an even light.
    """
    blinks_white = _meeting(white.astype(np.float32), cells)[:, sources.column] > 0
    light = np.where(blinks_white, lights[1][:, sources.point], lights[0][:, sources.point])
    columns = _meeting(gain, cells)[:, sources.column] * light / root[:, sources.point]
    return _orthonormal(columns, sources)


def _orthonormal(columns: Singles, sources: Sources) -> Singles:
    """Those of each point made orthonormal among themselves (Gram and Schmidt), one after the other."""
    rank = np.arange(len(sources.point)) - sources.first[sources.point]
    done = columns.copy()
    for order in range(int(rank.max()) + 1):
        at = np.flatnonzero(rank == order)
        own = done[:, at]
        for before in range(order):
            other = done[:, sources.first[sources.point[at]] + before]
            own = own - other * (own * other).sum(axis=0)
        done[:, at] = own / np.maximum(np.sqrt((own * own).sum(axis=0)), 1e-9)
    return done
