"""What light does across a side of a panel, and the filters that find the side best in it.

Going inward from the side, t pixels, light is that of the surroundings, then of the rim's cell, which is brighter in
its middle, then of a gap, then of the next cell. Lens and pixel blur that with a width σ. With F the usual course of it
for cells of a given pitch, and F' its slope, a profile is to first order

    p(t) = b + A·(F(t) − e·F'(t) + Σ nuisance_k(t)) + noise

e is what is sought: how far inward of t = 0 the side is. The nuisances are all that pictures of panels differ in: the
blur, the shape of a cell's light (even in the place within the cell, as each LED is behind its middle), the gap, bands
that make the light slope, and a dark frame around the lit grid. None is known, all are bounded; so e is estimated as
Bayesian linear regression has it, which for a given pitch and blur is one scalar product with a fixed filter. Opposite
sides share blur, cells and gap: half their sum holds the panel's size and all the nuisances, half their difference its
place and none that are shared.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache

import numpy as np

from ledpi.records import Floats, Mask

# Pixels across a side, negative outside. Outside: three times the usual blur, and no more of the wall than that needs.
# Inside: more tells nothing of the edge.
ACROSS = np.arange(-3.0, 7.0)
CELLS = 4  # from the rim inward, whose light reaches that far
PITCHES = 1.0  # of the lattice, that are looked at: further inside is the light of the next cells

# The usual course, and its deviations: relative to the light at a cell's rim.
USUAL_BLUR_PX, BLUR_DEVIATION = 0.78, 0.3  # lens and pixel, as a normal distribution's; logarithm
BRIGHTER, BRIGHTER_DEVIATION = (0.6, -0.3), (1.0, 0.8)  # by b₁(1 − y²) + b₂(1 − y⁴), y = −1…1 across the cell
PITCH_DEVIATION = 0.03  # logarithm: what the corners that it was told by were off, and half a gap at the rim or none
GAP, GAP_DEVIATION = 0.05, 0.04  # of the pitch
# A band's light changes by up to 2πfT…; at 10 ms 8 % deep and 24 rows long: 1 % a row, and its bend.
SLOPE_DEVIATION, BEND_DEVIATION = 0.012, 0.002
FRAME_PX, FRAME_DEVIATION = (1.0, 2.5), 0.05  # how wide a frame around the grid, and how much darker or brighter
MISFIT = 0.016  # deviation of a mean profile's pixels from all this: what no nuisance describes
# That keeps the filters from trusting what a panel need not be; so much is left of panels as they are.
MISFIT_AS_IS = 0.003
PAIRS_ALIKE = 0.9  # correlation of what opposite sides share with what the other two do: one blur, one kind of cell

# A single profile is noisy: it gets a shorter filter with no other nuisance than the slope; what these leave out is the
# same for all profiles of a side, and so does not turn it.
SINGLE_OUTSIDE, SINGLE_INSIDE = 2.0, 3.0
SINGLE_NOISE, SINGLE_SLOPE = 0.03, 0.004
FLAT_PX = 1.5  # from the edge on, light is even enough to tell its two levels

PITCH_STEP, BLUR_STEP = math.log(1.03), math.log(1.06)  # between the filters that are made
MIN_PITCH_PX, MAX_PITCH_PX = 1.5, 24.0  # beyond, nothing of the cell's shape is left in what is looked at
MIN_BLUR_PX, MAX_BLUR_PX = 0.45, 3.0

# What a course is looked at with: as it is, a little further and less far in, blurred more and less, with larger and
# smaller cells. What differs between two of them is how light changes with that.
_SHIFTS_PX = np.array([[0.0], [0.01], [-0.01], [0.0], [0.0], [0.0], [0.0]])
_BLURS = np.array([[1.0], [1.0], [1.0], [1.02], [1 / 1.02], [1.0], [1.0]])
_PITCHES = np.array([[1.0], [1.0], [1.0], [1.0], [1.0], [1.02], [1 / 1.02]])


@dataclass(frozen=True, slots=True)
class RimFilter:
    """For a pair of opposite sides with one pitch and one blur; light is on ACROSS (T)."""

    single: Floats  # (T, 2): of one profile, A·(e + single_offset), and A
    single_offset: float
    both: Floats  # (2, T): of the half sum of two sides' mean profiles over A: e's half sum, and the blur's logarithm
    both_offset: Floats  # (2,)
    apart: Floats  # (T,): of the half difference: e's half difference
    both_variance: float  # of e's half sum
    apart_variance: float  # of e's half difference

    @property
    def variance(self) -> float:
        """Of one side's e."""
        return self.both_variance + self.apart_variance

    @property
    def packed(self) -> Floats:
        """As `Filter` of kernels/rim.h has it."""
        single, both = (self.single.ravel(), [self.single_offset]), (self.both.ravel(), self.both_offset)
        return np.concatenate([[1.0], *single, *both, self.apart, [self.both_variance, self.apart_variance]])


def filter_key(pitch_px: float, blur_px: float) -> tuple[int, int]:
    """Which filter serves this pitch and blur."""
    pitch = min(max(pitch_px, MIN_PITCH_PX), MAX_PITCH_PX)
    blur = min(max(blur_px, MIN_BLUR_PX), MAX_BLUR_PX)
    return round(math.log(pitch) / PITCH_STEP), round(math.log(blur) / BLUR_STEP)


_FIRST, _LAST = filter_key(MIN_PITCH_PX, MIN_BLUR_PX), filter_key(MAX_PITCH_PX, MAX_BLUR_PX)
PITCH_STEPS, BLUR_STEPS = (range(first, last + 1) for first, last in zip(_FIRST, _LAST, strict=True))


def rim_filter(pitch_step: int, blur_step: int) -> RimFilter:
    """The filter for a `filter_key`. Those of its pitch are made together, in some 2 ms, and kept."""
    return _kept(pitch_step)[BLUR_STEPS.index(blur_step)]


def make_filters() -> None:
    """All there may be, which would else be made in the frames that first ask for them."""
    for pitch_step in PITCH_STEPS:
        _kept(pitch_step)


@cache
def _kept(pitch_step: int) -> list[RimFilter]:
    return filters_of_pitch(pitch_step)


def filters_of_pitch(pitch_step: int) -> list[RimFilter]:
    """Those for each of BLUR_STEPS, B of them, with T light values across and 7 or 5 parts that may be added."""
    pitch, blur = math.exp(pitch_step * PITCH_STEP), np.exp(np.array(BLUR_STEPS) * BLUR_STEP)
    t, usual = ACROSS, np.array([1.0, *BRIGHTER, GAP])
    looks = t + _SHIFTS_PX, pitch * _PITCHES + np.zeros((len(blur), 1, 1)), blur[:, None, None] * _BLURS
    parts = light_across(*looks).swapaxes(1, 2)  # (4, 7, B, T)
    course, after, before, wider, narrower, larger, smaller = np.tensordot(usual, parts, axes=1)
    slope, one = (after - before) / 0.02, np.ones_like(course)
    frames = [_step(t / blur[:, None]) - _step((t + width) / blur[:, None]) for width in FRAME_PX]
    side = np.stack([-slope, one, course, course * t, course * t * t, *frames], axis=2)  # (B, T, 7)
    by_factor = 2 * math.log(1.02)
    shared = np.stack([(wider - narrower) / by_factor, (larger - smaller) / by_factor, *parts[1:, 0]], axis=2)
    return _filters(blur, course, side, shared, looked_at=t <= max(PITCHES * pitch, 2.5))


def _filters(
    blur: Floats, course: Floats, side: Floats, shared: Floats, looked_at: Mask
) -> list[RimFilter]:
    """From the usual course (B, T), and what is added to it: on each side (B, T, 7), on both alike (B, T, 5)."""
    t, loose = ACROSS, 1e-6
    side_precision = np.array(
        [loose, loose, loose, SLOPE_DEVIATION**-2, BEND_DEVIATION**-2, *(FRAME_DEVIATION**-2 for _ in FRAME_PX)]
    )
    shared_precision = np.array([BLUR_DEVIATION, PITCH_DEVIATION, *BRIGHTER_DEVIATION, GAP_DEVIATION]) ** -2.0
    # Half sum and half difference of two sides: half the variance in noise and in what each side has of its own.
    apart = _regression(side, 2 * side_precision, looked_at, MISFIT**2 / 2)[0][:, 0]
    both, covariance = _regression(
        np.concatenate([side, shared], axis=2),
        np.concatenate([2 * side_precision, shared_precision]),
        looked_at,
        MISFIT**2 / 2,
    )
    wanted = [0, side.shape[2]]
    both, to_blur = both[:, wanted], covariance[:, wanted, wanted[1]]
    expected_blur = np.log(USUAL_BLUR_PX / blur) * shared_precision[0]
    both_offset = to_blur * expected_blur[:, None] - (both * course[:, None]).sum(axis=2)
    bounds = np.concatenate([2 * side_precision[3:], shared_precision]) ** -0.5
    bounded = np.concatenate([side[:, :, 3:], shared], axis=2)
    near = looked_at & (t >= -SINGLE_OUTSIDE) & (t <= SINGLE_INSIDE)
    single = _regression(side[:, :, :4], np.array([0, 0, 0, SINGLE_SLOPE**-2]), near, SINGLE_NOISE**2)[0][:, 0]
    flat = looked_at & (np.abs(t) >= FLAT_PX)
    levels = _regression(side[:, :, 1:3], np.zeros(2), flat, 1.0)[0][:, 1]
    own = bounds[: -shared.shape[2]]
    return [
        RimFilter(*each)
        for each in zip(
            np.stack([single, levels], axis=2),
            (single * course).sum(axis=1).tolist(),
            both,
            both_offset,
            apart,
            _variance(both[:, 0], bounded, bounds).tolist(),
            _variance(apart, side[:, :, 3:], own).tolist(),
            strict=True,
        )
    ]


def _variance(weights: Floats, bounded: Floats, bounds: Floats) -> Floats:
    """(B,) of e as `weights` (B, T) tell it."""
    off = bounds * (weights[:, None] @ bounded)[:, 0]
    variance: Floats = np.square(off).sum(axis=1) + MISFIT_AS_IS**2 / 2 * np.square(weights).sum(axis=1)
    return variance


def light_across(t: Floats, pitch: Floats | float, blur: Floats | float) -> Floats:
    """(4, …) blurred light at t: of even cells, of (1 − y²) and (1 − y⁴) in each cell, and what a gap of 1 takes away.

    In a cell from a to b the light is a polynomial in y; its convolution with a normal distribution is the sum of that
    distribution's truncated moments m₀ … m₄ between the cell's ends. `t`, `pitch` and `blur` are broadcast.
    """
    ends = np.stack([(t - k * pitch) / blur for k in range(CELLS + 1)])
    steps, bells = _step(ends), _bell(ends)
    high, low, at_high, at_low = ends[:-1], ends[1:], bells[:-1], bells[1:]
    m0 = steps[:-1] - steps[1:]
    m1 = at_low - at_high
    m2 = m0 + low * at_low - high * at_high
    m3 = 2 * m1 + low * low * at_low - high * high * at_high
    m4 = 3 * m2 + low * low * low * at_low - high * high * high * at_high
    y, s = np.stack([2 * t / pitch - 2 * k - 1 for k in range(CELLS)]), 2 * blur / pitch
    yy, ss = y * y, s * s
    square = yy * m0 - 2 * y * s * m1 + ss * m2
    fourth = yy * yy * m0 - 4 * yy * y * s * m1 + 6 * yy * ss * m2 - 4 * y * ss * s * m3 + ss * ss * m4
    gaps = -(pitch / blur) * at_high[1:]
    parts: Floats = np.stack([each.sum(axis=0) for each in (m0, m0 - square, m0 - fourth, gaps)])
    return parts


def _regression(
    columns: Floats, precision: Floats, rows: Mask, noise_variance: float
) -> tuple[Floats, Floats]:
    """(B, K, T) what gives the K coefficients of `columns` (B, T, K), from the rows that count, and their covariance.

    Each coefficient has been normal about 0 with the given precision before any light was seen.
    """
    counted = (columns * rows[:, None]).swapaxes(1, 2)
    information = counted @ counted.swapaxes(1, 2) / noise_variance + np.diag(precision)
    covariance = np.asarray(np.linalg.inv(information), np.float64)
    coefficients: Floats = covariance @ counted / noise_variance
    return coefficients, covariance


def _step(z: Floats) -> Floats:
    """The normal distribution: a blurred step."""
    scaled = (z / math.sqrt(2)).ravel().tolist()
    return 0.5 + 0.5 * np.fromiter(map(math.erf, scaled), np.float64, len(scaled)).reshape(z.shape)


def _bell(z: Floats) -> Floats:
    """Its density."""
    density: Floats = np.exp(-0.5 * z * z) / math.sqrt(2 * math.pi)
    return density
