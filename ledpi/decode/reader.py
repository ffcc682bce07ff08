"""What a track shows: adds a frame to its memories and tells the word, or that it is another one than before.

Three questions, each asked only where the one before leaves it open. Does the frame show what the track has shown
before? What word do all its frames together show? And if none, do they at other frequencies than announced?
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from ledpi.decode.cells import CellSamples
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.evidence.expect import Expectation
from ledpi.decode.evidence.memory import PanelMemory
from ledpi.decode.evidence.waves import band_prior, is_deep
from ledpi.decode.identify import soft
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.identify.denial import denies
from ledpi.decode.identify.soft import Reading
from ledpi.decode.identify.tuning import CHOICES, Seen, propose_frequencies
from ledpi.decode.identify.words import likeliest
from ledpi.decode.track import Shown, Track
from ledpi.records import Frame, PanelSpec, Rejected

# Frames that surely show what was read last are not read anew, but for one of eight: by then a panel may look a little
# otherwise, and the margin has grown.
READ_EVERY = 8
# A track whose frames add up to nothing may blink at other frequencies. That is tried after every so many.
TUNE_EVERY = 4
# Frames that contradict each other make a track forget: one that remembers less than this does not add up.
ADDS_UP_FRAMES = 4

# What no further frame can mend: this is no panel, or not where it was thought to be.
SOMETHING_ELSE = (soft.INCONSISTENT, soft.IMPLAUSIBLE)


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """What became of a frame."""

    reading: Reading | Rejected
    group: int  # which pair of frequencies it is of; the first where nothing was read
    denied: bool  # that it shows what the track has shown before


class Reader:
    """Reads the panels of some pairs of frequencies. Keeps nothing; what is known of a panel is in its track.

    Of a `frame` its times count. Tracks keep it: let it come without its picture.
    """

    def __init__(self, codebooks: Sequence[Codebook], false_id_rate: float) -> None:
        self._codebooks = tuple(codebooks)
        self._false_id_rate = false_id_rate

    def read(self, track: Track, samples: CellSamples, frame: Frame) -> Outcome:
        """The word that a track shows with this frame, or why none can be told."""
        shown = track.shown
        if shown is not None and not track.settling and self._is_as_expected(track, shown, samples, frame):
            return Outcome(reading=shown.reading, group=shown.group, denied=False)
        return self._read_anew(track, samples, frame)

    def keep_up(self, track: Track, samples: CellSamples, frame: Frame) -> None:
        """What is for the good of the frames to come, once this one, which has shown `samples`, has given its results.

        A track that was as expected for a while is read anew, and what its next frame should look like is made ready.
        """
        if track.shown is not None and track.shown.frames >= READ_EVERY:
            track.confirmed -= 1  # as this frame now enters the memories
            self._read_anew(track, samples, frame)
        if track.shown is not None and track.shown.expectation is None:
            track.shown = replace(track.shown, expectation=_expectation(track, track.shown))

    def _is_as_expected(self, track: Track, shown: Shown, samples: CellSamples, frame: Frame) -> bool:
        expectation = shown.expectation or _expectation(track, shown)
        met = expectation.is_met(samples, frame)
        track.shown = replace(shown, expectation=expectation, frames=shown.frames + 1)
        track.confirmed += met
        return met

    def _read_anew(self, track: Track, samples: CellSamples, frame: Frame) -> Outcome:
        last = track.shown or track.before
        known = () if last is None else tuple(copy.copy(memory) for memory in track.memories)
        denied = self._add(track, samples, frame)
        group, reading = self._decide(track.memories, tuned=track.tuned is not None)
        if isinstance(reading, Rejected) and not denied and (last is not None or _may_speak_alone(track)):
            # Together they tell nothing any more; where phases run other than expected, each frame still may by itself.
            only = self._only(track, samples, frame)
            group, alone = self._decide(only, tuned=track.tuned is not None)
            if isinstance(alone, Reading):
                reading = alone
                track.begin_anew(only)
        open_yet = isinstance(reading, Rejected) or track.frames < ADDS_UP_FRAMES or track.settling
        if open_yet and track.looks >= TUNE_EVERY:
            track.looks = 0
            if self._tune(track):
                group, reading = self._decide(track.memories, tuned=True)
        track.shown = None
        if isinstance(reading, Reading):
            track.shown = Shown(group=group, reading=reading, expectation=None, frames=0)
            track.before, track.untold = None, 0
        elif last is not None and not denied:
            self._leave_out(track, known, last, samples, frame)
        return Outcome(reading=reading, group=group, denied=denied)

    def _leave_out(
        self, track: Track, known: tuple[PanelMemory, ...], last: Shown, samples: CellSamples, frame: Frame
    ) -> None:
        """A frame that tells nothing, and with which those before tell nothing any more, is not remembered with them.

        Its square was taken elsewhere, say, or something stood before it. Where that goes on, they are out of date.
        """
        track.before, track.untold = last, track.untold + 1
        if track.untold <= ADDS_UP_FRAMES:
            track.memories = known
        else:
            track.begin_anew(self._only(track, samples, frame))

    def _add(self, track: Track, samples: CellSamples, frame: Frame) -> bool:
        """Adds a frame to a track. True where it denies what that has shown; then all before it is forgotten."""
        added = [memory.add(samples, frame) for memory in track.memories]
        track.seen.append(Seen(samples=samples, frame=frame))
        track.looks += 1
        shown = track.shown or track.before
        if shown is None or not denies(added[shown.group], shown.reading.cell_bands):
            return False
        if track.frames > ADDS_UP_FRAMES and not track.settling:
            track.forget_seen()  # they did add up: what is there now is something else, at any frequencies
        track.begin_anew(self._only(track, samples, frame))
        return True

    def _only(self, track: Track, samples: CellSamples, frame: Frame) -> tuple[PanelMemory, ...]:
        """Memories of this one frame."""
        memories = tuple(PanelMemory(memory.spec) for memory in track.memories)
        for memory in memories:
            memory.add(samples, frame)
        return memories

    def _decide(self, memories: Sequence[PanelMemory], *, tuned: bool) -> tuple[int, Reading | Rejected]:
        readings = [self._word(memory, group, tuned=tuned) for group, memory in enumerate(memories)]
        reading = soft.surest(readings, self._false_id_rate)
        ids = [r.id if isinstance(r, Reading) else None for r in readings]
        return (ids.index(reading.id) if isinstance(reading, Reading) else 0), reading

    def _word(self, memory: PanelMemory, group: int, *, tuned: bool) -> Reading | Rejected:
        # Frequencies that were chosen to fit leave chance more ways to look like a word.
        rate = self._false_id_rate / CHOICES if tuned else self._false_id_rate
        book = self._codebooks[group]
        alone = self._alone(memory, book if memory.spec is book.spec else replace(book, spec=memory.spec), rate)
        if alone is not None:
            return alone
        evidence = memory.evidence()
        return soft.decide(evidence, book, rate) if isinstance(evidence, Evidence) else evidence

    def _alone(self, memory: PanelMemory, book: Codebook, rate: float) -> Reading | Rejected | None:
        """What the newest frame shows by itself; None where it is for all frames together to tell.

        A single frame of deep bands says all, to who looks twice, or that something is not as it should be.
        """
        samples, frame = memory.newest
        if memory.frames == 1:
            return soft.read_word(samples, frame, book, rate)
        if not is_deep(band_prior(frame, book.spec)):
            return None
        reading = soft.read_word(samples, frame, book, rate)
        if isinstance(reading, Reading):
            return replace(reading, cell_bands=memory.in_its_time(reading.cell_bands))
        return reading if reading in SOMETHING_ELSE else None

    def _tune(self, track: Track) -> bool:
        """Whether a track's frames add up to a word at other frequencies; then its memory has them."""
        for group, book in enumerate(self._codebooks):
            for proposal in propose_frequencies(track.seen, book.spec, book):
                memory, added = _remembered(track, proposal.spec)
                reading = self._word(memory, group, tuned=True)
                # What the frames before have shown may be there no more.
                if (
                    isinstance(reading, Reading)
                    and not denies(added, reading.cell_bands)
                    and reading.likelihood > _explained(track, book)
                ):
                    track.memories = (*track.memories[:group], memory, *track.memories[group + 1 :])
                    track.tuned, track.tuned_by = proposal, len(track.seen)
                    return True
        return False


def _may_speak_alone(track: Track) -> bool:
    """Whether the newest frame is asked by itself: while there are few, and now and then, as old ones may be wrong."""
    return track.frames > 1 and (track.frames <= TUNE_EVERY or track.frames % READ_EVERY == 0)


def _remembered(track: Track, spec: PanelSpec) -> tuple[PanelMemory, Evidence | None]:
    """The frames that a track keeps as a memory at these frequencies, and what the last of them has added."""
    memory, added = PanelMemory(spec), None
    for seen in track.seen:
        added = memory.add(seen.samples, seen.frame)
    return memory, added


def _explained(track: Track, book: Codebook) -> float:
    """Log-likelihood ratio to "no bands" of the best word at the announced frequencies, whether it can be told or not.

    Where these explain more than others do, a panel shows no word, and chance has found frequencies that make it one.
    """
    evidence = _remembered(track, book.spec)[0].evidence()
    return likeliest(evidence, book.white).likelihood[0] if isinstance(evidence, Evidence) else -math.inf


def _expectation(track: Track, shown: Shown) -> Expectation:
    return Expectation.of(track.memories[shown.group], shown.reading.cell_bands)
