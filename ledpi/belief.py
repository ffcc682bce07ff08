"""Whether a square that was read is where a panel is, whatever told it."""

from __future__ import annotations

from ledpi.decode.cells import CellSamples
from ledpi.decode.identify.beside import Ends
from ledpi.decode.identify.soft import Reading
from ledpi.decode.track import Track
from ledpi.records import Frame, Intrinsics, Quad


class Belief:
    """Of the panels of one camera. Where a square's sides or spots are seen, it is believed.

    Lines alone may tell a lattice a row aside, which may look like another word. (Of 12,000 frames of mirrored panels
    eight were read so, by lattices that took the wall for cells.) So they are believed of panels that were read before,
    or where frames show that the panel ends where they say.
    """

    def __init__(self, intrinsics: Intrinsics | None, *, stream: bool) -> None:
        self._intrinsics, self._stream = intrinsics, stream
        self._read_before: set[int] = set()  # IDs

    def is_there(
        self, frame: Frame, quad: Quad, samples: CellSamples, track: Track, reading: Reading, group: int
    ) -> bool:
        """Whether the panel that `track` was read as is where `frame` shows `quad`, whose cells have these `samples`.

        `group`: which memory of the track it was read from.
        """
        if quad.told_by == "lines" and reading.id not in self._read_before:
            memory = track.memories[group]
            if track.ends is None:
                track.ends = Ends(memory.spec)
            track.ends.add(frame, quad, samples, self._intrinsics)
            if not track.ends.are_where_told(reading.cell_bands, memory.origin_ns):
                return False
        if self._stream:
            self._read_before.add(reading.id)
        return True
