"""The history of a track's panel: a record, and every way in which a frame may change it.

A panel is not read yet (`last` is None), read (`identity`), or was read and is not confirmed at the moment
(`uninformative` frames since `last`). If it turns out to be another thing, the history begins again with that frame.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from ledpi.core.records import PanelSpec
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.evidence.light import LightWeigher
from ledpi.decode.evidence.memory import PanelMemory
from ledpi.decode.identify.decision import Reading
from ledpi.decode.identify.frequency_search import Proposal
from ledpi.decode.observation import Observation

SEARCH_FRAMES = 12  # that are kept to find a panel's frequencies from


class Identity(NamedTuple):
    """What a panel was read as."""

    group: int  # which pair of frequencies, of those that panels may have
    reading: Reading


class FrequencySearch(NamedTuple):
    """The frames that are searched for a panel's frequencies, and the frequencies found, if not the configured ones."""

    observations: tuple[Observation, ...] = ()  # the last frames
    frames_since_try: int = 0  # frames since the last try
    found: Proposal | None = None
    found_from: int = 0  # frames

    @property
    def settling(self) -> bool:
        """Whether the frequencies were estimated from few frames: not exact enough to add up many more."""
        return self.found is not None and self.found_from < SEARCH_FRAMES

    def add_frame(self, seen: Observation) -> FrequencySearch:
        """With one more frame."""
        observations = (*self.observations[1 - SEARCH_FRAMES :], seen)
        return self._replace(observations=observations, frames_since_try=self.frames_since_try + 1)

    def mark_failed(self) -> FrequencySearch:
        """After a search that found nothing."""
        return self._replace(frames_since_try=0)

    def mark_found(self, proposal: Proposal) -> FrequencySearch:
        """After a search that found these frequencies."""
        return self._replace(frames_since_try=0, found=proposal, found_from=len(self.observations))


class History(NamedTuple):
    """What the frames of a track have shown."""

    memories: tuple[PanelMemory, ...]  # one for each pair of frequencies
    last: Identity | None = None  # what they were read as
    uninformative: int = 0  # frames since then that added nothing, and are not in the memories
    matched: int = 0  # frames since it was read last that clearly showed the same
    search: FrequencySearch = FrequencySearch()

    @classmethod
    def empty(cls, specs: tuple[PanelSpec, ...], search: FrequencySearch | None = None) -> History:
        """Without frames."""
        return cls(memories=tuple(PanelMemory(spec) for spec in specs), search=search or FrequencySearch())

    @property
    def identity(self) -> Identity | None:
        """What the panel is read as now."""
        return None if self.uninformative else self.last

    @property
    def frames(self) -> int:
        """The number of frames that showed the panel."""
        return self.memories[0].frames

    def add_frame(
        self, seen: Observation, weigher: LightWeigher, *, searched: bool
    ) -> tuple[History, list[Evidence | None]]:
        """With one more frame in the memories, and what it adds to each. The caller then decides on the identity.

        `searched`: frequencies are searched for, so the frame itself is kept, too.
        """
        further, added = zip(*(memory.add_frame(seen, weigher) for memory in self.memories), strict=True)
        search = self.search.add_frame(seen) if searched else self.search
        return self._replace(memories=further, search=search), list(added)

    def confirm(self) -> History:
        """The newest frame clearly shows the same: it is not read again."""
        return self._replace(matched=self.matched + 1)

    def identify_as(self, identity: Identity) -> History:
        """The memories show this panel."""
        return self._replace(last=identity, uninformative=0, matched=0)

    def clear_identity(self) -> History:
        """The memories show no panel, or none that is accepted."""
        return self._replace(last=None, uninformative=0, matched=0)

    def skip_frame(self, search: FrequencySearch) -> History:
        """One more frame adds nothing, though the memories did: only `search` keeps it."""
        return self._replace(uninformative=self.uninformative + 1, search=search)

    def keep_newest(self) -> History:
        """Only the newest frame: those before it do not add up, or showed something else at the same frequencies."""
        memories = tuple(PanelMemory(memory.spec).begin(memory.newest) for memory in self.memories)
        return History(memories=memories, search=self.search)

    def begin_again(self, specs: Iterable[PanelSpec]) -> History:
        """Only the newest frame, and nothing of the frequencies that were found: it shows another panel."""
        newest = self.memories[0].newest
        memories = tuple(PanelMemory(spec).begin(newest) for spec in specs)
        kept = self.search.observations[-1:]
        return History(memories=memories, search=FrequencySearch(observations=kept, frames_since_try=len(kept)))

    def set_search(self, search: FrequencySearch) -> History:
        """The same memories with another `search`."""
        return self._replace(search=search)

    def retune(self, proposal: Proposal, group: int, memory: PanelMemory) -> History:
        """The panel blinks at other frequencies than others of its `group`; `memory` is at these."""
        memories = (*self.memories[:group], memory, *self.memories[group + 1 :])
        return self._replace(memories=memories, search=self.search.mark_found(proposal))
