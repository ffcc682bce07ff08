"""Which panels of a map hang where it says, by what they have said of one another.

A panel that hangs elsewhere makes a fix that nothing in a frame contradicts, if it is seen alone. Seen with another one
it contradicts that, and neither is a witness in its own case: a third one must be.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable

from ledpi.pose.branches import EXCLUDED_BY

# Log odds, as χ², that one of two panels hangs elsewhere. By its map both hang right, a thousand to one; and one look
# at both says as much for or against it, as they are compared by what chance exceeds once in 1,000 times.
PRIOR = -EXCLUDED_BY
MOST = 5 * EXCLUDED_BY  # either way: a panel that is hung right again is believed after so many looks


class Credibility:
    """The map's panels in one stream."""

    def __init__(self) -> None:
        self._odds: dict[int, dict[int, float]] = defaultdict(dict)  # by panel and other panel, as χ²

    def compare(self, one: int, other: int, chi2: float) -> None:
        """Counts evidence that two panels do not both hang right: χ² of their agreeing, less that of their not."""
        odds = max(-MOST, min(MOST, self._odds[one].get(other, PRIOR) + max(-EXCLUDED_BY, min(EXCLUDED_BY, chi2))))
        self._odds[one][other] = self._odds[other][one] = odds

    def compare_by_way(self, one: int, other: int, chi2: float) -> None:
        """Counts such evidence where the two were not seen at once: it accuses and acquits, but speaks for no panel.

        The way that a robot may have come meanwhile hides an error that is many of a fix's deviations.
        """
        least = min(PRIOR, self._odds[one].get(other, PRIOR))
        self.compare(one, other, max(chi2, least - self._odds[one].get(other, PRIOR)))

    def is_vouched(self, panels: Iterable[int]) -> bool:
        """Tells whether others speak for one of these panels, more than speak against it."""
        return any(self._standing(panel) > 0 for panel in panels)

    def is_credible(self, used: Iterable[int], rejected: Iterable[int]) -> bool:
        """Tells whether a fix by the panels `used` may be believed, if this frame's `rejected` contradict it.

        More panels must speak for each of them than for those that contradict it, less those that speak against it. If
        more than one panel must hang elsewhere to explain all that was seen, to have been accused by fewer is no merit:
        then some panel must speak for it.
        """
        return all(
            self._standing(u) > self._standing(r) and (self._speakers(u) > 0 or self._explains_all(r))
            for u in used
            for r in self._opponents(u, rejected)
        )

    def are_opposed(self, some: Iterable[int], others: Iterable[int]) -> bool:
        """Tells whether one of `some` has contradicted one of `others`."""
        return any(self._odds[s].get(o, PRIOR) >= 0.0 for s in some for o in others)

    def _opponents(self, panel: int, rejected: Iterable[int]) -> set[int]:
        """Panels that contradict this one: now, unless they have agreed before, or earlier."""
        odds = self._odds[panel]
        now = {r for r in rejected if not _speaks_for(odds.get(r, PRIOR))}
        return now | {other for other, value in odds.items() if value >= 0.0}

    def _speakers(self, panel: int) -> int:
        return sum(map(_speaks_for, self._odds[panel].values()))

    def _explains_all(self, panel: int) -> bool:
        """Tells whether no two other panels contradict each other."""
        return not any(
            value >= 0.0
            for one, odds in self._odds.items()
            for other, value in odds.items()
            if panel not in (one, other)
        )

    def _standing(self, panel: int) -> int:
        return self._speakers(panel) - sum(value >= 0.0 for value in self._odds[panel].values())


def _speaks_for(odds: float) -> bool:
    return odds <= PRIOR - EXCLUDED_BY
