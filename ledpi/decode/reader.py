"""Reads a panel: adds a frame to its history, and decides on a codeword from all frames of its track.

Three questions, each asked only if the one before stays open. Does the frame clearly show what was read? Which
codeword do all frames together show? And if none: do they show one at other frequencies than the configured ones?
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

from ledpi.core.records import PanelSpec, Rejected
from ledpi.decode.evidence.evidence import UNFIT, Evidence
from ledpi.decode.evidence.light import LightWeigher
from ledpi.decode.evidence.memory import PanelMemory
from ledpi.decode.evidence.waves import band_prior, is_deep, is_faint
from ledpi.decode.history import History, Identity
from ledpi.decode.identify import decision
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.identify.codewords import rank_codewords
from ledpi.decode.identify.decision import Reading
from ledpi.decode.identify.frequency_search import CHOICES, propose_frequencies
from ledpi.decode.identify.innovation_gate import (
    confirms,
    contradicts,
    expected_log_likelihood_ratio,
    prefers_others,
)
from ledpi.decode.observation import Observation

# Frames that clearly show what was read are not read again, but for one of eight: by then a panel may look a little
# different, and the margin has grown.
READ_EVERY = 8
# Hysteresis: an ID is kept while its odds are those of this rate, 4.8 nats and not 11.3. Otherwise a codeword that has
# only just passed would come and go with the noise of further frames.
HYSTERESIS_RATE = 1e-3
# A track whose frames add up to nothing may blink at other frequencies. That is tried after every so many.
TUNE_EVERY = 4
# Frames that contradict each other make a track forget: one that remembers less than this does not add up.
ADDS_UP_FRAMES = 4

# A frame is also read by itself if its comparison adds less than this share of the usual log-likelihood ratio, or if
# cells of the other class outweigh the rest: that detects another panel's codeword at once. (It is less reliable if a
# part of the panel is occluded.) Below the share UNLIKE it must confirm the identity by itself: it differs so much from
# earlier frames that their residual is no measure of noise. (Or it has the very same phases.)
TYPICAL_SHARE, UNLIKE = 0.5, 0.25
INNOVATION = Rejected(stage="track", reason="innovation")

# No further frame can change these: this is no panel, or not at this place.
NOT_THIS_PANEL = (decision.INCONSISTENT, decision.IMPLAUSIBLE)


class Added(NamedTuple):
    """A history with one more frame."""

    history: History
    matches: bool = False  # the frame clearly shows what was read
    contradicted: bool = False  # the frame shows something else: the earlier frames are forgotten
    gated: bool = False  # the frame fails the innovation gate


class Outcome(NamedTuple):
    """The result of one frame."""

    history: History
    identity: Identity | Rejected
    contradicted: bool  # the frame shows something else than the frames before


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
        self._codebooks = tuple(codebooks)
        self._weigher = weigher
        self._specs = tuple(book.spec for book in codebooks)
        self._false_id_rate = false_id_rate
        self._search_frequencies = search_frequencies

    def read(self, before: History, seen: Observation) -> Outcome:
        """The codeword after this frame, or the reason why there is none."""
        added = self._add_frame(before, seen)
        identity = before.identity
        if identity is None or not added.matches or before.search.settling or before.matched >= READ_EVERY:
            return self._read_all_frames(before, added)
        return Outcome(history=added.history.confirm(), identity=identity, contradicted=False)

    def _read_all_frames(self, before: History, added: Added) -> Outcome:
        now, _, contradicted, gated = added
        identity = INNOVATION if gated else self._decide(now, self._false_id_rate)
        if (
            isinstance(identity, Rejected)
            and not contradicted
            and (before.last is not None or _is_newest_tried_alone(now))
        ):
            # Together they tell nothing any more; where phases run other than expected, each frame still may by itself.
            only = now.keep_newest()
            alone = self._decide(only, self._false_id_rate)
            if isinstance(alone, Identity):
                now, identity = only, alone
                if before.last is not None and not _is_same(alone, before.last):
                    now = now.begin_again(self._specs)
            elif before.last is not None and not gated:
                identity = self._confirm_last(now, before.last) or identity
        open_yet = isinstance(identity, Rejected) or now.frames < ADDS_UP_FRAMES or now.search.settling
        if self._search_frequencies and open_yet and now.search.frames_since_try >= TUNE_EVERY:
            tuned = self._search_frequencies_of(now, gated)
            decided = identity if tuned is None else self._decide(tuned, self._false_id_rate)
            # Frequencies are sought in frames that may be of what was there before: these do not overrule a codeword.
            overruled = (
                isinstance(identity, Identity) and isinstance(decided, Identity) and not _is_same(identity, decided)
            )
            if tuned is None or overruled:
                now = now.set_search(now.search.mark_failed())
            else:
                now, identity = tuned, decided
        if isinstance(identity, Identity):
            now = now.identify_as(identity)
        else:
            now = now.clear_identity() if before.last is None or contradicted else _drop_newest(before, now)
        return Outcome(history=now, identity=identity, contradicted=contradicted)

    def _add_frame(self, before: History, seen: Observation) -> Added:
        """The history with one more frame, and what that frame says of the identity so far."""
        now, added = before.add_frame(seen, self._weigher, searched=self._search_frequencies)
        last = before.last
        if last is None:
            return Added(now)
        newest, identity = added[last.group], last.reading.cell_bands
        if contradicts(newest, identity):
            if now.frames > ADDS_UP_FRAMES and not now.search.settling:
                # They did add up: what is there now is something else, at any frequencies.
                return Added(now.begin_again(self._specs), contradicted=True)
            return Added(now.keep_newest(), contradicted=True)
        memory = now.memories[last.group]
        like = (
            0.0
            if newest is None
            else expected_log_likelihood_ratio(newest, identity) / _typical_nats(before.memories[last.group], last)
        )
        if like > TYPICAL_SHARE and not prefers_others(newest, identity):
            is_decided_alone = is_deep(band_prior(seen.frame, memory.spec))
            return Added(now, matches=not is_decided_alone and confirms(newest, identity))
        alone = memory.newest_evidence(self._weigher)
        return Added(now, gated=not confirms(alone, identity) if like < UNLIKE else contradicts(alone, identity))

    def _confirm_last(self, now: History, last: Identity) -> Identity | None:
        """The last identity, if all frames together still support it at the lower odds of the hysteresis."""
        kept = self._decide(now, HYSTERESIS_RATE)
        if isinstance(kept, Rejected):
            return None
        return kept if _is_same(kept, last) else None

    def _decide(self, history: History, rate: float) -> Identity | Rejected:
        if history.search.found is not None:
            rate /= CHOICES  # as frequencies that were chosen to fit leave chance more ways to look like a codeword
        readings = [self._read_memory(memory, group, rate) for group, memory in enumerate(history.memories)]
        reading = decision.select_best(readings, rate)
        if isinstance(reading, Rejected):
            return reading
        ids = [r.id if isinstance(r, Reading) else None for r in readings]
        return Identity(group=ids.index(reading.id), reading=reading)

    def _read_memory(self, memory: PanelMemory, group: int, rate: float) -> Reading | Rejected:
        book = self._codebooks[group]
        book = book if memory.spec is book.spec else replace(book, spec=memory.spec)
        alone = self._read_newest(memory, book, rate)
        if alone is not None:
            return alone
        evidence = memory.evidence(self._weigher)
        if isinstance(evidence, Rejected):
            return evidence
        return decision.decide(evidence, book, rate)

    def _read_newest(self, memory: PanelMemory, book: Codebook, rate: float) -> Reading | Rejected | None:
        """The reading of the newest frame alone; None if all frames together must decide.

        A single frame of deep bands is decisive: it has a codeword, or it shows that something is wrong.
        """
        seen = memory.newest
        if memory.frames == 1:
            is_sought = is_faint(band_prior(seen.frame, book.spec))
            evidence = self._weigher.alone(seen, book.spec) if is_sought else None
            reading = UNFIT if evidence is None else decision.decide(evidence, book, rate)
            if isinstance(reading, Reading) or seen.samples is None:
                return reading
            return decision.read_codeword(seen.samples, seen.frame, book, rate)
        if seen.samples is None or not is_deep(band_prior(seen.frame, book.spec)):
            return None
        reading = decision.read_codeword(seen.samples, seen.frame, book, rate)
        if isinstance(reading, Reading):
            return reading._replace(cell_bands=memory.count_from_origin(reading.cell_bands))
        return reading if reading in NOT_THIS_PANEL else None

    def _search_frequencies_of(self, history: History, gated: bool) -> History | None:
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
            if gated and not confirms(memory.newest_evidence(self._weigher), reading.cell_bands):
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
    """Whether both are the same codeword in the same orientation."""
    return (one.reading.id, one.reading.quarter_turns) == (other.reading.id, other.reading.quarter_turns)


def _typical_nats(memory: PanelMemory, identity: Identity) -> float:
    """Mean log-likelihood ratio of the codeword to no bands that one frame has added."""
    return identity.reading.likelihood / memory.effective_frames


def _drop_newest(before: History, now: History) -> History:
    """The history without a frame that adds nothing, and that would spoil the evidence of the frames before it.

    It may have been located beside the panel, or the panel was occluded. After some such frames the old ones are out of
    date.
    """
    return before.skip_frame(now.search) if before.uninformative < ADDS_UP_FRAMES else now.keep_newest()


def _is_newest_tried_alone(history: History) -> bool:
    """Whether the newest frame is also read alone: while there are few, and now and then, as old ones may be wrong."""
    return history.frames > 1 and (history.frames <= TUNE_EVERY or history.frames % READ_EVERY == 0)
