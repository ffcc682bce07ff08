"""Takes the light of every cell of a quad, on a lattice that is the same in each cell.

The lattice makes the panel's static picture easy to remove later: whatever the diffuser does at one place
in a cell, it does at the same place of every cell.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from ledpi.core.records import Floats, Frame, Intrinsics, Mask, Quad, Rejected, Singles
from ledpi.core.tone import linear_light
from ledpi.kernels.lens import bending_lens_of
from ledpi.kernels.library import NONE, doubles, ffi, lib, pointer

# The very rim of a cell is left out: partitions cast shadows there that no smooth interpolation follows. No more than
# that: with its gain unknown, a short cell tells its class by how its light changes from its top to its bottom, so by
# nearly the fourth power of its height.
INSET = 0.06
# Points along a cell. Up to the most, one a pixel: nothing is lost. A panel so close that this is not enough has light
# to spare.
MIN_LATTICE, MAX_LATTICE = 3, 12
# How far across a cell's border its light reaches: lens, pixel and interpolation together have a standard deviation of
# 0.8 to 1.1 px in a focused picture.
BORDER_PX = 2.5
# Of a cell's samples: with less of one its gain is not known, and all is left as it is. (Of an edge that is hidden by
# 12 % of the side 0.16 to 0.5 are left of its cells.)
MIN_LEFT = 0.12
SAME_LATTICE = 0.15  # by how much a panel may grow or shrink and keep its lattice
MIN_CELL_PX = 2.0
# Samples are interpolated by Lanczos: at a wall a pixel wide, a straight line between two pixels is off by more than
# bands are deep. (Saturated pixels would spoil too much of it.) The variance of a sample over a pixel's is the mean of
# the squared weights: (2/3)² for lines in both directions; 0.84, measured, for OpenCV's Lanczos of 8 × 8.
LANCZOS_VARIANCE, LINEAR_VARIANCE = 0.84, 4.0 / 9.0
STEPS = 512  # between two pixels, for which there are weights

TOO_SMALL = Rejected(stage="cells", reason="too_small")
OUTSIDE = Rejected(stage="cells", reason="outside_picture")
SATURATED = Rejected(stage="cells", reason="saturated")
DARK = Rejected(stage="cells", reason="dark")


@dataclass(frozen=True, slots=True, kw_only=True)
class Lattice:
    """`k` × `k` points in each of n × n cells, cell by cell, row by row."""

    cells: int  # n, along one side
    k: int
    u: Singles  # (n·n, k·k), across the panel, 0..1 from its left edge
    v: Singles  # (n·n, k·k), down the panel
    along: Singles  # (n·k,) the places of u, and of v, in order


@dataclass(frozen=True, slots=True, kw_only=True)
class CellSamples:
    """Linear light on the lattice."""

    lattice: Lattice
    light: Singles  # (n·n, k·k), 0 where not valid
    valid: Mask | None  # (n·n, k·k), None where all are
    rows: Singles  # (n·n, k·k), picture row of each sample
    cell_px: tuple[float, float]  # width and height of a cell, in pixels
    independence: float  # what a sample counts for: less than 1 where its neighbours share its noise


@cache
def lattice(cells: int, k: int) -> Lattice:
    """The lattice of a panel of cells × cells; kept, as its points never change."""
    inside = INSET + (np.arange(k) + 0.5) / k * (1.0 - 2.0 * INSET)
    along = ((np.arange(cells)[:, None] + inside[None, :]) / cells).astype(np.float32)  # (n, k)
    shape = (cells, cells, k, k)  # row of cells, column of cells, row in the cell, column in it
    v = np.broadcast_to(along[:, None, :, None], shape).reshape(cells * cells, k * k).copy()
    u = np.broadcast_to(along[None, :, None, :], shape).reshape(cells * cells, k * k).copy()
    return Lattice(cells=cells, k=k, u=u, v=v, along=along.reshape(-1))


def sample_cells(
    frame: Frame, quad: Quad, cells: int, intrinsics: Intrinsics | None = None, like: Lattice | None = None
) -> CellSamples | Rejected:
    """The light of `cells` × `cells` cells inside `quad`, or why it cannot be had.

    On the lattice `like`, where the panel's size still suits it: pictures on one lattice can be compared.
    """
    corners_px = quad.corners_px if quad.lattice_px is None else quad.lattice_px
    cell_px = _cell_px(corners_px, cells)
    if not min(cell_px) >= MIN_CELL_PX:
        return TOO_SMALL
    k = min(max(MIN_LATTICE, round(max(cell_px) * (1 - 2 * INSET))), MAX_LATTICE)
    if like is not None and abs(k - like.k) <= max(1.0, SAME_LATTICE * like.k):
        k = like.k
    points = lattice(cells, k)
    sampled = _sample(frame, corners_px, intrinsics, points)
    if sampled is None:
        return OUTSIDE
    light, rows, saturated, least = sampled
    valid = _valid(light) if math.isnan(least) else DARK if least <= 0 else None
    if isinstance(valid, Rejected):
        return valid
    if quad.hidden is not None:
        valid = _uncovered(quad.hidden, points, cell_px, valid)
    variance = LINEAR_VARIANCE if saturated else LANCZOS_VARIANCE
    return CellSamples(
        lattice=points,
        light=light if valid is None else np.where(valid, light, np.float32(0)),
        valid=valid,
        rows=rows,
        cell_px=cell_px,
        independence=min(1.0, variance * cell_px[0] * cell_px[1] * ((1 - 2 * INSET) / k) ** 2),
    )


def _cell_px(corners: Floats, cells: int) -> tuple[float, float]:
    """`cell_px` of `CellSamples`: by the mean length of opposite sides."""
    a, b, c, d = (complex(x, y) for x, y in corners.tolist())
    return (abs(b - a) + abs(c - d)) / (2 * cells), (abs(c - b) + abs(d - a)) / (2 * cells)


def _uncovered(hidden: Floats, points: Lattice, cell_px: tuple[float, float], valid: Mask | None) -> Mask | None:
    """The samples that lie within what is seen of the panel by more than light reaches; where some of each cell do."""
    inside: Mask = np.ones(points.u.shape, np.bool_) if valid is None else valid.copy()
    for k, place in enumerate((points.v, 1 - points.u, 1 - points.v, points.u)):
        if hidden[k]:
            inside &= points.cells * place > hidden[k] + BORDER_PX / cell_px[1 - k % 2]
    return inside if inside.mean(axis=1).min() >= MIN_LEFT else valid


def _valid(light: Singles) -> Mask | Rejected:
    """Which samples are not saturated, or why they are not enough."""
    valid: Mask = ~np.isnan(light)
    if valid.sum(axis=1).min() < light.shape[1] // 4:
        return SATURATED
    return DARK if np.nansum(light, axis=1).min() <= 0 else valid


@cache
def _lanczos() -> Singles:
    """(STEPS + 1, 8) weights of the pixels −3 … 4 for every share of the way from pixel 0 to 1, their sum 1."""
    away = np.arange(-3, 5) - np.arange(STEPS + 1)[:, None] / STEPS
    weights = np.sinc(away) * np.sinc(away / 4)
    return np.ascontiguousarray(weights / weights.sum(axis=1, keepdims=True), np.float32)


def _sample(
    frame: Frame, corners_px: Floats, lens: Intrinsics | None, points: Lattice
) -> tuple[Singles, Singles, bool, float] | None:
    """Light and picture rows (cells², k²) on the lattice inside `corners_px` (4, 2), bent as the `lens` does (cells.c).

    And whether a pixel of those that this takes in is saturated, and the least sum of light over a cell, not a number
    where that spoils a sample. None where corners or points leave the picture. Raises MemoryError.
    """
    light, rows = np.empty(points.u.shape, np.float32), np.empty(points.u.shape, np.float32)
    least, corners = np.empty(1), doubles(corners_px)
    pixels = frame.pixels if frame.pixels.strides[1] == 1 else np.ascontiguousarray(frame.pixels)
    first = ffi.cast("uint8_t *", pixels.__array_interface__["data"][0])  # rows may be apart
    bending = bending_lens_of(lens)
    outcome = lib.ledpi_sample_cells(
        *(first, *pixels.shape, pixels.strides[0], pointer(linear_light(frame.transfer, mark_saturated=True))),
        *(pointer(corners), NONE if bending is None else pointer(bending), points.cells, points.k),
        *(pointer(points.along), pointer(_lanczos()), STEPS, pointer(light), pointer(rows), pointer(least)),
    )
    if outcome == lib.LEDPI_NOT_SAMPLED:
        raise MemoryError
    if outcome == lib.LEDPI_OUTSIDE:
        return None
    return light, rows, outcome == lib.LEDPI_SOME_SATURATED, float(least[0])
