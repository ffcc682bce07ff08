"""Sub-pixel corners of lit squares: straight sides through what profiles across them show, all squares at once.

A side's place comes from the mean of its profiles and the filter that a lattice's rim calls for (`rim`); how it is
turned, from where each profile has its edge.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np

from ledpi.decode.approach import (
    FINEST_STEP_PX,
    LOST,
    NOT_STRAIGHT,
    is_step,
    nearest_sides,
    root_mean_square,
    seen_on_all_sides,
)
from ledpi.decode.rim import ACROSS, USUAL_BLUR_PX, filter_key, rim_filter
from ledpi.decode.sides import (
    NEXT,
    Mask,
    Patches,
    Points,
    Shares,
    Sides,
    Singles,
    areas,
    as_corners,
    as_points,
    bends,
    cross,
    deviations,
    fit_lines,
    points_across,
)
from ledpi.records import Floats, Frame, Intrinsics, Quad, Rejected

NOT_CONVEX = Rejected(stage="edges", reason="not_convex")
AT_BORDER = Rejected(stage="edges", reason="at_picture_border")
TOO_SMALL = Rejected(stage="edges", reason="too_small")

MIN_SIDE_PX = 7.0
PROFILES = 48  # a side
CELL_INSET = 0.18  # of a cell's pitch at its ends, where no profile is: gaps and corners
ROUNDS = 2
MAX_STEP_PX = 2.0  # by which a side moves in a round: no filter sees further
# The edges of a panel lie on a line to a tenth of a pixel, those of most other things do not by far.
MAX_SPREAD_PX = 0.5
MAX_MOVE = 0.2  # of the side: what moves further when looked at closely was not there
BORDER_PX = 1.0
REACH_PX = 8.0  # around the corners that are given: as far as any profile may reach
MAX_BLUR_CHANGE = 0.4  # of its logarithm, in a round


@dataclass(frozen=True, slots=True)
class _Fit:
    """What a round has found of N quads."""

    sides: Sides
    blur_px: Floats  # (N, 2) of either pair of opposite sides
    weights: Floats  # (N, 4, P) of the profiles
    spread: Floats  # (N, 4) of the profiles' edges about each side, in pixels
    variance: Floats  # (N, 4) of a side's place, by what the filter leaves open
    seen: Mask  # (N,) whether all sides show edges


@np.errstate(divide="ignore", invalid="ignore")  # parallel sides cross nowhere: not finite, and refused
def refine_quads(
    frame: Frame, near: Floats, cells: int, intrinsics: Intrinsics | None = None, *, striped: bool = False
) -> list[Quad | Rejected]:
    """Sub-pixel corners of each lit square of `cells` × `cells` whose corners are within 2 px of `near` (N, 4, 2).

    Or why there are none. In a `striped` picture the rim may be too dark for that; then `near` is as good as it gets.
    """
    if not len(near):
        return []
    start = as_points(near)
    reach = MAX_MOVE * np.sqrt(np.abs(areas(start)))
    bend = bends(start, intrinsics)
    patches = Patches(frame, start, REACH_PX)
    within = start - patches.first
    corners, spread, seen = nearest_sides(
        patches.light_at, within, np.full(len(near), FINEST_STEP_PX), outermost=striped
    )
    there = np.asarray(seen & (np.abs(corners - within).max(axis=1) < reach))  # False where not finite
    if striped:
        there &= spread <= MAX_SPREAD_PX
        corners = np.where(there[:, None], corners, within)
        return _quads(frame, corners + patches.first, np.full(len(near), MAX_SPREAD_PX), bend)
    shares, sides = _shares(cells), Sides.of(np.where(there[:, None], corners, within))
    fit = _Fit(
        sides=sides,
        blur_px=np.full((len(near), 2), USUAL_BLUR_PX),
        weights=np.ones((len(near), 4, len(shares.share))),
        spread=np.zeros((len(near), 4)),
        variance=np.zeros((len(near), 4)),
        seen=seen,
    )
    pitch_px, along_bend = _pitches(sides, cells), bend @ shares.bend
    for _ in range(ROUNDS):
        fit = _fit_again(patches, fit, pitch_px, along_bend, shares)
    there &= fit.seen & (np.abs(fit.sides.start - within).max(axis=1) < reach)
    straight = np.asarray(root_mean_square(fit.spread) <= MAX_SPREAD_PX)
    quads = _quads(frame, fit.sides.start + patches.first, _corner_sigma(fit), bend)
    return [
        quad if there[i] and straight[i] else NOT_STRAIGHT if there[i] else LOST for i, quad in enumerate(quads)
    ]


@cache
def _shares(cells: int) -> Shares:
    """Within each cell of a side, away from its ends."""
    each = max(1, round(PROFILES / cells))
    within = np.linspace(CELL_INSET, 1 - CELL_INSET, each)
    return Shares.at(((np.arange(cells)[:, None] + within) / cells).reshape(-1))


def _fit_again(patches: Patches, fit: _Fit, pitch_px: Floats, bend: Floats, shares: Shares) -> _Fit:
    """A closer look from where the sides are held to be."""
    sides, count = fit.sides, len(fit.seen)
    filters = [
        _square_filter(*filter_key(pitch[0], blur[0]), *filter_key(pitch[1], blur[1]))
        for pitch, blur in zip(pitch_px.tolist(), fit.blur_px.tolist(), strict=True)
    ]
    light = patches.light_at(points_across(sides, shares.share, ACROSS[None], bend))
    single = light @ np.array([f.single for f in filters])
    height = single[..., 1].astype(np.float64)
    good = is_step(height)
    height[~good] = np.inf
    found = single[..., 0] / height - np.array([f.single_offset for f in filters])[..., None]
    middle, slope = fit_lines(shares, found, good * fit.weights)
    spread, weights = deviations(shares, found, good, middle, slope)
    total = np.maximum(weights.sum(axis=-1), 1e-9)
    mean = ((weights / height)[..., None, :].astype(np.float32) @ light)[..., 0, :] / total[..., None]
    place = (np.array([f.place for f in filters]) @ mean.reshape(count, -1, 1))[..., 0]
    place += np.array([f.place_offset for f in filters])
    # The mean profile is at its profiles' mean share of the way.
    middle = np.clip(place[:, :4], -MAX_STEP_PX, MAX_STEP_PX) - slope * ((weights @ shares.powers[:, 1]) / total)
    corners = sides.moved(middle, slope)
    finite = np.asarray(np.isfinite(corners).all(axis=1))
    return _Fit(
        sides=Sides.of(np.where(finite[:, None], corners, sides.start)),
        blur_px=fit.blur_px * np.exp(np.clip(place[:, 4:], -MAX_BLUR_CHANGE, MAX_BLUR_CHANGE)),
        weights=weights,
        spread=spread,
        variance=np.array([f.variance for f in filters]),
        seen=np.asarray(finite & seen_on_all_sides(good)),
    )


def _pitches(sides: Sides, cells: int) -> Floats:
    """(N, 2) the rim cells' width as seen across either pair of opposite sides, in pixels."""
    opposite = sides.start[:, [2, 3, 0, 1]] + 0.5 * sides.along[:, [2, 3, 0, 1]] - sides.start
    depth = (opposite * sides.inward.conj()).real
    # Perspective: along the way to the opposite side things shrink as these two sides do.
    shrunk = sides.length / np.maximum((1 - 1 / cells) * sides.length[:, [2, 3, 0, 1]] + sides.length / cells, 1e-9)
    pitch = depth / cells * shrunk
    return 0.5 * (pitch[:, :2] + pitch[:, 2:])


@dataclass(frozen=True, slots=True)
class _SquareFilter:
    """A square's four sides' filters, ready to be applied together; T light values across each."""

    single: Singles  # (4, T, 2) of one profile: A·(e + offset), and A
    single_offset: Floats  # (4,)
    place: Floats  # (6, 4·T) of the sides' mean profiles: each side's place, and the blurs' logarithms
    place_offset: Floats  # (6,)
    variance: Floats  # (4,) of the places


@lru_cache(maxsize=2048)
def _square_filter(pitch_a: int, blur_a: int, pitch_b: int, blur_b: int) -> _SquareFilter:
    """For sides 0 and 2 (a), and 1 and 3 (b)."""
    pairs = (rim_filter(pitch_a, blur_a), rim_filter(pitch_b, blur_b))
    place, offset = np.zeros((6, 4, len(ACROSS))), np.zeros(6)
    for k, pair in enumerate(pairs):
        place[k, k], place[k, k + 2] = pair.both[0] + pair.apart, pair.both[0] - pair.apart
        place[k + 2, k], place[k + 2, k + 2] = pair.both[0] - pair.apart, pair.both[0] + pair.apart
        place[4 + k, k] = place[4 + k, k + 2] = pair.both[1]
        offset[[k, k + 2]], offset[4 + k] = pair.both_offset[0], pair.both_offset[1]
    return _SquareFilter(
        single=np.array([pairs[k % 2].single for k in range(4)], np.float32),
        single_offset=np.array([pairs[k % 2].single_offset for k in range(4)]),
        place=(0.5 * place).reshape(6, -1),
        place_offset=offset,
        variance=np.array([pairs[k % 2].variance for k in range(4)]),
    )


def _corner_sigma(fit: _Fit) -> Floats:
    """(N,) standard deviation of a corner's coordinates."""
    # Profiles nearer to each other than a pixel are not independent.
    profiles = np.minimum(fit.weights.sum(axis=-1), fit.sides.length)
    # At its ends a line through n points is off by 2 of their deviations over √n.
    variance = fit.variance + 4 * np.square(fit.spread) / np.maximum(profiles, 1.0)
    sine = cross(fit.sides.inward, fit.sides.inward[:, NEXT])
    # Where two lines with independent errors cross at that angle.
    sigma: Floats = np.sqrt((variance / np.maximum(sine * sine, 1e-3)).mean(axis=1))
    return sigma


def _quads(frame: Frame, corners: Points, sigma_px: Floats, bend: Floats) -> list[Quad | Rejected]:
    """Records of what has the shape of a square and is wholly in the picture."""
    along = corners[:, NEXT] - corners
    convex = np.asarray((cross(along, along[:, NEXT]) > 0).all(axis=1))
    large = np.asarray(areas(corners) >= MIN_SIDE_PX**2)
    height, width = frame.pixels.shape
    x, y = corners.real, corners.imag
    from_border = np.minimum(np.minimum(x, width - 1 - x), np.minimum(y, height - 1 - y)).min(axis=1)
    exact, most_bent = as_corners(corners), np.abs(bend).max(axis=(1, 2)).tolist()
    return [
        NOT_CONVEX
        if not convex[i]
        else TOO_SMALL
        if not large[i]
        else AT_BORDER
        if not from_border[i] >= BORDER_PX
        else Quad(corners_px=exact[i], corner_sigma_px=float(sigma_px[i]), bend_px=most_bent[i])
        for i in range(len(corners))
    ]
