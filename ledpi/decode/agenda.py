"""Schedules a stream's candidates: a frame has a budget, and each place its turn."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ledpi.core.geometry import quad_middle, quad_side
from ledpi.core.records import Floats, Integers
from ledpi.decode.proposals import Candidate

# A stream searches the whole picture for newcomers in every third frame, and sooner where a panel is missing: after one
# frame, then two, then three, if searches are in vain, as each delays the panels that are there. In a frame that shows
# none it delays nothing.
SEARCH_EVERY = 3
SAME = 0.25  # of the side: what is no further off from frame to frame, and no larger or smaller, is in one place
# A place where there was nothing waits for 1, 2, 4 … 32 searches: for three seconds where a panel is followed.
MOST_REFUSED = 6
LONGEST = 2 ** (MOST_REFUSED - 1)

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


@dataclass(slots=True)
class _Place:
    """A place in the picture, and what was tried there."""

    x: float
    y: float
    side_px: float
    turn: int  # in which it was tried last
    seen: int  # in which there was a candidate last
    refused: int = 0  # how often, one time after the other
    until: int = 0  # the turn before which it waits


@dataclass(slots=True, eq=False)
class Agenda:
    """One stream's agenda. Call `is_due` once a frame, then `schedule`, then `tried` for each that was fitted."""

    since_search: int = SEARCH_EVERY
    in_vain: int = 0  # searches for panels that are missing, one after the other
    turn: int = 0
    places: list[_Place] = field(default_factory=list)

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

    def search_next(self) -> None:
        """Has the next frame searched, too."""
        self.since_search = SEARCH_EVERY

    def schedule(self, candidates: list[Candidate], *, is_urgent: bool) -> list[Candidate]:
        """Those whose turn it is: new places, the largest first, as texture's are small; then those tried longest ago.

        `candidates` come with the largest first; of those that are not likely one has its turn. Who was refused waits:
        where it is `is_urgent`, as no panel is followed, until after the others.
        """
        self.places = [place for place in self.places if self.turn - place.seen <= LONGEST]
        if not candidates:
            return []
        last, until = self._turns(candidates)
        due = [k for k in np.argsort(last, kind="stable").tolist() if until[k] <= self.turn]
        order = [k for k in due if candidates[k].likely] + [k for k in due if not candidates[k].likely][:1]
        if is_urgent:
            waiting = [k for k in np.argsort(until, kind="stable").tolist() if until[k] > self.turn]
            order += [k for k in waiting if candidates[k].likely]
        return [candidates[k] for k in order]

    def tried(self, candidate: Candidate, *, in_vain: bool) -> None:
        """The candidate had its turn; `in_vain`: there is no square."""
        place = self._place_of(candidate.corners_px)
        place.turn = self.turn
        place.refused = min(place.refused + 1, MOST_REFUSED) if in_vain else 0
        place.until = self.turn + 2 ** (place.refused - 1) if in_vain else 0

    def refuse(self, corners_px: Floats) -> None:
        """Surely no panel is there: its place waits as long as any."""
        place = self._place_of(corners_px)
        place.refused, place.until = MOST_REFUSED, self.turn + LONGEST

    def _turns(self, candidates: list[Candidate]) -> tuple[Integers, Integers]:
        """(candidates,) in which turn their places were tried last, and until which they wait; these move with them."""
        if not self.places:
            return np.zeros(len(candidates), np.int64), np.zeros(len(candidates), np.int64)
        middles = np.array([one.corners_px for one in candidates]).mean(axis=1)
        sides = np.array([[one.side_px] for one in candidates])
        x, y, own = np.array([(place.x, place.y, place.side_px) for place in self.places]).T
        apart = np.maximum(np.hypot(middles[:, :1] - x, middles[:, 1:] - y), np.abs(sides - own)) / sides
        for place, least, nearest in zip(self.places, apart.min(axis=0), apart.argmin(axis=0), strict=True):
            if least < SAME:
                (place.x, place.y), place.side_px, place.seen = middles[nearest].tolist(), sides[nearest, 0], self.turn
        last, until = (
            np.where(apart < SAME, numbers, 0).max(axis=1)
            for numbers in zip(*((place.turn, place.until) for place in self.places), strict=True)
        )
        return last, until

    def _place_of(self, corners_px: Floats) -> _Place:
        """The nearest place, or a new one."""
        corners = corners_px.tolist()
        (x, y), side = quad_middle(corners), quad_side(corners)
        apart = [(max(math.hypot(at.x - x, at.y - y), abs(at.side_px - side)), k) for k, at in enumerate(self.places)]
        if not apart or not min(apart)[0] < SAME * side:
            self.places.append(_Place(x, y, side, self.turn, self.turn))
            return self.places[-1]
        return self.places[min(apart)[1]]
