"""What a panel shows: adds a frame to its history and tells the word, or that it is another one than before.

Three questions, each asked only where the one before leaves it open. Does the frame show what was shown before? What
word do all frames together show? And if none, do they at other frequencies than announced?
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from ledpi.core.records import Frame, PanelSpec, Rejected
from ledpi.decode.cells import CellSamples
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.evidence.prediction import UNLIKE, Expectation
from ledpi.decode.evidence.memory import PanelMemory
from ledpi.decode.evidence.waves import band_prior, is_deep
from ledpi.decode.history import History, Shown
from ledpi.decode.identify import decision
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.identify.innovation_gate import confirms, denies, tells_of
from ledpi.decode.identify.decision import Reading
from ledpi.decode.identify.frequency_search import CHOICES, Seen, propose_frequencies
from ledpi.decode.identify.codewords import likeliest

# Frames that surely show what was read last are not read anew, but for one of eight: by then a panel may look a little
# otherwise, and the margin has grown.
READ_EVERY = 8
# What was read is still shown while it leads by what this rate asks for, 4.8 nats and not 11.3: else a word that has
# only just passed comes and goes with the noise of further frames.
KEPT_RATE = 1e-3
# A track whose frames add up to nothing may blink at other frequencies. That is tried after every so many.
TUNE_EVERY = 4
# Frames that contradict each other make a track forget: one that remembers less than this does not add up.
ADDS_UP_FRAMES = 4

# A frame of which comparison with those before tells less than the share ALIKE of what these have told, each, or which
# misses what they let expect, is asked by itself, too, as that tells another panel's word at once. (It is a worse
# witness where a part of a panel is hidden.)
# Below the share UNLIKE it must be for what was shown: it looks so unlike those before that what is left is no measure
# of noise. (It may also show their very phases.)
ALIKE = 0.5
DOUBTED = Rejected(stage="track", reason="unlike_before")

# What no further frame can mend: this is no panel, or not where it was thought to be.
SOMETHING_ELSE = (soft.INCONSISTENT, soft.IMPLAUSIBLE)


class Added(NamedTuple):
    """A history with a further frame."""

    history: History
    denied: bool = False  # that frame shows something else: all before it is forgotten
    doubted: bool = False  # it is unlike those before, and by itself not surely for what they have shown


class Outcome(NamedTuple):
    """What became of a frame."""

    history: History
    shown: Shown | Rejected
    denied: bool  # that it shows what the frames before have shown


class Reader:
    """Reads the panels of some pairs of frequencies. Keeps nothing; what is known of a panel is in its history.

    Of a `frame` its times count. Histories keep it: let it come without its picture.
    """

    def __init__(
        self, codebooks: Sequence[Codebook], false_id_rate: float, *, search_frequencies: bool = False
    ) -> None:
        self._codebooks = tuple(codebooks)
        self._false_id_rate = false_id_rate
        self._search_frequencies = search_frequencies

    def read(self, history: History, samples: CellSamples, frame: Frame) -> Outcome:
        """The word that is shown with this frame, or why none can be told."""
        shown = history.shown
        if shown is None or history.tuning.settling or not shown.is_expected(samples, frame):
            return self._read_anew(history, samples, frame)
        return Outcome(history=history.as_expected(), shown=shown, denied=False)

    def keep_up(self, history: History, samples: CellSamples, frame: Frame) -> History:
        """What is for the good of the frames to come, once this one, which has shown `samples`, has given its results.

        What was as expected for a while is read anew, and what the next frame should look like is made ready.
        """
        if history.shown is not None and history.met >= READ_EVERY:
            history = self._read_anew(history.not_only_expected(), samples, frame).history
        shown = history.shown
        if shown is None or shown.expectation is not None:
            return history
        memory = history.memories[shown.group]
        expectation = Expectation.of(memory, shown.reading.cell_bands, _usual_nats(memory, shown))
        return history.expecting(shown, expectation)

    def _read_anew(self, before: History, samples: CellSamples, frame: Frame) -> Outcome:
        now, denied, doubted = _with_frame(before, samples, frame)
        shown = DOUBTED if doubted else self._decide(now, self._false_id_rate)
        if isinstance(shown, Rejected) and not denied and (before.last is not None or _may_speak_alone(now)):
            # Together they tell nothing any more; where phases run other than expected, each frame still may by itself.
            only = now.of_newest_alone()
            alone = self._decide(only, self._false_id_rate)
            if isinstance(alone, Shown):
                now, shown = only, alone
                if before.last is not None and not _is_same(alone, before.last):
                    now = now.tuned(now.tuning.of_newest_alone())
            elif before.last is not None and not doubted:
                shown = self._still(now, before.last) or shown
        open_yet = isinstance(shown, Rejected) or now.frames < ADDS_UP_FRAMES or now.tuning.settling
        if self._search_frequencies and open_yet and now.tuning.looks >= TUNE_EVERY:
            tuned = self._tune(now, doubted)
            decided = shown if tuned is None else self._decide(tuned, self._false_id_rate)
            # Frequencies are sought in frames that may be of what was there before: these do not overrule a word.
            overruled = isinstance(shown, Shown) and isinstance(decided, Shown) and not _is_same(shown, decided)
            if tuned is None or overruled:
                now = now.tuned(now.tuning.tried())
            else:
                now, shown = tuned, decided
        if isinstance(shown, Shown):
            now = now.read_as(shown)
        else:
            now = now.not_read() if before.last is None or denied else _without_newest(before, now)
        return Outcome(history=now, shown=shown, denied=denied)

    def _still(self, now: History, last: Shown) -> Shown | None:
        """What was read last, if all frames together still show that."""
        kept = self._decide(now, KEPT_RATE)
        if isinstance(kept, Rejected):
            return None
        return kept if _is_same(kept, last) else None

    def _decide(self, history: History, rate: float) -> Shown | Rejected:
        if history.tuning.found is not None:
            rate /= CHOICES  # as frequencies that were chosen to fit leave chance more ways to look like a word
        readings = [self._word(memory, group, rate) for group, memory in enumerate(history.memories)]
        reading = soft.surest(readings, rate)
        if isinstance(reading, Rejected):
            return reading
        ids = [r.id if isinstance(r, Reading) else None for r in readings]
        return Shown(group=ids.index(reading.id), reading=reading)

    def _word(self, memory: PanelMemory, group: int, rate: float) -> Reading | Rejected:
        book = self._codebooks[group]
        alone = self._alone(memory, book if memory.spec is book.spec else replace(book, spec=memory.spec), rate)
        if alone is not None:
            return alone
        evidence = memory.evidence()
        if isinstance(evidence, Rejected):
            return evidence
        return soft.decide(evidence, book, rate)

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
            return reading._replace(cell_bands=memory.in_its_time(reading.cell_bands))
        return reading if reading in SOMETHING_ELSE else None

    def _tune(self, history: History, doubted: bool) -> History | None:
        """The history at other frequencies, at which its frames add up to a word; None where there are none.

        What the frames before have shown may be there no more: a newest one that is doubted must be for it by itself.
        """
        seen = history.tuning.seen
        for group, book in enumerate(self._codebooks):
            proposal = propose_frequencies(seen, book.spec, book)
            if proposal is None:
                continue
            memory, added = _remembered(seen, proposal.spec)
            reading = self._word(memory, group, self._false_id_rate / CHOICES)
            if isinstance(reading, Rejected) or denies(added, reading.cell_bands):
                continue
            if doubted and not confirms(memory.of_newest(), reading.cell_bands):
                continue
            if reading.likelihood > _explained(seen, book):
                return history.tuned_to(proposal, group, memory)
        return None


def _is_same(one: Shown, other: Shown) -> bool:
    """Whether both are the same word, hung alike."""
    return (one.reading.id, one.reading.quarter_turns) == (other.reading.id, other.reading.quarter_turns)


def _with_frame(before: History, samples: CellSamples, frame: Frame) -> Added:
    """With a further frame, and whether that speaks against what was shown."""
    now, added = before.after(samples, frame)
    last = before.last
    if last is None:
        return Added(now)
    said, shown = added[last.group], last.reading.cell_bands
    if denies(said, shown):
        if now.frames > ADDS_UP_FRAMES and not now.tuning.settling:
            # They did add up: what is there now is something else, at any frequencies.
            now = now.tuned(now.tuning.of_newest_alone())
        return Added(now.of_newest_alone(), denied=True)
    like = 0.0 if said is None else tells_of(said, shown) / _usual_nats(before.memories[last.group], last)
    if like > ALIKE and not last.is_missed(samples, frame):
        return Added(now)
    alone = now.memories[last.group].of_newest()
    return Added(now, doubted=not confirms(alone, shown) if like < UNLIKE else denies(alone, shown))


def _usual_nats(memory: PanelMemory, shown: Shown) -> float:
    """What one of the frames has told, on average, of the word over no bands."""
    return shown.reading.likelihood / memory.frames_worth


def _without_newest(before: History, now: History) -> History:
    """A frame that tells nothing, and with which those before tell nothing any more, is not remembered with them.

    Its square was taken elsewhere, say, or something stood before it. Where that goes on, they are out of date.
    """
    return before.with_untold(now.tuning) if before.untold < ADDS_UP_FRAMES else now.of_newest_alone()


def _may_speak_alone(history: History) -> bool:
    """Whether the newest frame is asked by itself: while there are few, and now and then, as old ones may be wrong."""
    return history.frames > 1 and (history.frames <= TUNE_EVERY or history.frames % READ_EVERY == 0)


def _remembered(seen: Sequence[Seen], spec: PanelSpec) -> tuple[PanelMemory, Evidence | None]:
    """A memory of frames at these frequencies, and what the last of them has added."""
    memory, added = PanelMemory(spec), None
    for each in seen:
        memory, added = memory.after(each.samples, each.frame)
    return memory, added


def _explained(seen: Sequence[Seen], book: Codebook) -> float:
    """Log-likelihood ratio to "no bands" of the best word at the announced frequencies, whether it can be told or not.

    Where these explain more than others do, a panel shows no word, and chance has found frequencies that make it one.
    """
    evidence = _remembered(seen, book.spec)[0].evidence()
    return likeliest(evidence, book.white).likelihood[0] if isinstance(evidence, Evidence) else -math.inf
