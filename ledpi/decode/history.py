"""What the frames of a track have shown of its panel: a record, and all the ways in which a frame may change it.

A panel is not read yet (`last` is None), read (`shown`), or was read and tells nothing at the moment (`untold` frames
since `last`). Where what was seen turns out to be something else, all begins anew, but for what `Tuning` has.
"""

from __future__ import annotations

from typing import NamedTuple

from ledpi.core.records import Frame, PanelSpec
from ledpi.decode.cells import CellSamples
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.evidence.prediction import Expectation
from ledpi.decode.evidence.memory import PanelMemory
from ledpi.decode.identify.decision import Reading
from ledpi.decode.identify.frequency_search import Proposal, Seen

SEEN_FRAMES = 12  # that are kept to find a panel's frequencies from


class Shown(NamedTuple):
    """What a panel was read as."""

    group: int  # which pair of frequencies, of those that panels may have
    reading: Reading
    expectation: Expectation | None = None  # of the frames to come, once it is made

    def is_expected(self, samples: CellSamples, frame: Frame) -> bool:
        """Whether a frame surely shows the same."""
        return self.expectation is not None and self.expectation.is_met(samples, frame)

    def is_missed(self, samples: CellSamples, frame: Frame) -> bool:
        """Whether a frame rather shows something else."""
        return self.expectation is not None and self.expectation.is_missed(samples, frame)


class Tuning(NamedTuple):
    """The frames that a panel's frequencies are sought in, and those that were found, if not the announced ones."""

    seen: tuple[Seen, ...] = ()  # the last frames
    looks: int = 0  # frames since the last try
    found: Proposal | None = None
    found_by: int = 0  # frames

    @property
    def settling(self) -> bool:
        """Whether its frequencies were told from a few frames, which is not exact enough for many more."""
        return self.found is not None and self.found_by < SEEN_FRAMES

    def after(self, samples: CellSamples, frame: Frame) -> Tuning:
        """With a further frame."""
        seen = (*self.seen[1 - SEEN_FRAMES :], Seen(samples=samples, frame=frame))
        return self._replace(seen=seen, looks=self.looks + 1)

    def of_newest_alone(self) -> Tuning:
        """The frames before say nothing of what blinks there now."""
        return self._replace(seen=self.seen[-1:], looks=1)

    def tried(self) -> Tuning:
        """Frequencies were sought, and not found."""
        return self._replace(looks=0)

    def found_as(self, proposal: Proposal) -> Tuning:
        """Frequencies were sought, and found."""
        return self._replace(looks=0, found=proposal, found_by=len(self.seen))


class History(NamedTuple):
    """What the frames of a track have shown."""

    memories: tuple[PanelMemory, ...]  # one for each pair of frequencies
    last: Shown | None = None  # what they were read as
    untold: int = 0  # frames since then that told nothing, and are not in the memories
    met: int = 0  # frames since then that were as expected
    confirmed: int = 0  # all frames that were as expected, and are not in the memories
    tuning: Tuning = Tuning()

    @classmethod
    def of(cls, specs: tuple[PanelSpec, ...], tuning: Tuning | None = None) -> History:
        """Before there was a frame."""
        return cls(memories=tuple(PanelMemory(spec) for spec in specs), tuning=tuning or Tuning())

    @property
    def shown(self) -> Shown | None:
        """What it is read as now."""
        return None if self.untold else self.last

    @property
    def frames(self) -> int:
        """How many have shown it."""
        return self.memories[0].frames + self.confirmed

    def as_expected(self) -> History:
        """A further frame is as expected of what is shown: that is all that is asked of it."""
        return self._replace(met=self.met + 1, confirmed=self.confirmed + 1)

    def not_only_expected(self) -> History:
        """The newest frame, which was as expected, is to enter the memories after all."""
        return self._replace(confirmed=self.confirmed - 1)

    def expecting(self, shown: Shown, expectation: Expectation) -> History:
        """What is `shown` lets this be expected."""
        return self._replace(last=shown._replace(expectation=expectation))

    def after(self, samples: CellSamples, frame: Frame) -> tuple[History, list[Evidence | None]]:
        """With a further frame in the memories, and what it adds to each. What it is read as is to be told."""
        further, added = zip(*(memory.after(samples, frame) for memory in self.memories), strict=True)
        return self._replace(memories=further, tuning=self.tuning.after(samples, frame)), list(added)

    def read_as(self, shown: Shown) -> History:
        """The memories show this."""
        return self._replace(last=shown, untold=0, met=0)

    def not_read(self) -> History:
        """They show nothing, or nothing that is believed."""
        return self._replace(last=None, untold=0, met=0)

    def with_untold(self, tuning: Tuning) -> History:
        """A further frame tells nothing, and the memories did. So it is left out of them, but not of the `tuning`."""
        return self._replace(untold=self.untold + 1, tuning=tuning)

    def of_newest_alone(self) -> History:
        """The frames before the newest were of something else, or do not add up."""
        memories = tuple(PanelMemory(memory.spec).after(*memory.newest)[0] for memory in self.memories)
        return History(memories=memories, tuning=self.tuning)

    def tuned(self, tuning: Tuning) -> History:
        """The same memories, with another `tuning`."""
        return self._replace(tuning=tuning)

    def tuned_to(self, proposal: Proposal, group: int, memory: PanelMemory) -> History:
        """The panel is one of this `group` at other frequencies, which `memory` has."""
        memories = (*self.memories[:group], memory, *self.memories[group + 1 :])
        return self._replace(memories=memories, tuning=self.tuning.found_as(proposal))
