"""Light that the cells of a panel share: at a point of each, from itself and from across its borders.

All cells are built alike and seen through one lens, so at each lattice point the light of all cells lies in the space
that few unknowns span: the profile there, times each cell's own gain; what the optics mix in of its neighbours', times
theirs; and how else cells look at the panel's rim. An orthonormal basis of that space is what to project out
(`evidence` has the equation).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from itertools import product

import numpy as np

from ledpi.core.records import Integers
from ledpi.decode.evidence.cells import BORDER_PX, INSET, CellSamples


@dataclass(frozen=True, slots=True, kw_only=True)
class Sources:
    """The cells that may light up each lattice point: P columns of `_CONTRIBUTOR_GROUPS`, one point after the other."""

    column: Integers  # (P,)
    first: Integers  # (points,) where each point's begin


def border_points(samples: CellSamples) -> tuple[int, int]:
    """Counts the points at either end of a cell that a neighbour may light up: across, down.

    One at least: where the outermost point of a large cell is out of a neighbour's reach, a wall may still shade it,
    and none stands at the panel's rim.
    """
    k, (width, height) = samples.lattice.k, samples.cell_px
    return _border_points(k, width), _border_points(k, height)


def _border_points(k: int, cell_px: float) -> int:
    step = cell_px * (1 - 2 * INSET) / k
    return min(max(math.ceil((BORDER_PX - INSET * cell_px) / step - 0.5), 1), k // 2)


# What lights up a point near one or two of its cell's sides, each given as (down, across): the cell itself, the
# neighbour beyond each side, and at the panel's rim, where no wall stands or another one than between two cells, the
# cell once more. Neighbours across a corner add too little to matter.
_SIDES = ((-1, 0), (1, 0), (0, -1), (0, 1))
_CONTRIBUTOR_GROUPS = (*(((y, 0), (0, x)) for y in (-1, 1) for x in (-1, 1)), *((side,) for side in _SIDES))
_GROUP_COLUMNS = 5  # columns of each meeting, the last two of those of one side being empty


@cache
def sources_of(k: int, border: tuple[int, int]) -> Sources:
    """For k × k points a cell, of which the outer `border` (across, down) are near a border."""
    across, down = (np.where(np.arange(k) < b, -1, np.where(np.arange(k) >= k - b, 1, 0)).tolist() for b in border)
    column: list[int] = []
    first: list[int] = []
    for y, x in product(down, across):
        sides = tuple(side for side in ((y, 0), (0, x)) if any(side))
        count = 1 + 2 * len(sides)
        begin = _GROUP_COLUMNS * _CONTRIBUTOR_GROUPS.index(sides) if sides else 0
        first.append(len(column))
        column += range(begin, begin + count)
    return Sources(column=np.array(column), first=np.array(first))


@cache
def contributing_cells(cells: int) -> Integers:
    """(cells, 40): which cells meet there; where there is none, one more than all."""
    none = cells * cells
    own = np.arange(none).reshape(cells, cells)
    around = np.pad(own, 1, constant_values=none)
    columns = []
    for sides in _CONTRIBUTOR_GROUPS:
        beyond = [around[1 + y : 1 + y + cells, 1 + x : 1 + x + cells] for y, x in sides]
        at_rim = [np.where(there == none, own, none) for there in beyond]
        empty = [np.full_like(own, none)] * (_GROUP_COLUMNS - 1 - 2 * len(sides))
        columns += [each.reshape(-1) for each in (own, *beyond, *at_rim, *empty)]
    return np.stack(columns, axis=1)
