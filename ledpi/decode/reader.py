"""Reads a panel: adds a frame to its history, and asks what the table of states (`states`) has it ask.

If its frames show no codeword, or are few, one is sought at other frequencies than the configured ones.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from ledpi.core.records import PanelSpec, Rejected
from ledpi.decode.evidence.cells import Observation
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.evidence.light import LightWeigher
from ledpi.decode.evidence.memory import PanelMemory
from ledpi.decode.history import History, Identity
from ledpi.decode.identify import decision
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.identify.codewords import rank_codewords
from ledpi.decode.identify.decision import Reading
from ledpi.decode.identify.frequency_search import CHOICES, propose_frequencies
from ledpi.decode.identify.innovation_gate import confirms, contradicts, innovation_of
from ledpi.decode.identify.one_frame import read_frame
from ledpi.decode.states import Ask, Event, State, rule_of

# Hysteresis: an ID is kept while its odds are those of this rate, 4.8 nats and not 11.3. Otherwise a codeword that has
# only just passed would come and go with the noise of further frames.
HYSTERESIS_RATE = 1e-3
# A track whose frames add up to nothing may blink at other frequencies. That is tried after every so many.
TUNE_EVERY = 4
OLD_EVERY = 8  # frames, once there are more than that: then the newest is read by itself, as old ones may be wrong
# Frames that contradict each other make a track forget: one that remembers less than this does not add up.
ADDS_UP_FRAMES = 4

# A frame is also read by itself if its comparison adds less than this share of the usual log-likelihood ratio, or if
# cells of the other class outweigh the rest: that detects another panel's codeword at once. (It is less reliable if a
# part of the panel is occluded.) Below the share UNLIKE it must confirm the identity by itself: it differs so much from
# earlier frames that their residual is no measure of noise. (Or it has the very same phases.)
TYPICAL_SHARE, UNLIKE = 0.5, 0.25
INNOVATION = Rejected(stage="track", reason="innovation")


class Outcome(NamedTuple):
    """The result of one frame."""

    history: History
    identity: Identity | Rejected
    event: Event  # the frame, by what it shows of the ID before


class Reader:
    """Reads the panels of some pairs of frequencies. It has no state: what is known of a panel is in its history."""

    def __init__(
        self,
        codebooks: Sequence[Codebook],
        weigher: LightWeigher,
        false_id_rate: float,
        *,
        search_frequencies: bool = False,
    ) -> None:
        self._codebooks, self._specs = tuple(codebooks), tuple(book.spec for book in codebooks)
        self._weigher, self._false_id_rate = weigher, false_id_rate
        self._search_frequencies = search_frequencies

    def read(self, before: History, seen: Observation) -> Outcome:
        """The codeword after this frame, or the reason why there is none."""
        now, event = self._add_frame(before, seen)
        rule = rule_of(before.state, event, before.frames_in_state)
        if not rule.asks and before.last is not None:
            return Outcome(history=now.enter(before.state), identity=before.last, event=event)
        if rule.to is State.SEARCHING:
            # If the frames did add up, what is there now is something else, at any frequencies.
            adds_up = now.frames > ADDS_UP_FRAMES and not now.search.settling
            now = now.keep_newest(self._specs if adds_up else None)
        now, identity = self._ask(rule.asks, now, before.last)
        if self._search_frequencies and now.search.frames_since_try >= TUNE_EVERY:
            now, identity = self._tune(now, identity, must_confirm=event is Event.ADDS_NOTHING)
        found = identity if isinstance(identity, Identity) else None
        answer = Event.NONE if found is None else Event.ROUGHLY if now.search.settling else Event.CODEWORD
        rule = rule_of(rule.to or before.state, answer, before.frames_in_state)
        if rule.to is State.DOUBTED:
            now = before._replace(search=now.search)
        elif rule.to is State.SEARCHING:
            now = now.keep_newest()
        return Outcome(history=now.enter(rule.to or before.state, found), identity=identity, event=event)

    def _add_frame(self, before: History, seen: Observation) -> tuple[History, Event]:
        """The history with one more frame, and what that frame says of the identity so far."""
        last = before.last
        now, added = before.add_frame(seen, self._weigher, searched=self._search_frequencies)
        if last is None:
            return now, Event.ADDS
        newest, shown, memory = added[last.group], last.reading.cell_bands, now.memories[last.group]
        like = 0.0
        if newest is not None and memory.mean is not None:
            innovation = innovation_of(newest, shown)
            if innovation.contradicts:
                return now, Event.CONTRADICTS
            usual = last.reading.likelihood / before.memories[last.group].frames_of(memory.mean.each)
            like = innovation.expected / usual
            if like > TYPICAL_SHARE and not innovation.prefers_others:
                return now, Event.MATCHES if innovation.confirms else Event.ADDS
        alone = memory.newest_evidence(self._weigher)
        fails = not confirms(alone, shown) if like < UNLIKE else contradicts(alone, shown)
        return now, Event.ADDS_NOTHING if fails else Event.ADDS

    def _ask(self, asks: Sequence[Ask], now: History, last: Identity | None) -> tuple[History, Identity | Rejected]:
        """The frames that show a codeword, and this; or all, and the reason why they do not."""
        reason = INNOVATION
        for ask in asks:
            if ask is Ask.AT_TIMES and not 1 < now.frames <= TUNE_EVERY and now.frames % OLD_EVERY:
                continue
            asked = now if ask in (Ask.ALL, Ask.STILL) else now.keep_newest()
            answer = self._decide(asked, HYSTERESIS_RATE if ask is Ask.STILL else self._false_id_rate)
            if isinstance(answer, Rejected):
                reason = answer if ask is Ask.ALL else reason
            elif ask is Ask.ALL or last is None or _is_same(answer, last):
                return asked, answer
            elif ask is Ask.NEWEST:
                return asked.keep_newest(self._specs), answer
        return now, reason

    def _tune(
        self, now: History, identity: Identity | Rejected, *, must_confirm: bool
    ) -> tuple[History, Identity | Rejected]:
        """The same at frequencies that are sought in the last frames, unless the codeword is sure."""
        if isinstance(identity, Identity) and now.frames >= ADDS_UP_FRAMES and not now.search.settling:
            return now, identity
        tuned = self._search_frequencies_of(now, must_confirm=must_confirm)
        if tuned is not None:
            decided = self._decide(tuned, self._false_id_rate)
            # The last frames may be of what was there before: they do not overrule a codeword.
            if isinstance(identity, Rejected) or isinstance(decided, Rejected) or _is_same(identity, decided):
                return tuned, decided
        return now._replace(search=now.search._replace(frames_since_try=0)), identity

    def _decide(self, history: History, rate: float) -> Identity | Rejected:
        if history.search.found is not None:
            rate /= CHOICES  # as frequencies that were chosen to fit leave chance more ways to look like a codeword
        readings = [self._read_memory(memory, group, rate) for group, memory in enumerate(history.memories)]
        reading = decision.select_best(readings, rate)
        if isinstance(reading, Rejected):
            return reading
        group = next(k for k, r in enumerate(readings) if isinstance(r, Reading) and r.id == reading.id)
        return Identity(group=group, reading=reading)

    def _read_memory(self, memory: PanelMemory, group: int, rate: float) -> Reading | Rejected:
        book = self._codebooks[group]
        book = book if memory.spec is book.spec else replace(book, spec=memory.spec)
        if memory.frames == 1:
            reading = read_frame(memory.newest, book, self._weigher, rate)
            if isinstance(reading, Reading):
                return reading._replace(cell_bands=memory.count_from_origin(reading.cell_bands))
            return reading
        evidence = memory.evidence(self._weigher)
        return evidence if isinstance(evidence, Rejected) else decision.decide(evidence, book, rate)

    def _search_frequencies_of(self, history: History, *, must_confirm: bool) -> History | None:
        """The history at other frequencies, at which its frames add up to a codeword; None if there are none.

        The earlier frames may show a panel that is gone: a newest frame that fails the gate must confirm by itself.
        """
        observations = history.search.observations
        for group, book in enumerate(self._codebooks):
            proposal = propose_frequencies(observations, book.spec, book)
            if proposal is None:
                continue
            memory, added = self._replay(observations, proposal.spec)
            reading = self._read_memory(memory, group, self._false_id_rate / CHOICES)
            if isinstance(reading, Rejected) or contradicts(added, reading.cell_bands):
                continue
            if must_confirm and not confirms(memory.newest_evidence(self._weigher), reading.cell_bands):
                continue
            if reading.likelihood > self._announced_likelihood(observations, book):
                return history.retune(proposal, group, memory)
        return None

    def _replay(self, observations: Sequence[Observation], spec: PanelSpec) -> tuple[PanelMemory, Evidence | None]:
        """The memory of these frames at these frequencies, and what the last of them has added."""
        memory, added = PanelMemory(spec), None
        for seen in observations:
            memory, added = memory.add_frame(seen, self._weigher)
        return memory, added

    def _announced_likelihood(self, observations: Sequence[Observation], book: Codebook) -> float:
        """Log-likelihood ratio to "no bands" of the best codeword at the configured frequencies, accepted or not.

        If these explain more than others do, the panel shows no codeword, and other frequencies only fit by chance.
        """
        evidence = self._replay(observations, book.spec)[0].evidence(self._weigher)
        return rank_codewords(evidence, book.white).likelihood[0] if isinstance(evidence, Evidence) else -math.inf


def _is_same(one: Identity, other: Identity) -> bool:
    """Tells whether both are the same codeword in the same orientation."""
    return (one.reading.id, one.reading.quarter_turns) == (other.reading.id, other.reading.quarter_turns)
