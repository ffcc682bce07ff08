"""Sub-pixel corners of lit squares: straight sides through what profiles across them show, all squares at once.

A side's place comes from the mean of its profiles and the filter that a lattice's rim calls for (`rim`); how it is
turned, from where each profile has its edge. The lines within the panel have their say at the end (`adjust`).
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from ledpi.decode.corners import adjust, approach, looks, rim, whole
from ledpi.decode.corners.adjust import adjust_quads
from ledpi.decode.corners.approach import LOST, NOT_STRAIGHT, SHARES, approach_quads, step_templates
from ledpi.decode.corners.beside_rim import ends_lack_alike, is_around, unsure
from ledpi.decode.corners.inner_square import by_inner_lines
from ledpi.decode.corners.looks import MAX_MOVE, Found, find_sides, profile_shares
from ledpi.decode.corners.rim import filters_of_pitch, make_filters
from ledpi.decode.corners.sides import Points, areas, as_corners, as_points, bends
from ledpi.decode.corners.whole import (
    BEND_ALONG,
    BLUR_STEPS,
    NO_RIM_WALL,
    completed,
    explanations,
    hidden_shares,
    usual_blur_steps,
    without_rim_walls,
)
from ledpi.geometry import quad_side
from ledpi.kernels import edges as kernel
from ledpi.kernels.library import compiled
from ledpi.kernels.light import can_read
from ledpi.records import Floats, Frame, Intrinsics, Quad, Rejected

NOT_CONVEX = Rejected(stage="edges", reason="not_convex")
AT_BORDER = Rejected(stage="edges", reason="at_picture_border")
TOO_SMALL = Rejected(stage="edges", reason="too_small")

NOT_WHOLE = Rejected(stage="edges", reason="not_whole")

MIN_SIDE_PX = 7.0
# The edges of a panel lie on a line to a tenth of a pixel, those of most other things do not by far.
MAX_SPREAD_PX = 0.35
MIN_USED = 0.6  # share of the profiles that have an edge near their side: with two dead cells on each it is a half
BORDER_PX = 1.0
MORE_EXACT = 0.5  # times the deviation: corners by inner lines that are, are preferred where a side is hidden
SAME_SIGMAS = 8.0  # deviations between both, at most
LOOKS_WHERE_TOLD = 2  # for a side that nothing shows where it was sought
HIDDEN_SIGMA = 0.003  # of the side: how exactly the cells tell where a side is that nothing shows
# As `Refining` of quads.h has them.
CONSTANTS = np.array(
    [
        *(looks.LEAST_HEIGHT, looks.NEAR_PX, looks.SETTLED_PX, looks.SETTLED_BLUR, looks.FIRST_LOOK_PX),
        *(looks.MORE_LOOKS, looks.CONVERGED_PX, looks.STEEPEST, looks.MAX_MOVE, looks.MAX_BLUR_CHANGE),
        *(whole.NEAR_EDGE, whole.SHARE_STEP, whole.SHARES[0], whole.MOST, whole.NO_RIM_WALL, whole.RIM_WALL),
        *(whole.GAP, whole.BLUR_PX, whole.BLUR_STEP),
        *(whole.BETTER, whole.LITTLE_LEFT, whole.CLEARLY_BETTER, whole.NOTHING_LEFT),
        *(whole.CELLS_SHOW, whole.LEAST_SHOWN),
        *(MAX_SPREAD_PX, MIN_USED, MIN_SIDE_PX, BORDER_PX, HIDDEN_SIGMA, adjust.MIN_PITCH_PX, adjust.LEAST_CELLS),
    ],
    np.float64,
)
REFUSED = {
    kernel.NO_EDGE: LOST,
    kernel.NOT_STRAIGHT: NOT_STRAIGHT,
    kernel.NOT_WHOLE: NOT_WHOLE,
    kernel.NOT_CONVEX: NOT_CONVEX,
    kernel.TOO_SMALL: TOO_SMALL,
    kernel.AT_BORDER: AT_BORDER,
}


def refine_quads(
    frame: Frame, near: Floats, cells: int, intrinsics: Intrinsics | None = None
) -> list[Quad | Rejected]:
    """Sub-pixel corners of each lit square of `cells` × `cells` whose corners are within 2 px of `near` (N, 4, 2).

    Or why there are none.
    """
    if not len(near):
        return []
    found = _refined(frame, near, cells, intrinsics)
    return [quad if isinstance(quad, Rejected) else _exactly(frame, quad, cells, intrinsics) for quad in found]


def _exactly(frame: Frame, quad: Quad, cells: int, intrinsics: Intrinsics | None) -> Quad:
    """A quad whose sides are not all there is to tell where its panel ends, as exactly as that can be told."""
    if quad.seen_px is None:
        return unsure(frame, quad, cells, intrinsics) if quad.rim_wall else quad
    if is_around(quad):
        own = _within(frame, quad, cells, intrinsics)
        if own is not None:
            return own
    there = _where_told(frame, quad, cells, intrinsics)
    if there is not None:
        return there
    told = _by_lines(frame, quad, cells, intrinsics)
    return unsure(frame, told, cells, intrinsics) if ends_lack_alike(quad) else told


def _within(frame: Frame, quad: Quad, cells: int, intrinsics: Intrinsics | None) -> Quad | None:
    """The panel's own sides, where what was seen is the outline of what runs around it."""
    reach_px = NO_RIM_WALL * quad_side(quad.corners_px.tolist())
    (near,) = approach_quads(frame, quad.corners_px[None], np.array([reach_px]))
    if isinstance(near, Rejected):
        return None
    (own,) = _refined(frame, near[None], cells, intrinsics)
    return _exactly(frame, own, cells, intrinsics) if isinstance(own, Quad) and own.seen_px is None else None


def _where_told(frame: Frame, quad: Quad, cells: int, intrinsics: Intrinsics | None) -> Quad | None:
    """The whole panel, where its sides show after all once they are looked for where its cells tell that they are.

    A side that was sought a few pixels off, as after a jerk, may have been taken for one that something hides.
    """
    for _ in range(LOOKS_WHERE_TOLD):
        assert quad.seen_px is not None
        (there,) = _refined(frame, quad.corners_px[None], cells, intrinsics)
        if isinstance(there, Rejected):
            return None
        if there.seen_px is None:
            told, seen = (np.abs(there.corners_px - at).max() for at in (quad.corners_px, quad.seen_px))
            return _exactly(frame, there, cells, intrinsics) if told < seen else None
        quad = there
    return None


def _by_lines(frame: Frame, quad: Quad, cells: int, intrinsics: Intrinsics | None) -> Quad:
    """A quad that is partly hidden, by its inner lines if they tell more than how much of it lacks, and the same."""
    lines = by_inner_lines(frame, quad.corners_px, cells, intrinsics)
    if isinstance(lines, Rejected) or lines.own_sigma_px > MORE_EXACT * quad.corner_sigma_px:
        return quad
    away = np.hypot(*(lines.corners_px - quad.corners_px).T).max()
    if away > SAME_SIGMAS * quad.corner_sigma_px:
        return quad
    # Where the lines have it larger than the sides, the rim has half a wall, or not: anywhere between.
    outward_px = (quad_side(lines.corners_px.tolist()) - quad_side(quad.corners_px.tolist())) / 2
    told = replace(quad, corners_px=lines.corners_px, corner_sigma_px=lines.own_sigma_px, size_sigma_px=0.0)
    return told.less_sure_of_size(outward_px / math.sqrt(3))


def _refined(frame: Frame, near: Floats, cells: int, intrinsics: Intrinsics | None) -> list[Quad | Rejected]:
    """By the sides, and the inner lines beside them."""
    if not (can_read(frame) and cells <= kernel.MOST_CELLS):
        return _refine_quads(frame, near, cells, intrinsics)
    refined, outcomes = kernel.refine(frame, near, _tables(cells), intrinsics)
    corners, numbers = refined[:, :16].reshape(-1, 2, 4, 2), refined[:, 16:].tolist()
    return [
        REFUSED[outcome]
        if outcome in REFUSED
        else Quad(
            corners_px=at,
            corner_sigma_px=sigma_px,
            size_sigma_px=size_px,
            bend_px=bend_px,
            seen_px=None if outcome == kernel.WHOLE else seen,
            rim_wall=rim_wall,
            cells_show=shown > 0,
        )
        for (at, seen), (sigma_px, size_px, bend_px, rim_wall, shown), outcome in zip(
            corners, numbers, outcomes, strict=True
        )
    ]


def prepare(cells: int, smallest_px: float, largest_px: float) -> None:
    """Makes what squares with such sides need, else made in the frames that first ask for it."""
    if compiled():
        _filter_table().make_all()
    else:
        make_filters()
    for blur_step in usual_blur_steps(cells, smallest_px, largest_px):
        if compiled():
            _tables(cells).explain(blur_step)
        else:
            explanations(cells, blur_step)


@cache
def _filter_table() -> kernel.FilterTable:
    """For the compiled loops."""
    bounds = (
        *(rim.PITCH_STEP, rim.BLUR_STEP, rim.MIN_PITCH_PX, rim.MAX_PITCH_PX),
        *(rim.MIN_BLUR_PX, rim.MAX_BLUR_PX, rim.USUAL_BLUR_PX),
    )

    def made(pitch_step: int) -> Floats:
        return np.array([each.packed for each in filters_of_pitch(pitch_step)])

    return kernel.FilterTable(rim.PITCH_STEPS, rim.BLUR_STEPS, bounds, made)


@cache
def _tables(cells: int) -> kernel.Tables:
    """For the compiled loops."""

    def explain(blur_step: int) -> tuple[Floats, NDArray[np.intp]]:
        made = explanations(cells, blur_step)
        return made.bases, made.first

    profiles = profile_shares(cells)
    coarse = (SHARES.share, step_templates())
    sides = (profiles.share, profiles.bend)
    constants = (approach.CONSTANTS, CONSTANTS)
    return kernel.Tables(cells, _filter_table(), *constants, sides, coarse, BEND_ALONG, BLUR_STEPS, explain)


@np.errstate(divide="ignore", invalid="ignore")  # parallel sides cross nowhere: not finite, and refused
def _refine_quads(frame: Frame, near: Floats, cells: int, intrinsics: Intrinsics | None) -> list[Quad | Rejected]:
    """In numpy."""
    start = as_points(near)
    bend = bends(start, intrinsics)
    found = find_sides(frame, start, bend, cells)
    hidden, cells_show = hidden_shares(frame, found.corners, bend, cells)
    hidden, rim_walls = without_rim_walls(hidden)
    results = _results(frame, start, found, bend, hidden)
    quads = [
        replace(quad, rim_wall=0.0 if quad.seen_px is not None else wall, cells_show=shown)
        if isinstance(quad, Quad)
        else quad
        for quad, wall, shown in zip(results, rim_walls.tolist(), cells_show.tolist(), strict=True)
    ]
    return adjust_quads(frame, quads, np.asarray(~hidden.any(axis=(1, 2))), bend, cells, intrinsics)


def _results(frame: Frame, start: Points, found: Found, bend: Points, hidden: Floats) -> list[Quad | Rejected]:
    """Each quad, or why there is none."""
    side_px, corners = np.sqrt(np.abs(areas(start))), found.corners
    there = found.seen & (np.abs(corners - start).max(axis=1) < MAX_MOVE * side_px)
    straight = (found.spread_px <= MAX_SPREAD_PX) & (found.used >= MIN_USED)
    most_bent = np.abs(bend.imag).max(axis=(1, 2))
    sigma_px, size_px = found.sigma_px.tolist(), found.size_sigma_px.tolist()
    results: list[Quad | Rejected] = []
    for i in range(len(corners)):
        if not there[i]:
            results.append(LOST)
        elif not straight[i]:
            results.append(NOT_STRAIGHT)
        elif not hidden[i].any():
            results.append(checked(frame, corners[i], sigma_px[i], size_px[i], float(most_bent[i])))
        elif np.isfinite(hidden[i]).all():
            whole, sigma = completed(corners[i], hidden[i]), sigma_px[i] + float(HIDDEN_SIGMA * side_px[i])
            quad = checked(frame, whole, sigma, size_px[i], float(most_bent[i]))
            results.append(replace(quad, seen_px=as_corners(corners[i])) if isinstance(quad, Quad) else quad)
        else:
            results.append(NOT_WHOLE)
    return results


def checked(
    frame: Frame, corners: Points, sigma_px: float, size_sigma_px: float, bend_px: float
) -> Quad | Rejected:
    """A record of what has the shape of a square and is wholly in the picture."""
    a, b, c, d = corners.tolist()
    sides = (b - a, c - b, d - c, a - d)
    turns = [(sides[k - 1].conjugate() * sides[k]).imag for k in range(4)]
    if not min(turns) > 0:  # also where a corner is not finite
        return NOT_CONVEX
    if 0.5 * ((c - a).conjugate() * (d - b)).imag < MIN_SIDE_PX**2:
        return TOO_SMALL
    height, width = frame.pixels.shape
    xs, ys = (a.real, b.real, c.real, d.real), (a.imag, b.imag, c.imag, d.imag)
    if min(*xs, *ys) < BORDER_PX or max(xs) > width - 1 - BORDER_PX or max(ys) > height - 1 - BORDER_PX:
        return AT_BORDER
    return Quad(
        corners_px=as_corners(corners), corner_sigma_px=sigma_px, size_sigma_px=size_sigma_px, bend_px=bend_px
    )
