"""The history of a track's panel: its state, and the frames that have led to it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

from ledpi.core.records import PanelSpec
from ledpi.decode.evidence.cells import Observation
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.evidence.light import MOST_EACH_OF_SEVERAL, THIN, LightWeigher
from ledpi.decode.evidence.memory import PanelMemory
from ledpi.decode.identify.decision import Reading
from ledpi.decode.identify.frequency_search import Proposal
from ledpi.decode.identify.innovation_gate import enough_to_confirm
from ledpi.decode.states import State

SEARCH_FRAMES = 12  # that are kept to find a panel's frequencies from


class Identity(NamedTuple):
    """A reading, and the frequencies that it was found at."""

    group: int  # which pair of frequencies, of those that panels may have
    reading: Reading


class FrequencySearch(NamedTuple):
    """The frames that are searched for a panel's frequencies, and the frequencies found, if not the configured ones."""

    observations: tuple[Observation, ...] = ()  # the last frames
    frames_since_try: int = 0  # frames since the last try
    found: Proposal | None = None
    settling: bool = False  # found in few frames: not exact enough to add up many more

    def add_frame(self, seen: Observation) -> FrequencySearch:
        """With one more frame."""
        observations = (*self.observations[1 - SEARCH_FRAMES :], seen)
        return self._replace(observations=observations, frames_since_try=self.frames_since_try + 1)


class History(NamedTuple):
    """Everything that the frames of a track have shown."""

    memories: tuple[PanelMemory, ...]  # one for each pair of frequencies
    state: State = State.SEARCHING
    frames_in_state: int = 0  # with the one that led to it, or since the last one that was read
    last: Identity | None = None  # what they were read as
    search: FrequencySearch = FrequencySearch()

    @classmethod
    def empty(cls, specs: Sequence[PanelSpec]) -> History:
        """Without frames."""
        return cls(memories=tuple(PanelMemory(spec) for spec in specs))

    @property
    def identity(self) -> Identity | None:
        """The reading that is reported now, if any."""
        return self.last if self.state in (State.READ, State.RETUNING) else None

    @property
    def frames(self) -> int:
        """The number of frames that showed the panel."""
        return self.memories[0].frames

    @property
    def is_clear(self) -> bool:
        """Tells whether a ninth of a near panel's samples would confirm the ID that was read last."""
        known = self.last
        if known is None or not (memory := self.memories[known.group]).looked_at:
            return False
        frames = memory.frames_of(MOST_EACH_OF_SEVERAL // THIN)
        return known.reading.likelihood > frames * enough_to_confirm(len(known.reading.cell_bands))

    def add_frame(
        self, seen: Observation, weigher: LightWeigher, *, searched: bool
    ) -> tuple[History, list[Evidence | None]]:
        """With one more frame in the memories, and what it adds to each. The caller then decides on the identity.

        `searched`: frequencies are searched for, so the frame itself is kept, too.
        """
        decimate = self.is_clear
        further, added = zip(
            *(memory.add_frame(seen, weigher, decimate=decimate) for memory in self.memories), strict=True
        )
        search = self.search.add_frame(seen) if searched else self.search
        return self._replace(memories=further, search=search), list(added)

    def enter(self, state: State, identity: Identity | None = None) -> History:
        """One frame later, in this state, where the panel was read once more as `identity` or not."""
        stays = identity is None and state is self.state
        frames = 1 + self.frames_in_state if stays else 1
        return self._replace(state=state, frames_in_state=frames, last=identity or self.last)

    def keep_newest(self, specs: Sequence[PanelSpec] | None = None) -> History:
        """Only the newest frame: those before it do not add up, or showed something else.

        `specs`: at these frequencies, as it shows another panel; else at those that were found.
        """
        newest, search = self.memories[0].newest, self.search
        if specs is not None:
            search = FrequencySearch().add_frame(newest) if search.observations else FrequencySearch()
        spec_of_each = specs or [memory.spec for memory in self.memories]
        return History(memories=tuple(PanelMemory(spec).begin(newest) for spec in spec_of_each), search=search)

    def retune(self, proposal: Proposal, group: int, memory: PanelMemory) -> History:
        """The panel blinks at other frequencies than others of its `group`; `memory` is at these."""
        memories = (*self.memories[:group], memory, *self.memories[group + 1 :])
        settling = len(self.search.observations) < SEARCH_FRAMES
        search = self.search._replace(frames_since_try=0, found=proposal, settling=settling)
        return self._replace(memories=memories, search=search)
