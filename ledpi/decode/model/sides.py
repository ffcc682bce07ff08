"""Things that may hide a panel's sides, or lengthen them, by less than its fit tells: a thin strip, a gleam."""

from __future__ import annotations

import math
from statistics import median

import numpy as np

from ledpi.core.records import Floats
from ledpi.decode.model.prior import GAP, RIM

RIMS = np.array([RIM + 2, RIM + 1, RIM + 3, RIM])  # of the sides from one corner to the next: above, right, below, left
# In cells, at either end of a side that something hides: its edge may lie aslant, which draws the lattice there.
ASLANT = 0.06
SIDES = np.arange(4)  # each from the corner of its number to the next
BEFORE, NEXT, AFTER_NEXT = (SIDES + 3) % 4, (SIDES + 1) % 4, (SIDES + 2) % 4
UNEVEN = 1.0 / math.sqrt(3.0)  # of a strip's width, at its ends: as anything between none and twice as much at one


def side_covariance(lattice_px: Floats, unknown: Floats, hidden: Floats, cells: int) -> Floats:
    """(8, 8) px² of what sides may be off beside what the fit says, by its corners (4, 2) and `hidden` (4,).

    A panel is built alike on all sides: light ends with the lattice, or half a wall before. Where the fit has it end
    elsewhere, the fit may be wrong by as much, of each side, at each end, and of all sides together.
    """
    rims, is_hidden = unknown[RIMS], hidden > 0.0
    usual = median(rims[~is_hidden].tolist())
    built = min((0.0, 0.5 * float(unknown[GAP])), key=lambda rim: abs(usual - rim))
    apart = np.where(is_hidden, 0.0, rims - built)
    aslant = np.where(is_hidden, ASLANT, UNEVEN * apart)
    ends = np.zeros((2, 4, 4, 2))  # by a cell inwards at either end of a side: how its corners move
    ends[0, SIDES, SIDES] = (lattice_px[BEFORE] - lattice_px) / cells
    ends[1, SIDES, NEXT] = (lattice_px[AFTER_NEXT] - lattice_px[NEXT]) / cells
    each = ends.reshape(2, 4, 8)
    sides = apart[:, None] * each.sum(axis=0)
    moved = np.vstack([sides, sides.sum(axis=0), *(aslant[:, None] * each)])
    return np.asarray(moved.T @ moved)
