"""Schedules a stream's candidates: a frame has a budget, and each place its turn."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ledpi.core.records import Floats, Integers, Mask
from ledpi.decode.proposals import Candidate

# A stream searches the whole picture for newcomers in every third frame, and in each that does not show all its panels.
SEARCH_EVERY = 3
SAME = 0.25  # of the side: candidates whose middles are no further apart, from frame to frame, are in one place
# A place is tried in so many searches, as the noise of one may hide a panel. After that it waits after each fit in vain
# for twice as many, so that what is no panel costs little; for so many at most, as a panel may have been covered.
TRIES, MAX_WAIT = 4, 8


class AgendaState(NamedTuple):
    """What an `Agenda` remembers."""

    since_search: int
    turn: int
    middles: Floats  # (N, 2)
    turns: Integers  # (N,)
    tries: Integers  # (N,)


class Agenda:
    """Of one stream. Call `is_due` once a frame, then `schedule`, then `tried` for each candidate that was fitted."""

    def __init__(self) -> None:
        self._since_search = SEARCH_EVERY
        self._turn = 0
        self._middles: Floats = np.empty((0, 2))  # of what was tried
        self._turns = np.empty(0, np.int64)  # when
        self._tries = np.empty(0, np.int64)  # how often

    def state(self) -> AgendaState:
        """What `resume` goes on from."""
        return AgendaState(self._since_search, self._turn, self._middles, self._turns, self._tries)

    def resume(self, state: AgendaState) -> None:
        """Goes on as the one that gave this state would."""
        self._since_search, self._turn, self._middles, self._turns, self._tries = state

    def is_due(self, *, all_detected: bool) -> bool:
        """Whether the picture is searched: it is time again, or a panel is not at its predicted place."""
        self._since_search += 1
        due = self._since_search >= SEARCH_EVERY or not all_detected
        if due:
            self._since_search = 0
            self._turn += 1
        return due

    def schedule(self, candidates: list[Candidate]) -> list[Candidate]:
        """Those due: the best, in alternation with those whose turn it is: new ones, then those tried long ago.

        `candidates` come best first. Places without a candidate are forgotten.
        """
        if not candidates:
            self._middles, self._turns, self._tries = self._middles[:0], self._turns[:0], self._tries[:0]
            return []
        near = self._near(candidates)
        last = np.where(near, self._turns, 0).max(axis=1, initial=0)
        tries = np.where(near, self._tries, 0).max(axis=1, initial=0)
        due = self._turn - last >= np.minimum(2 ** np.clip(tries - TRIES, 0, MAX_WAIT), MAX_WAIT)
        kept = near.any(axis=0)
        self._middles, self._turns, self._tries = self._middles[kept], self._turns[kept], self._tries[kept]
        best = np.flatnonzero(due)
        by_turn = best[np.argsort(last[best], kind="stable")]
        return [candidates[k] for k in dict.fromkeys(np.stack([best, by_turn], axis=1).ravel().tolist())]

    def tried(self, candidate: Candidate) -> None:
        """The candidate was fitted in this turn."""
        near = self._near([candidate])[0]
        self._middles = np.concatenate([self._middles[~near], candidate.corners_px.mean(axis=0)[None]])
        self._turns = np.append(self._turns[~near], self._turn)
        self._tries = np.append(self._tries[~near], 1 + self._tries[near].max(initial=0))

    def _near(self, candidates: list[Candidate]) -> Mask:
        """(candidates, N) which places are theirs."""
        middles = np.array([one.corners_px.mean(axis=0) for one in candidates])
        sides = np.array([one.side_px for one in candidates])
        return np.asarray(np.hypot(*(middles[:, None] - self._middles).transpose(2, 0, 1)) < SAME * sides[:, None])
