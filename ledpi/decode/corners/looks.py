"""Sides of lit squares by ever closer looks at the profiles across them, all squares at once.

The reference of kernels/looks.c, and what is used where there is no compiler; `edges` has the use of either.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from functools import cache, lru_cache
from typing import Any

import numpy as np

from ledpi.decode.corners.approach import (
    FINEST_STEP_PX,
    is_step,
    nearest_sides,
    root_mean_square,
    seen_on_all_sides,
)
from ledpi.decode.corners.rim import ACROSS, PAIRS_ALIKE, USUAL_BLUR_PX, filter_key, rim_filter
from ledpi.decode.corners.sides import (
    OPPOSITE,
    REACH_PX,
    Patches,
    Points,
    Shares,
    Sides,
    areas,
    deviations,
    fit_lines,
    near_median,
    points_across,
)
from ledpi.records import Floats, Frame, Mask, Singles

PROFILES = 48  # a side
CELL_INSET = 0.18  # of a cell's pitch at its ends, where no profile is: gaps and corners
AT_SIDE = 2  # of ACROSS: from a pixel outside to a pixel inside
STEEPEST = 0.8  # of the steepest two pixels of a profile, those at the side must be at least
SETTLED_PX = 0.2  # what a first look moves no further than is as good as what a second one would find
SETTLED_BLUR = 0.1  # logarithm: nor does it then, if the filters saw the blur that they were made for
FIRST_LOOK_PX = 1.0  # what a first look moves further was too far off for its filters
MORE_LOOKS = 2
CONVERGED_PX = 0.2  # by which a further look moves the corners, at most, where the one before was near enough
NEAR_PX = 1.0  # a side's edges to their median, when it is looked at first
LEAST_HEIGHT = 1e-4  # of full scale: a profile without any step
MAX_BLUR_CHANGE = 0.4  # of its logarithm, in a round
MAX_MOVE = 0.2  # of the side: what moves further when looked at closely was not there


@dataclass(frozen=True, slots=True, eq=False)
class Found:
    """What N quads were found to be."""

    corners: Points  # (N, 4)
    seen: Mask  # (N,) whether all sides show edges
    used: Floats  # (N,) share of the profiles that have an edge near their side
    spread_px: Floats  # (N,) of these edges about the sides
    sigma_px: Floats  # (N,) of the corners
    size_sigma_px: Floats  # (N,) of that, what all sides share


def find_sides(frame: Frame, start: Points, bend: Points, cells: int) -> Found:
    """The sides near corners (N, 4): a look, and more for those that it has not settled."""
    patches = Patches(frame, start, REACH_PX)
    within = start - patches.first
    look = _Look(patches, profile_shares(cells), bend.imag @ profile_shares(cells).bend, cells)
    fit = look.first(within)
    fit = look.more(fit, _within(FIRST_LOOK_PX, fit.sides.start, within))
    if not fit.settled.all():  # too far off for the filters, or nothing there
        nearest, _, _ = nearest_sides(patches.light_at, within, np.full(len(start), FINEST_STEP_PX))
        there = np.abs(nearest - within).max(axis=1) < MAX_MOVE * np.sqrt(np.abs(areas(within)))
        anew = look.first(np.where(there[:, None], nearest, within))
        fit = look.more(anew, ~fit.settled).where(~fit.settled, fit)
    # Profiles nearer to each other than a pixel are not independent. At its ends a line through n points is off by 2 of
    # their deviations over √n. What all sides share comes on top: as much as the filters leave open of one, cells and
    # bands beside each other may turn it.
    profiles = np.maximum(np.minimum(fit.weights.sum(axis=-1), fit.sides.length), 1.0)
    return Found(
        corners=fit.sides.start + patches.first,
        seen=fit.seen,
        used=(fit.weights > 0).mean(axis=(1, 2)),
        spread_px=root_mean_square(fit.spread),
        sigma_px=np.sqrt((fit.variance + 4 * np.square(fit.spread) / profiles).mean(axis=1) + fit.size_variance),
        size_sigma_px=np.sqrt(fit.size_variance),
    )


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """What looks have found of N quads."""

    sides: Sides  # after them
    blur_px: Floats  # (N, 2) of either pair of opposite sides
    weights: Floats  # (N, 4, P) of the profiles: 0 for those that do not show the side
    spread: Floats  # (N, 4) of the profiles' edges about each side, in pixels
    variance: Floats  # (N, 4) of a side's place, by what the filter leaves open
    size_variance: Floats  # (N,) of that, what all sides share
    seen: Mask  # (N,) whether all sides show edges
    settled: Mask  # (N,) whether they are where they were sought, so that there is no need to look again

    def where(self, chosen: Mask, other: _Fit) -> _Fit:
        """Of the `chosen` quads (N,) this, of the rest the other."""

        def either(a: Any, b: Any) -> Any:
            return np.where(chosen.reshape(-1, *[1] * (a.ndim - 1)), a, b)

        return _Fit(
            Sides.of(either(self.sides.start, other.sides.start)),
            *(either(getattr(self, f.name), getattr(other, f.name)) for f in fields(self)[1:]),
        )


@cache
def profile_shares(cells: int) -> Shares:
    """Within each cell of a side, away from its ends."""
    each = max(1, round(PROFILES / cells))
    within = np.linspace(CELL_INSET, 1 - CELL_INSET, each)
    return Shares.at(((np.arange(cells)[:, None] + within) / cells).reshape(-1))


@dataclass(frozen=True, slots=True, eq=False)
class _Look:
    """The light around N quads, looked at along their sides."""

    patches: Patches
    shares: Shares
    bend: Floats  # (N, 4, P) how far inward the lens moves each place of a side
    cells: int

    def first(self, corners: Points) -> _Fit:
        """Which profiles show the sides, and where these are; from corners (N, 4) that are a pixel off at most."""
        sides, blur_px = Sides.of(corners), np.full((len(corners), 2), USUAL_BLUR_PX)
        pitches = _pitches(sides, self.cells)
        filters = _filters(pitches, blur_px)
        light, found, height = self._profiles(sides, filters)
        good = is_step(height)
        middle, slope = fit_lines(self.shares, found, near_median(found, good, NEAR_PX).astype(np.float64))
        spread, weights = deviations(self.shares, found, good, middle, slope)
        mean = _mean_profile(light, height, weights)
        blur_px = _blur(blur_px, _places(filters, mean))
        filters = _filters(pitches, blur_px)  # those that fit the blur that is seen
        place = _places(filters, mean)
        moved = self._moved(sides, place, found, weights)
        finite = np.asarray(np.isfinite(moved).all(axis=1))
        seen = finite & seen_on_all_sides(good)
        return _Fit(
            sides=Sides.of(np.where(finite[:, None], moved, corners)),
            blur_px=_blur(blur_px, place),
            weights=weights,
            spread=spread,
            variance=np.array([f.variance for f in filters]),
            size_variance=np.array([f.size_variance for f in filters]),
            seen=seen,
            settled=seen
            & _steep(mean)
            & _within(SETTLED_PX, moved, corners)
            & (np.abs(place[:, 4:]).max(axis=1) < SETTLED_BLUR),
        )

    def more(self, fit: _Fit, which: Mask) -> _Fit:
        """As many looks more at `which` (N,) as it takes; what does not show edges on all sides is refused anyway."""
        for _ in range(MORE_LOOKS):
            which = which & fit.seen & ~fit.settled
            if not which.any():
                break
            fit = self.again(fit).where(which, fit)
        return fit

    def again(self, fit: _Fit) -> _Fit:
        """With the blur that the last look has seen, at the same profiles."""
        filters = _filters(_pitches(fit.sides, self.cells), fit.blur_px)
        light, found, height = self._profiles(fit.sides, filters)
        mean = _mean_profile(light, height, fit.weights)
        place = _places(filters, mean)
        moved = self._moved(fit.sides, place, found, fit.weights)
        finite = np.asarray(np.isfinite(moved).all(axis=1))
        corners = np.where(finite[:, None], moved, fit.sides.start)
        return replace(
            fit,
            sides=Sides.of(corners),
            blur_px=_blur(fit.blur_px, place),
            settled=fit.seen & finite & _steep(mean) & _within(CONVERGED_PX, corners, fit.sides.start),
        )

    def _profiles(self, sides: Sides, filters: list[_SquareFilter]) -> tuple[Singles, Floats, Floats]:
        """Light (N, 4, P, T) across the sides; of each profile the edge (N, 4, P), and the step's height there."""
        light = self.patches.light_at(points_across(sides, self.shares.share, ACROSS[None], self.bend))
        single = light @ np.array([f.single for f in filters])
        height = np.maximum(single[..., 1], LEAST_HEIGHT).astype(np.float64)
        return light, single[..., 0] / height - np.array([f.single_offset for f in filters])[..., None], height

    def _moved(self, sides: Sides, place: Floats, found: Floats, weights: Floats) -> Points:
        """Corners (N, 4) after each side has moved to where its mean profile has it, turned as the single ones say."""
        middle, slope = fit_lines(self.shares, found, weights)
        # The mean profile is at the profiles' mean share of the way: there, not at half of it, the line meets its mean.
        mean_found = (weights * found).sum(axis=-1) / np.maximum(weights.sum(axis=-1), 1e-9)
        return sides.moved(place[:, :4] - mean_found + middle, slope)


def _filters(pitches_px: Floats, blur_px: Floats) -> list[_SquareFilter]:
    """For N quads, by the pitch and the blur (N, 2) across either pair of opposite sides."""
    return [
        _square_filter(*filter_key(pitch[0], blur[0]), *filter_key(pitch[1], blur[1]))
        for pitch, blur in zip(pitches_px.tolist(), blur_px.tolist(), strict=True)
    ]


def _mean_profile(light: Singles, height: Floats, weights: Floats) -> Singles:
    """Of each side (N, 4, T), relative to the step's height."""
    share = weights / (height * np.maximum(weights.sum(axis=-1, keepdims=True), 1e-9))
    mean: Singles = (share[..., None, :].astype(np.float32) @ light)[..., 0, :]
    return mean


def _places(filters: list[_SquareFilter], mean: Singles) -> Floats:
    """What the filters make of the four mean profiles (N, 4, T): (N, 6)."""
    offset = np.array([f.place_offset for f in filters])
    place: Floats = (np.array([f.place for f in filters]) @ mean.reshape(len(mean), -1, 1))[..., 0] + offset
    return place


def _blur(assumed_px: Floats, place: Floats) -> Floats:
    """(N, 2) the blur that filters for `assumed_px` (N, 2) have seen."""
    seen: Floats = assumed_px * np.exp(place[:, 4:].clip(-MAX_BLUR_CHANGE, MAX_BLUR_CHANGE))
    return seen


def _steep(mean: Singles) -> Mask:
    """(N,) of which quads all sides' mean profiles (N, 4, T) are about as steep at the side as anywhere."""
    steps = mean[..., 2:] - mean[..., :-2]
    return np.asarray((steps[..., AT_SIDE] >= STEEPEST * steps.max(axis=-1)).all(axis=1))


def _within(distance_px: float, a: Points, b: Points) -> Mask:
    """(N,) whether all corners are so near to each other."""
    return np.asarray(np.abs(a - b).max(axis=1) < distance_px)


def _pitches(sides: Sides, cells: int) -> Floats:
    """(N, 2) the rim cells' width as seen across either pair of opposite sides, in pixels."""
    opposite = sides.start[:, OPPOSITE] + 0.5 * sides.along[:, OPPOSITE] - sides.start
    depth = (opposite * sides.inward.conj()).real
    # Perspective: along the way to the opposite side things shrink as these two sides do.
    shrunk = cells * sides.length[:, OPPOSITE] - sides.length[:, OPPOSITE] + sides.length
    pitch = depth * sides.length / np.maximum(shrunk, 1e-9)
    return 0.5 * (pitch[:, :2] + pitch[:, 2:])


@dataclass(frozen=True, slots=True)
class _SquareFilter:
    """A square's four sides' filters, ready to be applied together; T light values across each."""

    single: Singles  # (4, T, 2) of one profile: A·(e + offset), and A
    single_offset: Floats  # (4,)
    place: Floats  # (6, 4·T) of the sides' mean profiles: each side's place, and the blurs' logarithms
    place_offset: Floats  # (6,)
    variance: Floats  # (4,) of the places
    size_variance: float  # of that, what all sides share


@lru_cache(maxsize=128)  # 4 kB each; more bring no more hits, where panels are driven past
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
        size_variance=PAIRS_ALIKE * math.sqrt(pairs[0].both_variance * pairs[1].both_variance),
    )
