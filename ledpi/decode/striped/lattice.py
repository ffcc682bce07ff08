"""Points spread evenly over the cells of a panel, and where they are seen in squares that may be turned away."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache, lru_cache

import numpy as np

from ledpi.decode.corners.sides import Points
from ledpi.records import Floats, HiddenSide, Singles


@dataclass(frozen=True, slots=True, eq=False)
class Lattice:
    """Points in the cells of a panel, cell by cell, each standing for as much of it.

    In a cell they are a Fibonacci lattice: no two in one row, so that no bands fall between its rows.
    """

    across: Singles  # (cells², P) 0..1
    down: Singles
    of_cells: Singles  # (cells², P) share of the panel, in the open part of cells
    of_walls: Singles  # (cells², P) and between them

    @classmethod
    def of(cls, cells: int, points: int, step: int, wall: float) -> Lattice:
        """With so many points in a cell; the next in a lower row is `step` of them further, around the cell.

        `wall`: what may be dark on either side of a border between cells, as a share of the cell.
        """
        order = np.arange(points)
        down, across = (order + 0.5) / points, (order * step % points + 0.5) / points
        number = np.arange(cells)
        u = np.broadcast_to((number[None, :, None] + across) / cells, (cells, cells, points)).reshape(-1, points)
        v = np.broadcast_to((number[:, None, None] + down) / cells, (cells, cells, points)).reshape(-1, points)
        border = [np.abs(w * cells - np.clip(np.round(w * cells), 1, cells - 1)) < wall for w in (u, v)]
        walls = (border[0] | border[1]) / u.size
        return cls(*(np.asarray(part, np.float32) for part in (u, v, 1 / u.size - walls, walls)))


@cache
def rough_lattice(cells: int) -> Lattice:
    """Few points, for a first look."""
    return Lattice.of(cells, 8, 5, 0.0)


@cache
def fine_lattice(cells: int) -> Lattice:
    """Points enough to see walls: what is dark there is not the cell's."""
    return Lattice.of(cells, 55, 34, 0.04)


@lru_cache(maxsize=16)
def lattice_beside(cells: int, hidden: HiddenSide | None) -> Lattice:
    """The fine one, of which points that are hidden stand for nothing."""
    every = fine_lattice(cells)
    if hidden is None:
        return every
    there = hidden.has(every.across, every.down)
    of_cells, of_walls = (np.where(there, np.float32(0), part) for part in (every.of_cells, every.of_walls))
    return replace(every, of_cells=of_cells, of_walls=of_walls)


def lattice_places(corners: Points, lattice: Lattice) -> tuple[Singles, Singles, Singles]:
    """(N, cells², P) each: x, y, and relative depth of a lattice's points in quads (N, 4).

    Of the homography from the unit square, as `geometry.unit_square_to`, for many at once.
    """
    c0, c1, _, c3 = corners.T
    g, h = _perspective(corners)
    across, down = c1 - c0 + g * c1, c3 - c0 + h * c3
    values = np.stack([g, h, across.real, down.real, c0.real, across.imag, down.imag, c0.imag]).astype(np.float32)
    g_, h_, xu, xv, x0, yu, yv, y0 = values[:, :, None, None]
    u, v = lattice.across, lattice.down
    depth = g_ * u + h_ * v + np.float32(1)
    return (xu * u + xv * v + x0) / depth, (yu * u + yv * v + y0) / depth, depth


def unlike_a_square(corners: Points, focal_px: float) -> Floats:
    """(N,) how much depth across quads (N, 4) differs from that of a square that is foreshortened as they are.

    A square turned by τ from the line of sight is shorter by cos τ across the axis that it is turned about, and over
    its height its relative depth changes by sin τ times its side over its distance, which is its longer side over the
    focal length. It may be nearer at either end.
    """
    c0, c1, c2, c3 = corners.T
    across, down = 0.5 * (c1 + c2 - c0 - c3), 0.5 * (c3 + c2 - c0 - c1)
    g, h = _perspective(corners)
    depth = (g + 1j * h) / (1 + 0.5 * (g + h))  # change of relative depth, across and down
    u, v, both = np.square(np.abs(across)), np.square(np.abs(down)), (across.conj() * down).real
    root = np.hypot(u - v, 2 * both)
    expected = np.sqrt(root) / focal_px  # longer side² less shorter side²
    shortened = 1j * np.exp(0.5j * np.arctan2(2 * both, u - v))  # the way, in the square, in which it is shorter
    off: Floats = np.minimum(np.abs(depth - expected * shortened), np.abs(depth + expected * shortened))
    return off


def _perspective(corners: Points) -> tuple[Floats, Floats]:
    """(N,) each: by how much relative depth changes across and down the unit square that is seen at corners (N, 4)."""
    c0, c1, c2, c3 = corners.T
    far, near, all_four = c1 - c2, c3 - c2, c0 - c1 + c2 - c3
    det = (far.conj() * near).imag
    return (all_four.conj() * near).imag / det, (far.conj() * all_four).imag / det
