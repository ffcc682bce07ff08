"""Whether a square that was read is where a panel is, whatever told it."""

from __future__ import annotations

from ledpi.decode.beside import ends_where_told
from ledpi.decode.cells import CellSamples
from ledpi.decode.reader import Reader
from ledpi.decode.soft import Reading
from ledpi.records import Frame, Intrinsics, PanelSpec, Quad, Rejected


class Belief:
    """Of the panels of one camera. In a stream, those that were read before are believed as their sides are.

    Lines alone may tell a lattice a row aside, which may look like another word. (Of 12,000 frames of mirrored panels
    eight were read so, by lattices that took the wall for cells.)
    """

    def __init__(
        self, reader: Reader, specs: tuple[PanelSpec, ...], intrinsics: Intrinsics | None, *, stream: bool
    ) -> None:
        self._reader, self._specs, self._intrinsics, self._stream = reader, specs, intrinsics, stream
        self._read_before: set[int] = set()  # IDs

    @property
    def has_read(self) -> bool:
        """Whether any panel was read before."""
        return bool(self._read_before)

    def in_panel(self, frame: Frame, quad: Quad, samples: CellSamples, reading: Reading, group: int) -> bool:
        """Whether `frame` shows the panel where `quad` is, whose cells have shown `samples` and the word of `group`.

        Where lines alone tell, and it was not read before, this frame by itself must show the word and where it ends.
        """
        if quad.told_by == "lines" and reading.id not in self._read_before:
            alone = self._reader.alone(samples, frame, group)
            if isinstance(alone, Rejected) or alone.id != reading.id:
                return False
            if not ends_where_told(frame, quad, samples, alone.cell_bands, self._specs[group], self._intrinsics):
                return False
        if self._stream:
            self._read_before.add(reading.id)
        return True
