"""How thoroughly each frame's picture is searched for panels: what takes longer is done more rarely."""

from __future__ import annotations

from collections.abc import Iterable

from ledpi.decode.cells import CellSamples
from ledpi.records import Frame, Quad
from ledpi.tone import linear_light

# A stream searches the whole picture for newcomers in every third frame, and in each that does not show all its tracks.
SEARCH_EVERY = 3
# Beside panels that are read, what a search does not see at first is looked for in every fourth search of a stream.
AGAIN_EVERY = 4
# What is within panels is looked at where sides tell nothing. Where there are many lattices that takes longer than all
# else: in every third of a stream's frames without a panel, so that what is touched is a newcomer for no longer either.
# The first frame of a stream is one of these.
LOOK_WITHIN_EVERY = 3
# Of a frame alone that is spared where it has shown a panel, most likely, that is only too far away to be told by it: a
# square of small cells that show, nearly as bright as anything in the picture. (None do in the bright middle of a cell
# nearby, which has a square outline, too.)
FAR_CELL_PX, FAR_LIGHT = 8.0, 0.5


class SearchPlan:
    """Of one stream, or of frames that stand alone. To be asked in this order, once a frame."""

    def __init__(self, *, stream: bool) -> None:
        self._stream = stream
        self._since_search = self._searches = 0
        self._since_read = LOOK_WITHIN_EVERY - 1
        self._searching = False

    def begins(self, *, all_seen: bool) -> bool:
        """Whether the picture is searched: it is time again, or a panel is not where it was expected."""
        self._since_search += 1
        self._searching = self._since_search >= SEARCH_EVERY or not all_seen
        if self._searching:
            self._since_search = 0
            self._searches += 1
        return self._searching

    def goes_on(self, *, read: bool) -> bool:
        """Whether it is searched once more, for what is only bright for its surroundings."""
        in_turn = self._stream and self._searches % AGAIN_EVERY == 0
        return self._searching and (not read or in_turn)

    def looks_within(self, frame: Frame, looked: Iterable[tuple[Quad, CellSamples]], *, read: bool) -> bool:
        """Whether what shows no sides may be a panel. `looked`: the squares that this frame has shown."""
        self._since_read = 0 if read else self._since_read + 1
        if read or not self._searching:
            return False
        if self._stream:
            return self._since_read % LOOK_WITHIN_EVERY == 0
        brightest = linear_light(frame.transfer, mark_saturated=False)[frame.pixels.max()]
        return not any(
            quad.cells_show and min(samples.cell_px) < FAR_CELL_PX and samples.light.mean() > FAR_LIGHT * brightest
            for quad, samples in looked
        )
