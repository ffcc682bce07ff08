"""A panel's corners by all the lines of its lattice at once: its sides, and where its cells meet.

Each side's place is known as well as the rim's filter lets it be, and less where something bright or dark touches it
from outside; the inner lines are looked at by what is within the panel alone. All of them are lines of one lattice seen
in perspective, so that a homography and the sides' own errors explain them: a least-squares adjustment. How exact each
kind is is taken from how well it agrees with itself (components of variance, after Helmert).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from ledpi.decode.corners.inner_lines import NOT_SEEN_PX2, Homographies, inner_lines, lens_moves, line_places
from ledpi.decode.corners.rim import ACROSS, PAIRS_ALIKE, USUAL_BLUR_PX, RimFilter, filter_key, rim_filter
from ledpi.decode.corners.sides import Patches, Points, Shares, Sides, areas, as_corners, as_points, points_across
from ledpi.decode.corners.whole import NO_RIM_WALL
from ledpi.records import Floats, Frame, Intrinsics, Mask, Quad, Rejected

PLACES = np.linspace(0.2, 0.8, 6)  # along each cell at a side
# Deviation of what a line of the lattice shows over one cell's length, to begin with: as a panel is built, or a picture
# of it drawn.
BUILT_PX = 0.05
LEAST_VARIANCE = 0.2  # of what is expected to begin with: how much better a few lines may seem to agree
LOOSE = 0.01  # weight of the sides while it is found how well the inner lines agree
HUBER = 2.0  # deviations beyond which a measurement counts by its distance, not that one's square
FARTHEST = 4.0  # deviations: beyond, it says nothing of how exact the others are
# What would move a corner further is no lattice of a panel. A side that leans on a frame, or on what touches it, is off
# by a pixel; the inner lines tell, within half a wall and its blur.
MOST_PX = 2.0
# What would move every side outward is none that ends where its light does: cells of one size with walls between them
# have no half wall at the rim. The sides are where they are seen. (Those of other panels move by up to 0.1 px.)
NO_RIM_WALL_PX = 0.2
# Where lines are nearer to each other than that, their blurs run together, and the sides are better known.
MIN_PITCH_PX = 6.0
LEAST_CELLS = 3  # a side: of fewer, nothing is left over to tell how well the sides' cells agree
MOVES = 8  # small changes of a homography
REACH_PX = 4.0  # around the corners: as far as profiles reach
_OPPOSITE = np.array([[1, 0, 1, 0], [0, 1, 0, 1], [1, 0, 1, 0], [0, 1, 0, 1]])
_ALIKE, _APART = np.where(_OPPOSITE, 1.0, PAIRS_ALIKE), 2.0 * np.eye(4) - _OPPOSITE
LEAST_HEIGHT = 0.3  # of the step at a side, of the median: less is a dead cell's


@dataclass(frozen=True, slots=True, eq=False)
class Design:
    """How measurements depend on 8 parameters of a homography, in the unit square, and on 4 sides' own shifts."""

    u: Floats  # (M,) where they are: the inner lines', then the four sides' cells
    v: Floats
    by_u: Mask  # (M,) whether along u, else along v
    moves: Floats  # (M, 8)
    shifts: Floats  # (M, 4)
    corners: Floats  # (4, 2, 8) the corners' moves along u and v


@cache
def design(cells: int) -> Design:
    u, v = line_places(cells)
    by_u = np.arange(len(u)) < len(u) // 2
    middle = (np.arange(cells) + 0.5) / cells
    none, one = np.zeros(cells), np.ones(cells)
    u = np.concatenate([u, middle, one, 1 - middle, none])
    v = np.concatenate([v, none, middle, one, 1 - middle])
    by_u = np.concatenate([by_u, np.repeat([False, True, False, True], cells)])
    along_u, along_v = _moves(u, v)
    shifts = np.zeros((len(u), 4))
    inward = np.repeat([1.0, -1.0, -1.0, 1.0], cells)  # along u or v
    shifts[np.arange(len(u) - 4 * cells, len(u)), np.repeat(np.arange(4), cells)] = inward
    corners = np.stack(_moves(np.array([0, 1, 1, 0.0]), np.array([0, 0, 1, 1.0])), axis=1)
    return Design(u, v, by_u, np.where(by_u[:, None], along_u, along_v), shifts, corners)


def _moves(u: Floats, v: Floats) -> tuple[Floats, Floats]:
    """(K, 8) how the eight small changes of a homography move places along u, and along v."""
    none, one = np.zeros_like(u), np.ones_like(u)
    return (
        np.stack([one, u, v, none, none, none, u * u, u * v], axis=1),
        np.stack([none, none, none, one, u, v, u * v, v * v], axis=1),
    )


def adjust_quads(
    frame: Frame, found: list[Quad | Rejected], whole: Mask, bend: Points, cells: int, intrinsics: Intrinsics | None
) -> list[Quad | Rejected]:
    """The same, with better corners where they are of a `whole` (N,) panel that is near enough.

    `bend` (N, 4, 2): its sides' `bends`.
    """
    if cells < LEAST_CELLS:
        return found
    panels = {i: quad for i, quad in enumerate(found) if isinstance(quad, Quad) and whole[i]}
    all_corners = {i: as_points(quad.corners_px) for i, quad in panels.items()}
    of = [i for i, corners in all_corners.items() if areas(corners) > (cells * MIN_PITCH_PX) ** 2]
    if not of:
        return found
    corners = np.array([all_corners[i] for i in of])
    better, sigmas_px, rim_wall = _adjusted(frame, corners, bend[of], cells, intrinsics)
    adjusted = list(found)
    for i, at, (sigma, size), wall in zip(of, as_corners(better), sigmas_px.tolist(), rim_wall.tolist(), strict=True):
        if math.isfinite(sigma):
            adjusted[i] = replace(panels[i], corners_px=at, corner_sigma_px=sigma, size_sigma_px=size)
        elif wall:
            adjusted[i] = replace(panels[i], rim_wall=wall)
    return adjusted


def _adjusted(
    frame: Frame, found: Points, bend: Points, cells: int, intrinsics: Intrinsics | None
) -> tuple[Points, Floats, Floats]:
    """Better corners (N, 4), the deviation of their coordinates and what all sides share of it, (N, 2).

    And how much a rim without walls lacks (N,). The deviations are no numbers where the lines are no panel's that ends
    with the lattice.
    """
    patches = Patches(frame, found, REACH_PX)
    corners = found - patches.first
    measured, homographies = design(cells), Homographies.of(corners)
    _, by_u, by_v = homographies.at(measured.u, measured.v)
    # A line runs along v, and is crossed by u, or the other way round: pixels across it, by a unit of u or v.
    scale = np.abs((by_u.conj() * by_v).imag) / np.where(measured.by_u, np.abs(by_v), np.abs(by_u))
    inner = 2 * cells * (cells - 1)
    pitch_px = scale[:, :inner].reshape(-1, 2, inner // 2).mean(axis=2) / cells
    moved_px = lens_moves(found, cells, intrinsics)
    lines, variance = inner_lines(patches, homographies, pitch_px, moved_px, cells)
    rim, rim_variance, shift_covariance = _rims(patches, corners, bend, pitch_px, cells)
    seen = np.concatenate([lines, rim * measured.shifts[inner:].sum(axis=1)], axis=1)
    variance = np.concatenate([variance + BUILT_PX**2, rim_variance], axis=1)
    slopes = np.concatenate(
        [measured.moves * scale[..., None], np.broadcast_to(measured.shifts, (len(seen), *measured.shifts.shape))],
        axis=2,
    )
    moves, covariance = _least_squares(slopes, seen, variance, shift_covariance, inner)
    _, by_u, by_v = homographies.at(np.array([0, 1, 1, 0.0]), np.array([0, 0, 1, 1.0]))
    by_move = by_u[..., None] * measured.corners[:, 0] + by_v[..., None] * measured.corners[:, 1]  # (N, 4, 8)
    step = (by_move @ moves[:, :8, None])[..., 0]
    both = np.concatenate([by_move.real, by_move.imag], axis=1)
    variance_px2 = ((both @ covariance[:, :8, :8]) * both).sum(axis=2).mean(axis=1)
    inward = Sides.of(corners).inward
    outward = _outward(step, inward)
    by_outward = _outward(by_move.swapaxes(1, 2), inward[:, None]).mean(axis=2)[:, None]  # (N, 1, 8), of all sides
    size_px2 = (by_outward @ covariance[:, :8, :8] @ by_outward.swapaxes(1, 2))[:, 0, 0]
    # What the lattice moves all sides by is a wall that the rim has half of, or not: anywhere between.
    between_px2 = np.square(outward.mean(axis=1)) / 3
    sigmas_px = np.sqrt(np.stack([variance_px2, size_px2], axis=1) + between_px2[:, None])
    further = outward.min(axis=1) >= NO_RIM_WALL_PX
    fits = (np.abs(step).max(axis=1) < MOST_PX) & ~further
    share = outward.mean(axis=1) / np.sqrt(np.abs(areas(corners)))
    rim_wall = np.where(further & (share < NO_RIM_WALL), share, 0.0)
    return found + step, np.where(fits[:, None], sigmas_px, np.nan), rim_wall


def _outward(step: Points, inward: Points) -> Floats:
    """(…, 4) by how much each side moves outward, in its middle, where corners (…, 4) take a step."""
    middles = 0.5 * (step + np.roll(step, -1, axis=-1))
    outward: Floats = -(middles * inward.conj()).real
    return outward


def _rims(
    patches: Patches, corners: Points, bend: Points, pitch_px: Floats, cells: int
) -> tuple[Floats, Floats, Floats]:
    """How much further in than its side each rim cell begins, (N, 4·cells) pixels, the variance, and (N, 4, 4).

    That is the covariance of how much further in the sides themselves are. Only how the cells of a side differ is told
    by their light: the filter for single profiles leaves out what is the same for all.
    """
    shares = _rim_shares(cells)
    light = patches.light_at(points_across(Sides.of(corners), shares.share, ACROSS[None], bend.imag @ shares.bend))
    light = light.reshape(*light.shape[:2], cells, len(PLACES), -1).mean(axis=3)
    # Going inward from sides 0 and 2 is along v, from 1 and 3 along u.
    filters = [
        [rim_filter(*filter_key(pitch, USUAL_BLUR_PX)) for pitch in (along_v, along_u)]
        for along_u, along_v in pitch_px.tolist()
    ]
    single = light @ np.array([[pair[k % 2].single for k in range(4)] for pair in filters], np.float32)
    height = single[..., 1].astype(np.float64)
    usual = np.median(height, axis=(1, 2), keepdims=True)
    shown = height > np.maximum(LEAST_HEIGHT * usual, 1e-6)
    begins = np.where(shown, single[..., 0] / np.where(shown, height, 1.0), 0.0)
    begins -= begins.sum(axis=2, keepdims=True) / np.maximum(shown.sum(axis=2, keepdims=True), 1)
    begins = (begins * shown).reshape(len(begins), -1)
    spread = np.square(begins).sum(axis=1, keepdims=True) / (4 * cells - 8)
    variance = np.where(shown.reshape(begins.shape), BUILT_PX**2 + spread, NOT_SEEN_PX2)
    covariance = _shift_covariance([[pair[k % 2] for k in range(4)] for pair in filters])
    return begins, variance, covariance + np.eye(4) * (spread / cells)[..., None]


def _shift_covariance(filters: list[list[RimFilter]]) -> Floats:
    """(N, 4, 4) of how far further in four sides are than the filters (N, 4) say.

    Opposite sides err alike in what they share, and that is nearly the same for both pairs.
    """
    both = np.sqrt([[f.both_variance for f in four] for four in filters])
    apart = np.sqrt([[f.apart_variance for f in four] for four in filters])
    covariance: Floats = both[:, :, None] * both[:, None] * _ALIKE + apart[:, :, None] * apart[:, None] * _APART
    return covariance


@cache
def _rim_shares(cells: int) -> Shares:
    return Shares.at(((np.arange(cells)[:, None] + PLACES) / cells).reshape(-1))


def _least_squares(
    slopes: Floats, seen: Floats, variance: Floats, shift_covariance: Floats, inner: int
) -> tuple[Floats, Floats]:
    """The 12 parameters (N, 12) that explain what is `seen` (N, M), and their covariance (N, 12, 12).

    `slopes` (N, M, 12), `variance` (N, M) to begin with; the first `inner` of M are of inner lines. The last four
    parameters are expected to be 0 with `shift_covariance` (N, 4, 4).
    """
    columns = slopes.shape[2]
    prior = np.zeros((len(seen), columns, columns))
    prior[:, 8:, 8:] = np.linalg.inv(shift_covariance)
    turned = slopes.transpose(0, 2, 1)

    def solved(weights: Floats, prior: Floats) -> tuple[Floats, Floats, Floats]:
        weighted = turned * weights[:, None]
        information = weighted @ slopes + prior
        moves = np.asarray(np.linalg.solve(information, weighted @ seen[..., None]), np.float64)
        return moves[..., 0], information, seen - (slopes @ moves)[..., 0]

    # The inner lines by themselves, then the sides beside them.
    weights = 1.0 / variance
    sides_loose = np.where(np.arange(len(seen[0])) < inner, weights, LOOSE * weights)
    left = solved(sides_loose, LOOSE * prior)[2]
    weights[:, :inner] /= _agreement(left[:, :inner], weights[:, :inner], 8)
    left = solved(weights, prior)[2]
    weights[:, inner:] /= _agreement(left[:, inner:], weights[:, inner:], 8)
    away = np.abs(left) * np.sqrt(weights)
    moves, information, _ = solved(weights * np.minimum(1.0, HUBER / np.maximum(away, HUBER)), prior)
    return moves, np.asarray(np.linalg.inv(information), np.float64)


def _agreement(left: Floats, weights: Floats, parameters: int) -> Floats:
    """(N, 1) variance of what is `left` (N, K) unexplained over what was expected; `parameters` took their share."""
    measured = (weights > 1.0 / NOT_SEEN_PX2).sum(axis=1, keepdims=True)
    total = np.minimum(np.square(left) * weights, FARTHEST**2).sum(axis=1, keepdims=True)
    ratio: Floats = np.maximum(total / np.maximum(measured - parameters, 1), LEAST_VARIANCE)
    return ratio
