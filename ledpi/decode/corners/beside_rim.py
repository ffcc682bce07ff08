"""How far a panel's sides may be from its rim, where what is beside them is bright.

A diffuser may be darker towards the panel's rim. What is beside it and as bright, a white bezel or a wall, hides such a
rim: light then steps up further inside, as sharply as at a side, and only the lattice of the cells ends further out.
But so it does where cells of one size have no half wall at the rim, and there the sides are right. What is seen tells
neither from the other. So the sides stay where they are, and the deviation says how far away the rim may be:
of all sides alike.
"""

from __future__ import annotations

import math

import numpy as np

from ledpi.decode.corners.approach import SHARES
from ledpi.decode.corners.sides import REACH_PX, Patches, Sides, areas, as_points, bends, points_across
from ledpi.geometry import unit_square_to
from ledpi.records import Floats, Frame, Intrinsics, Quad

OUTSIDE_PX = np.array([-3.0, -2.5, -2.0])  # inward of a side: beyond its blur
INSIDE_PX, INSIDE_CELLS = 4.0, 0.5  # further in than a soft rim reaches, and not beyond the middle of a cell
# Of the light inside: a diffuser that light spreads in by itself has half of it left at its edge.
DIMMEST = 0.5
ALIKE = 1e-6  # shares that both ends of a quad lack are told as one number


def unsure(frame: Frame, quad: Quad, cells: int, intrinsics: Intrinsics | None) -> Quad:
    """The same, its deviation as large as what is beside its sides leaves open; of one whose lattice ends beyond them.

    That it does is told by its `rim_wall`, or by its corners where sides have been seen further inside.
    """
    sides = quad.corners_px if quad.seen_px is None else quad.seen_px
    beyond_px = quad.rim_wall * math.sqrt(_area(sides)) + float(np.abs(quad.corners_px - sides).max())
    # Corners that are taken to where the lattice ends may lie beyond the panel's own, whatever is beside these.
    open_px = beyond_px
    if quad.seen_px is None:
        open_px *= min(_light_beside(frame, sides, cells, intrinsics) / DIMMEST, 1.0) ** 2
    return quad.less_sure_of_size(open_px / math.sqrt(3))  # anywhere between the sides and the lattice's end


def ends_lack_alike(quad: Quad) -> bool:
    """Whether a quad that is not seen whole lacks as much at one end as at the other, of each pair of its ends.

    What hides a side does so at one end.
    """
    low, high = _beyond(quad)
    return bool((np.abs(low - high) < ALIKE).all() and (low > -ALIKE).all())


def is_around(quad: Quad) -> bool:
    """Whether what is seen runs around the panel on all sides, as a bezel's outline does."""
    low, high = _beyond(quad)
    return bool((low < 0).all() and (high < 0).all())


def _beyond(quad: Quad) -> tuple[Floats, Floats]:
    """How far the panel reaches beyond what is seen of it, of what is seen: at the left and top, right and bottom."""
    assert quad.seen_px is not None
    whole = np.column_stack([quad.corners_px[[0, 2]], np.ones(2)])
    placed = np.linalg.solve(unit_square_to(quad.seen_px), whole.T)
    first, last = (placed[:2] / placed[2]).T
    return -first, last - 1


def _light_beside(frame: Frame, corners: Floats, cells: int, intrinsics: Intrinsics | None) -> float:
    """Of the light within the sides, how much is right outside of them; the mean of the four sides."""
    quad = as_points(corners[None])
    inside_px = min(INSIDE_PX, INSIDE_CELLS / cells * math.sqrt(_area(corners)))
    patches = Patches(frame, quad, REACH_PX)
    bend = bends(quad, intrinsics).imag @ SHARES.bend
    across = np.append(OUTSIDE_PX, inside_px)
    light = patches.light_at(points_across(Sides.of(quad - patches.first), SHARES.share, across[None], bend))[0]
    outside, inside = np.median(light[..., :-1].mean(axis=2), axis=1), np.median(light[..., -1], axis=1)
    return float((outside / np.maximum(inside, 1e-6)).mean())


def _area(corners: Floats) -> float:
    return abs(float(areas(as_points(corners))))
