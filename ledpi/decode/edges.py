"""Sub-pixel corners of lit squares: straight sides through what profiles across them show, all squares at once.

A side's place comes from the mean of its profiles and the filter that a lattice's rim calls for (`rim`); how it is
turned, from where each profile has its edge. The lines within the panel have their say at the end (`adjust`).
"""

from __future__ import annotations

from dataclasses import fields, replace

import numpy as np

from ledpi.decode.adjust import adjust_quads
from ledpi.decode.approach import LOST, NOT_STRAIGHT, SHARES, step_templates
from ledpi.decode.looks import MAX_MOVE, Found, find_sides, profile_shares
from ledpi.decode.sides import Mask, Points, as_corners, as_points, bends
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
    whole = np.asarray(~hidden.reshape(-1, 4).any(axis=1))
    return adjust_quads(frame, _results(frame, found, hidden, whole), whole, bend, cells, intrinsics)


def _find_compiled(frame: Frame, start: Points, bend: Points, cells: int) -> Found:
    """`find_sides`, in C."""
    shares = profile_shares(cells)
    sides = (shares.share, shares.bend)
    corners, numbers = kernel.find_sides(frame, start, bend, cells, sides, (SHARES.share, step_templates()))
    seen, *of_quads = numbers.T
    return Found(corners, seen > 0, *of_quads)


def _results(frame: Frame, found: Found, hidden: Floats, whole: Mask) -> list[Quad | Rejected]:
    """Each quad, or why there is none; `hidden` (N, 2, 2) of it, and which are `whole` (N,)."""
    results: list[Quad | Rejected] = []
    numbers = (getattr(found, field.name).tolist() for field in fields(Found)[1:])
    for i, (seen, used, spread_px, sigma_px, moved_px, side_px, bend_px) in enumerate(zip(*numbers, strict=True)):
        if not (seen and moved_px < MAX_MOVE * side_px):
            results.append(LOST)
        elif not (spread_px <= MAX_SPREAD_PX and used >= MIN_USED):
            results.append(NOT_STRAIGHT)
        elif whole[i]:
            results.append(checked(frame, found.corners[i], sigma_px, bend_px))
        elif np.isfinite(hidden[i]).all():
            corners = uncovered(found.corners[i], hidden[i])
            quad = checked(frame, corners, sigma_px + HIDDEN_SIGMA * side_px, bend_px)
            results.append(replace(quad, seen_px=as_corners(found.corners[i])) if isinstance(quad, Quad) else quad)
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
