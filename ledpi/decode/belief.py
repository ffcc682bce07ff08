"""Where the panel is that a square was read as, whatever told the square."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from ledpi.decode.cells import CellSamples
from ledpi.decode.corners.approach import approach_quads
from ledpi.decode.corners.edges import refine_quads
from ledpi.decode.evidence.memory import PanelMemory
from ledpi.decode.identify.blinking_rim import Inward, Rim
from ledpi.decode.identify.ends import Ends
from ledpi.decode.identify.soft import Reading
from ledpi.decode.track import Track
from ledpi.geometry import quad_side
from ledpi.records import Frame, Intrinsics, Quad, Rejected

# Of the side: so far within a bright frame's sides a panel's own are sought, give or take as much but for what the
# frame's own blur.
FRAMED, CLEAR_PX = 0.05, 1.5


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

    def where(
        self, frame: Frame, quad: Quad, samples: CellSamples, track: Track, reading: Reading, group: int
    ) -> Quad | None:
        """The panel that `track` was read as where `frame` shows `quad`, whose cells have these `samples`; or None.

        `group`: which memory of the track it was read from.
        """
        memory = track.memories[group]
        if (quad.told_by == "lines" or track.ends is not None) and reading.id not in self._read_before:
            if track.ends is None:
                track.ends = Ends(memory.spec)
            track.ends.add(frame, quad, samples, self._intrinsics)
            if not track.ends.are_where_told(reading.cell_bands, memory.origin_ns):
                return None
        if self._stream:
            self._read_before.add(reading.id)
        return quad if quad.cells_show else self._within(frame, quad, track, reading, memory)

    def _within(self, frame: Frame, quad: Quad, track: Track, reading: Reading, memory: PanelMemory) -> Quad:
        """The panel within a square in which no cells show: by sides of its own, or as far as it blinks."""
        inward = Inward()
        if track.rim is None:
            own = self._own_sides(frame, quad)
            if own is not None:
                track.lead_to(own)
                return own if own.cells_show else _less_sure(own, inward)
            track.rim = Rim(memory.spec, self._cells)
        if self._stream:
            inward = track.rim.inward(frame, quad, reading.cell_bands, memory.origin_ns, self._intrinsics)
        return _less_sure(inward.of(quad, self._intrinsics), inward)

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
