"""Takes the light of every cell of a quad, on a lattice that is the same in each cell.

The lattice makes the panel's static picture easy to remove later: whatever the diffuser does at one place
in a cell, it does at the same place of every cell.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import cv2
import numpy as np

from ledpi.core.geometry import project_to_quad
from ledpi.core.lens import bending_lens_of, distort, undistort
from ledpi.core.records import Floats, Frame, Intrinsics, Mask, Quad, Rejected, Singles
from ledpi.core.tone import linear_light

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
    light, rows = sampled
    saturated = bool(np.isnan(light).any())
    valid = _valid(light) if saturated else DARK if light.sum(axis=1).min() <= 0 else None
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


def _sample(
    frame: Frame, corners_px: Floats, lens: Intrinsics | None, points: Lattice
) -> tuple[Singles, Singles] | None:
    """Light, NaN where saturated, and picture rows (cells², k²) on the lattice inside `corners_px` (4, 2).

    None where corners or points leave the picture.
    """
    bending = None if bending_lens_of(lens) is None else lens
    rays = corners_px if bending is None else undistort(corners_px, bending)
    places = np.stack([points.u, points.v], axis=-1).astype(np.float64)
    seen = project_to_quad(rays, places.reshape(-1, 2))
    at = np.float32(seen if bending is None else distort(seen, bending)).reshape(*points.u.shape, 2)
    size = np.array(frame.pixels.shape[::-1]) - 1
    for inside in (corners_px, at):
        if not ((inside >= 0) & (inside <= size)).all():  # neither is what is not a number
            return None
    light = cv2.LUT(frame.pixels, linear_light(frame.transfer, mark_saturated=True))
    spoilt = bool(np.isnan(light[_around(at, size)]).any())
    method = cv2.INTER_LINEAR if spoilt else cv2.INTER_LANCZOS4
    found = cv2.remap(light, at[..., 0], at[..., 1], method, borderMode=cv2.BORDER_REPLICATE)
    return np.asarray(found, np.float32), np.ascontiguousarray(at[..., 1])


def _around(at: Singles, size: Floats) -> tuple[slice, slice]:
    """The rows and columns of the picture that the interpolation takes in."""
    first, last = at.min(axis=(0, 1)).astype(int) - 3, at.max(axis=(0, 1)).astype(int) + 5
    (left, top), (right, bottom) = np.maximum(first, 0), np.minimum(last, size.astype(int) + 1)
    return slice(top, bottom), slice(left, right)
