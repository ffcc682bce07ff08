"""Schedules a stream's candidates: a frame has a budget, and each place its turn."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ledpi.core.records import Floats, Integers
from ledpi.decode.proposals import Candidate

# A stream searches the whole picture for newcomers in every third frame, and sooner where a panel is missing: after one
# frame, then two, then three, if searches are in vain, as each delays the panels that are there. In a frame that shows
# none it delays nothing.
SEARCH_EVERY = 3
SAME = 0.25  # of the side: candidates whose middles are no further apart, from frame to frame, are in one place

# That a frame by itself tries where nothing likely is a panel, as the glance's template is not all panels'.
UNLIKELY = 2


def alone(candidates: list[Candidate]) -> list[Candidate]:
    """The order in which a frame by itself tries them: those that are likely, then the best of the others.

    The likeliest first, as what lies on a panel that was read is not fitted; but the largest where bands are deep, as a
    glance sees there how far their light changes, not where a panel ends.
    """
    by_evidence = sorted(candidates, key=lambda one: -one.evidence)
    likely = [one for one in (candidates if any(one.dark_rows for one in candidates) else by_evidence) if one.likely]
    return likely + [one for one in by_evidence if not one.likely][:UNLIKELY]


@dataclass(slots=True, eq=False)
class Agenda:
    """One stream's agenda. Call `is_due` once a frame, then `schedule`, then `tried` for each that was fitted."""

    since_search: int = SEARCH_EVERY
    in_vain: int = 0  # searches for panels that are missing, one after the other
    turn: int = 0
    middles: Floats = field(default_factory=lambda: np.empty((0, 2)))  # of what was tried, (N, 2)
    turns: Integers = field(default_factory=lambda: np.empty(0, np.int64))  # when, (N,)

    @property
    def is_due_next(self) -> bool:
        """Tells whether the picture is searched next, whatever it shows."""
        return self.since_search + 1 >= SEARCH_EVERY

    def is_due(self, panels_shown: Sequence[bool]) -> bool:
        """Tell whether the picture is searched, by which of the known panels it has shown where expected."""
        self.since_search += 1
        missing = not panels_shown or not all(panels_shown)
        wait = min(1 + self.in_vain, SEARCH_EVERY) if any(panels_shown) else 1
        if not missing:
            self.in_vain, wait = 0, SEARCH_EVERY
        due = self.since_search >= wait
        if due:
            self.in_vain += missing
            self.since_search = 0
            self.turn += 1
        return due

    def schedule(self, candidates: list[Candidate]) -> list[Candidate]:
        """Those whose turn it is and the likeliest, in alternation: new places, then those tried longest ago.

        `candidates` come as a frame by itself would try them; of those that are not likely one has its turn. Places
        without a candidate are forgotten.
        """
        if not candidates:
            self.middles, self.turns = self.middles[:0], self.turns[:0]
            return []
        middles = np.array([one.corners_px.mean(axis=0) for one in candidates])
        sides = np.array([one.side_px for one in candidates])
        last = np.zeros(len(candidates), np.int64)
        if len(self.turns):
            near = np.hypot(*(middles[:, None] - self.middles).transpose(2, 0, 1)) < SAME * sides[:, None]
            last = np.where(near, self.turns, 0).max(axis=1)
            kept = near.any(axis=0)
            self.middles, self.turns = self.middles[kept], self.turns[kept]
        by_turn = np.argsort(last, kind="stable").tolist()
        likely = [k for k, one in enumerate(candidates) if one.likely]
        by_turn = [k for k in by_turn if candidates[k].likely], [k for k in by_turn if not candidates[k].likely]
        both = [k for pair in zip(by_turn[0], likely, strict=True) for k in pair] + by_turn[1][:1]
        return [candidates[k] for k in dict.fromkeys(both)]

    def tried(self, candidate: Candidate) -> None:
        """The candidate was fitted in this turn."""
        self.middles = np.concatenate([self.middles, candidate.corners_px.mean(axis=0)[None]])
        self.turns = np.append(self.turns, self.turn)
