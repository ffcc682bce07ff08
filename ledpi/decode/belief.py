"""Where the panel is that a square was read as, whatever told the square."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ledpi.decode.cells import CellSamples
from ledpi.decode.corners.approach import approach_quads
from ledpi.decode.corners.edges import refine_quads
from ledpi.decode.history import History, Shown
from ledpi.decode.identify.blinking_rim import Inward, Rim
from ledpi.decode.identify.ends import Ends
from ledpi.geometry import quad_side
from ledpi.records import Frame, Intrinsics, Quad, Rejected

# Of the side: so far within a bright frame's sides a panel's own are sought, give or take as much but for what the
# frame's own blur.
FRAMED, CLEAR_PX = 0.05, 1.5


NO_END = Rejected(stage="soft", reason="no_end_seen")


class Believed(NamedTuple):
    """Where a panel is, if it is believed."""

    history: History
    place: Quad | Rejected
    own: Quad | None = None  # the panel's own sides, where what was followed so far is around it


class Belief:
    """Of the panels of one camera. Spots are believed, and sides that cells fill.

    Lines alone may tell a lattice a row aside, which may look like another word. (Of 12,000 frames of mirrored panels
    eight were read so, by lattices that took the wall for cells.) So they are believed of panels that were read before,
    or where frames show that the panel ends where they say, even if sides tell the square later on: walls within a
    larger lattice may look like these. Sides in which no cells show may be those of a bright frame around the panel:
    the word is the same, the place is not. There the panel is as far as it blinks.
    """

    def __init__(self, cells: int, intrinsics: Intrinsics | None, *, stream: bool) -> None:
        self._cells, self._intrinsics, self._stream = cells, intrinsics, stream
        self._read_before: set[int] = set()  # IDs

    def where(self, frame: Frame, quad: Quad, samples: CellSamples, history: History, shown: Shown) -> Believed:
        """The panel that was read as `shown` where `frame` shows `quad`, whose cells have these `samples`."""
        memory, reading = history.memories[shown.group], shown.reading
        if (quad.told_by == "lines" or history.ends is not None) and reading.id not in self._read_before:
            ends = (history.ends or Ends.of(memory.spec)).after(frame, quad, samples, self._intrinsics)
            history = history.with_ends(ends)
            if not ends.are_where_told(reading.cell_bands, memory.origin_ns):
                return Believed(history=history.not_read(), place=NO_END)
        if self._stream:
            self._read_before.add(reading.id)
        return Believed(history=history, place=quad) if quad.cells_show else self._within(frame, quad, history, shown)

    def _within(self, frame: Frame, quad: Quad, history: History, shown: Shown) -> Believed:
        """The panel within a square in which no cells show: by sides of its own, or as far as it blinks."""
        memory = history.memories[shown.group]
        rim = history.rim
        if rim is None:
            own = self._own_sides(frame, quad)
            if own is not None:
                place = own if own.cells_show else _less_sure(own, Inward())
                return Believed(history=history.of_no_frame(), place=place, own=own)
            rim = Rim.of(memory.spec, self._cells)
        if self._stream:
            rim = rim.after(frame, quad, shown.reading.cell_bands, memory.origin_ns, self._intrinsics)
        place = _less_sure(rim.inward.of(quad, self._intrinsics), rim.inward)
        return Believed(history=history.with_rim(rim), place=place)

    def _own_sides(self, frame: Frame, around: Quad) -> Quad | None:
        """Those of a panel within a square, where light steps up once more."""
        outer_px = quad_side(around.corners_px.tolist())
        reach_px = FRAMED * outer_px - CLEAR_PX
        if not reach_px > 0:
            return None
        inner = Inward(shares=(FRAMED,) * 4).of(around, self._intrinsics)
        (near,) = approach_quads(frame, inner.corners_px[None], np.array([reach_px]))
        if isinstance(near, Rejected):
            return None
        (own,) = refine_quads(frame, near[None], self._cells, self._intrinsics)
        if isinstance(own, Rejected) or quad_side(own.corners_px.tolist()) > outer_px - CLEAR_PX:
            return None
        return own


def _less_sure(quad: Quad, inward: Inward) -> Quad:
    """The same, less sure of where it ends: alike on all sides, unless each is told by itself."""
    sigma_px = inward.sigma * quad_side(quad.corners_px.tolist())
    if min(inward.shares) == max(inward.shares):
        return quad.less_sure_of_size(sigma_px)
    return replace(quad, corner_sigma_px=math.hypot(quad.corner_sigma_px, sigma_px))
