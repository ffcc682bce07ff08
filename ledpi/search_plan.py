"""How thoroughly each frame's picture is searched for panels: what takes longer is done more rarely."""

from __future__ import annotations

# A stream searches the whole picture for newcomers in every third frame, and in each that does not show all its tracks.
SEARCH_EVERY = 3


class SearchPlan:
    """Of one stream, or of frames that stand alone. To be asked in this order, once a frame."""

    def __init__(self, *, stream: bool) -> None:
        self._stream = stream
        self._since_search = 0

    def begins(self, *, all_seen: bool) -> bool:
        """Whether the picture is searched: it is time again, or a panel is not where it was expected."""
        self._since_search += 1
        searching = self._since_search >= SEARCH_EVERY or not all_seen
        if searching:
            self._since_search = 0
        return searching
