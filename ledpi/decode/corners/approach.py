"""From the rough corners of a lit square to its sides, up to several pixels away: where light steps up the most."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache, partial

import numpy as np

from ledpi.decode.corners.sides import (
    BEFORE,
    NEXT,
    OPPOSITE,
    Coordinates,
    Points,
    Shares,
    Sides,
    areas,
    as_corners,
    as_points,
    deviations,
    fit_lines,
    near_median,
    points_across,
    roughly_light_at,
)
from ledpi.kernels import edges as kernel
from ledpi.kernels.light import can_read
from ledpi.records import Floats, Frame, Mask, Rejected, Singles

LOST = Rejected(stage="edges", reason="no_edge")
NOT_STRAIGHT = Rejected(stage="edges", reason="not_straight")

SHARES = Shares.at(np.linspace(0.06, 0.94, 12))
ACROSS = np.arange(-6.0, 5.0)  # in steps, inward
OFFSETS = np.arange(-4.5, 3.01, 0.75)  # of the step up in light, in steps
STEP_SIGMA = 1.6  # of its blur, in steps: wide enough for half a pixel's steps as for those of a coarse look
FINEST_STEP_PX = 0.5
MIN_STEP = 0.3  # of the steps of the brightest tenth: less is not the side's
# Share of a side's profiles that must show an edge: a rough quad may miss many at first, and at short exposure half of
# a side and more may be dark.
MIN_EDGE = 0.2
MAX_TILT_STEPS = 2.0  # by which a side's edges may differ as the rough one is turned; a dead cell's lie further inside
# How far a corner is from making its quad a parallelogram, as a share of the side, and the cosine of its angle, where a
# dead cell may have cut it off.
CUT_OFF, OBTUSE = 0.05, -0.03
STRAIGHTER = 2.0  # times: sides through the end of a dead cell lie so much worse than those that pass it by
# What most other things are not straight by; a side that is seen from too far off may still lean on what is beside it.
MAX_SPREAD_PX, MAX_SPREAD_STEPS = 0.9, 0.4
ALMOST = 4.0  # times as much: sides that were only reached in part look so, and are looked at again
MAX_MOVE = 0.5  # of the side: what is further off is something else
# As `Approaching` of kernels.h has them.
CONSTANTS = np.array(
    [
        *(FINEST_STEP_PX, MAX_TILT_STEPS, CUT_OFF, OBTUSE, STRAIGHTER),
        *(MAX_SPREAD_PX, MAX_SPREAD_STEPS, ALMOST, MAX_MOVE),
    ]
)


def approach_quads(frame: Frame, rough: Floats, tolerance_px: Floats) -> list[Floats | Rejected]:
    """Better corners for each of `rough` (N, 4, 2; clockwise in the picture), or why there is no square; all at once.

    The sides are sought up to `tolerance_px` (N,) away, with samples as far apart as that takes.
    """
    if not len(rough):
        return []
    if not can_read(frame):
        return _approach_quads(frame, rough, tolerance_px)
    corners, outcomes = kernel.approach(frame, rough, tolerance_px, CONSTANTS, SHARES.share, step_templates())
    return [
        at if outcome == 0 else LOST if outcome == 1 else NOT_STRAIGHT
        for at, outcome in zip(corners, outcomes, strict=True)
    ]


@np.errstate(divide="ignore", invalid="ignore")  # parallel sides cross nowhere: not finite, and refused
def _approach_quads(frame: Frame, rough: Floats, tolerance_px: Floats) -> list[Floats | Rejected]:
    """In numpy."""
    start, chosen = as_points(rough), np.arange(len(rough))
    squared, cut = _with_fourth_corner(start)
    start, of = np.concatenate([start, squared[cut]]), np.concatenate([chosen, chosen[cut]])
    step_px = np.maximum(FINEST_STEP_PX, tolerance_px / -OFFSETS[0])[of]
    light_at = partial(roughly_light_at, frame)
    corners, spread, seen = nearest_sides(light_at, start, step_px)
    limit = np.maximum(MAX_SPREAD_PX, MAX_SPREAD_STEPS * step_px)
    again = np.flatnonzero(seen & (spread > limit) & (spread < ALMOST * limit) & np.isfinite(corners).all(axis=1))
    if len(again):  # a side that began too far off was only seen in part
        corners[again], spread[again], seen[again] = nearest_sides(light_at, corners[again], step_px[again])
    near = np.abs(corners - start).max(axis=1) < MAX_MOVE * np.sqrt(np.abs(areas(start)))
    # Perspective, too, makes a square no parallelogram: what is as straight as it is stays as it is.
    fits = seen & near & (spread <= limit)
    for k in range(len(rough), len(start)):
        if fits[k] and not (fits[of[k]] and spread[of[k]] < STRAIGHTER * spread[k]):
            chosen[of[k]] = k
    reached = as_corners(corners)
    return [
        LOST if not (seen[k] and near[k]) else reached[k] if spread[k] <= limit[k] else NOT_STRAIGHT
        for k in chosen.tolist()
    ]


def _with_fourth_corner(corners: Points) -> tuple[Points, Mask]:
    """Quads (N, 4) with the most obtuse corner moved to where it makes them parallelograms; and for which that is far.

    A dead cell at a corner cuts it off: the other three are right.
    """
    onward, back = corners[:, NEXT] - corners, corners[:, BEFORE] - corners
    cosine = (onward * back.conj()).real / np.maximum(np.abs(onward) * np.abs(back), 1e-9)
    quads, most = np.arange(len(corners)), cosine.argmin(axis=1)
    moved = corners[quads, most] + (onward + back)[quads, most]
    fourth = moved - (corners[quads, OPPOSITE[most]] - corners[quads, most])
    far = np.abs(fourth - corners[quads, most]) > CUT_OFF * np.sqrt(np.abs(areas(corners)))
    squared = corners.copy()
    squared[quads, most] = fourth
    return squared, np.asarray(far & (cosine.min(axis=1) < OBTUSE))


def nearest_sides(
    look: Callable[[Coordinates], Singles], corners: Points, step_px: Floats
) -> tuple[Points, Floats, Mask]:
    """Corners (N, 4) whose sides run where light steps up, the steps' spread (N,), and which quads have them all round.

    `look` tells the light at points.
    """
    sides = Sides.of(corners)
    found, height = _steps_up(look(points_across(sides, SHARES.share, step_px[:, None] * ACROSS)))
    good = is_step(height)
    found *= step_px[:, None, None]
    start = near_median(found, good, MAX_TILT_STEPS * step_px[:, None, None]).astype(np.float64)
    spread, weights = deviations(SHARES, found, good, *fit_lines(SHARES, found, start))
    return sides.moved(*fit_lines(SHARES, found, weights)), root_mean_square(spread), seen_on_all_sides(good)


def root_mean_square(spread: Floats) -> Floats:
    """(N,) of the four sides'."""
    mean: Floats = np.sqrt(np.square(spread).mean(axis=1))
    return mean


def is_step(height: Floats) -> Mask:
    """Which profiles (N, 4, P) have a step that may be the panel's: a cell that is as dark is dead, or hidden."""
    highest = np.sort(height.reshape(len(height), -1), axis=1)
    usual = highest[:, int(0.9 * highest.shape[1])]
    return height > np.maximum(MIN_STEP * usual, 1e-6)[:, None, None]


def seen_on_all_sides(good: Mask) -> Mask:
    """(N,) whether enough of the profiles (N, 4, P) have a step."""
    enough: Mask = good.sum(axis=2).min(axis=1) >= MIN_EDGE * good.shape[2]
    return enough


def _steps_up(light: Singles) -> tuple[Floats, Floats]:
    """Where in each profile (…, T) the largest step up is, in steps, and how high."""
    scores = (light @ step_templates()).reshape(-1, len(OFFSETS))
    best = scores.argmax(axis=1).clip(1, len(OFFSETS) - 2)
    at = best + len(OFFSETS) * np.arange(len(scores))
    before, here, after = scores.reshape(-1).take([at - 1, at, at + 1])
    shift = 0.5 * (after - before) / np.maximum(2 * here - before - after, 1e-9)  # of the parabola through the three
    found = OFFSETS[best] + shift.clip(-1, 1) * (OFFSETS[1] - OFFSETS[0])
    return found.reshape(light.shape[:-1]), here.reshape(light.shape[:-1]).astype(np.float64)


@cache
def step_templates() -> Singles:
    """(T, OFFSETS): blurred steps less their means, of unit length: the best is that with the largest product."""
    z = (ACROSS[:, None] - OFFSETS) / STEP_SIGMA
    steps = np.array([[0.5 * (1 + math.erf(v / math.sqrt(2))) for v in row] for row in z.tolist()])
    steps -= steps.mean(axis=0)
    templates: Singles = (steps / np.linalg.norm(steps, axis=0)).astype(np.float32)
    templates.flags.writeable = False
    return templates
