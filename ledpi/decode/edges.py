"""Sub-pixel corners of lit squares: straight sides through what profiles across them show, all squares at once.

A side's place comes from the mean of its profiles and the filter that a lattice's rim calls for (`rim`); how it is
turned, from where each profile has its edge. The lines within the panel have their say at the end (`adjust`).
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ledpi.decode.adjust import adjust_quads
from ledpi.decode.approach import LOST, NOT_STRAIGHT, SHARES, step_templates
from ledpi.decode.looks import MAX_MOVE, Found, find_sides, profile_shares
from ledpi.decode.sides import Points, areas, as_corners, as_points, bends
from ledpi.decode.whole import hidden_shares, uncovered
from ledpi.kernels import edges as kernel
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
HIDDEN_SIGMA = 0.003  # of the side: how exactly the cells tell where a side is that nothing shows


@np.errstate(divide="ignore", invalid="ignore")  # parallel sides cross nowhere: not finite, and refused
def refine_quads(
    frame: Frame, near: Floats, cells: int, intrinsics: Intrinsics | None = None
) -> list[Quad | Rejected]:
    """Sub-pixel corners of each lit square of `cells` × `cells` whose corners are within 2 px of `near` (N, 4, 2).

    Or why there are none.
    """
    if not len(near):
        return []
    start = as_points(near)
    bend = bends(start, intrinsics)
    found = (_find_compiled if can_read(frame) else find_sides)(frame, start, bend, cells)
    hidden = hidden_shares(frame, found.corners, bend, cells)
    quads = _results(frame, start, found, bend, hidden)
    return adjust_quads(frame, quads, np.asarray(~hidden.any(axis=(1, 2))), bend, cells, intrinsics)


def _find_compiled(frame: Frame, start: Points, bend: Points, cells: int) -> Found:
    """`find_sides`, in C."""
    shares = profile_shares(cells)
    sides = (shares.share, shares.bend)
    corners, numbers = kernel.find_sides(frame, start, bend, cells, sides, (SHARES.share, step_templates()))
    seen, used, spread_px, sigma_px = numbers.T
    return Found(corners, seen > 0, used, spread_px, sigma_px)


def _results(frame: Frame, start: Points, found: Found, bend: Points, hidden: Floats) -> list[Quad | Rejected]:
    """Each quad, or why there is none."""
    side_px, corners, sigma_px = np.sqrt(np.abs(areas(start))), found.corners, found.sigma_px
    there = found.seen & (np.abs(corners - start).max(axis=1) < MAX_MOVE * side_px)
    straight = (found.spread_px <= MAX_SPREAD_PX) & (found.used >= MIN_USED)
    most_bent = np.abs(bend.imag).max(axis=(1, 2))
    results: list[Quad | Rejected] = []
    for i in range(len(corners)):
        if not there[i]:
            results.append(LOST)
        elif not straight[i]:
            results.append(NOT_STRAIGHT)
        elif not hidden[i].any():
            results.append(checked(frame, corners[i], float(sigma_px[i]), float(most_bent[i])))
        elif np.isfinite(hidden[i]).all():
            whole, sigma = uncovered(corners[i], hidden[i]), float(sigma_px[i] + HIDDEN_SIGMA * side_px[i])
            quad = checked(frame, whole, sigma, float(most_bent[i]))
            results.append(replace(quad, seen_px=as_corners(corners[i])) if isinstance(quad, Quad) else quad)
        else:
            results.append(NOT_WHOLE)
    return results


def checked(frame: Frame, corners: Points, sigma_px: float, bend_px: float) -> Quad | Rejected:
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
    return Quad(corners_px=as_corners(corners), corner_sigma_px=sigma_px, bend_px=bend_px)
