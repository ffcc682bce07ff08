"""How thoroughly each frame's picture is searched for panels: what takes longer is done more rarely."""

from __future__ import annotations

# A stream searches the whole picture for newcomers in every third frame, and in each that does not show all its tracks.
SEARCH_EVERY = 3
# Beside panels that are read, what a search does not see at first is looked for in every fourth search.
AGAIN_EVERY = 4
# What is within panels is looked at where sides tell nothing, for panels that were read before. Where there are many
# lattices that takes longer than all else: in every third of a stream's frames without a panel.
LOOK_WITHIN_EVERY = 3


class SearchPlan:
    """Of one stream, or of frames that stand alone. To be asked in this order, each once a frame."""

    def __init__(self) -> None:
        self._since_search = self._since_read = self._searches = 0
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
        return self._searching and (not read or self._searches % AGAIN_EVERY == 0)

    def looks_within(self, *, read: bool, read_before: bool) -> bool:
        """Whether a panel that was read before may be there without its sides."""
        self._since_read = 0 if read else self._since_read + 1
        return self._searching and read_before and not read and self._since_read % LOOK_WITHIN_EVERY == 0
