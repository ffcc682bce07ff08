"""The last fix, for frames that leave the robot's pose open; and which panels of a map hang where it says.

A panel that hangs elsewhere makes a fix that nothing in a frame contradicts, if it is seen alone. Seen with another one
it contradicts that, and neither is a witness in its own case: a third one must be.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np

from ledpi.core.geometry import rotation_vector
from ledpi.core.records import MAX_GAP_NS, Floats, Rejected
from ledpi.pose.branches import EXCLUDED_BY, MAX_SPEED_M_S, MAX_TURN_RAD_S

AMBIGUOUS = Rejected(stage="fix", reason="ambiguous")
CONTRADICTION = Rejected(stage="fix", reason="panels_contradict")

NEAR = 22.5  # χ² of 6 that chance exceeds once in 1,000 times: what is further away is not where the robot went
MISPLACED = np.diag([0.5**2] * 6)  # covariance of how far off a panel is, m and rad, that was hung or measured wrong


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A pose that the robot may have."""

    map_from_base: Floats  # (4, 4)
    covariance: Floats  # (6, 6), of a position and a rotation about the map's axes
    used: tuple[int, ...]
    rejected: tuple[int, ...]


class FixHistory:
    """The last fix of one stream, and what its panels have said of one another."""

    def __init__(self) -> None:
        self._last: Candidate | None = None
        self._at_ns, self._believed = 0, False
        self._compared: set[tuple[int, ...]] = set()  # panels that the last fix has been compared with
        self._credibility = Credibility()

    def choose(self, candidates: list[Candidate], now_ns: int) -> Candidate | Rejected:
        """The only credible candidate, or the one that the last fix leads to and to no other; and remembers it."""
        last = self._last if abs(now_ns - self._at_ns) <= MAX_GAP_NS else None
        way = _way((now_ns - self._at_ns) * 1e-9)
        self._compare_panels(candidates)
        if last is not None:
            self._compare_with(last, way, candidates)
        credible = [c for c in candidates if self._credibility.is_credible(c.used, c.rejected)]
        chosen = credible[0] if len(credible) == 1 else None
        if last is not None and self._believed and len(credible) > 1:
            chosen = self._continuing(last, way, credible)
        if chosen is not None or len(candidates) == 1:  # one that is not believed is compared with what comes after it
            self._last, self._at_ns, self._believed = chosen or candidates[0], now_ns, chosen is not None
            self._compared = set()
        if chosen is None:
            return CONTRADICTION if not credible or credible[0].rejected else AMBIGUOUS
        return chosen

    def _compare_panels(self, candidates: list[Candidate]) -> None:
        """Those of one frame: they agree if all candidates use both, and do not if some use either and none both."""
        for one, other in combinations(sorted({*candidates[0].used, *candidates[0].rejected}), 2):
            of_both = [(one in c.used) + (other in c.used) for c in candidates]
            if min(of_both) == 2:
                self._credibility.compare(one, other, -EXCLUDED_BY)
            elif max(of_both) == 1:
                self._credibility.compare(one, other, EXCLUDED_BY)

    def _compare_with(self, last: Candidate, way: Floats, candidates: list[Candidate]) -> None:
        """Panels of the last fix with others that are alone now: a robot cannot leap from fix to fix.

        Where those leave two poses open, they contradict it if both do. Only their first look counts: at a later one
        the same leap seems to be a way that a robot might have come.
        """
        evidence: dict[tuple[int, ...], list[float]] = defaultdict(list)
        for candidate in candidates:
            if not {*last.used} & {*candidate.used, *candidate.rejected}:
                evidence[candidate.used].append(_against_continuing(last, way, candidate))
        for used, chi2 in evidence.items():
            if used not in self._compared and (len(chi2) == 1 or min(chi2) > 0.0):
                for one, other in product(last.used, used):
                    self._credibility.compare_by_way(one, other, min(chi2))
        self._compared |= set(evidence)

    def _continuing(self, last: Candidate, way: Floats, candidates: list[Candidate]) -> Candidate | None:
        """The one of several candidates that the last fix leads to, if it has not been contradicted by their panels.

        A fix by a panel for which none speaks leads to poses of that panel only: were it wrong, so would be the choice.
        """
        if any(self._credibility.are_opposed(last.used, c.used) for c in candidates):
            return None
        if not self._credibility.is_vouched(last.used) and not all({*last.used} & {*c.used} for c in candidates):
            return None
        grown = last.covariance + way
        ranked = sorted((distance2(last, c, grown + c.covariance), k) for k, c in enumerate(candidates))
        (nearest, k), (next_one, _) = ranked[:2]
        return candidates[k] if nearest < NEAR and next_one > nearest + EXCLUDED_BY else None


def _against_continuing(last: Candidate, way: Floats, candidate: Candidate) -> float:
    """Evidence, as χ², that a fix does not go on from the last one, as one of them is by panels that hang elsewhere.

    What chance exceeds once in 1,000 times is as much evidence as it is of panels that one frame shows.
    """
    covariance = last.covariance + candidate.covariance + way
    elsewhere = covariance + MISPLACED
    leap = distance2(last, candidate, covariance)
    if leap > NEAR:
        return EXCLUDED_BY
    chi2 = leap - distance2(last, candidate, elsewhere)
    return chi2 + float(np.linalg.slogdet(covariance)[1] - np.linalg.slogdet(elsewhere)[1])


def distance2(a: Candidate, b: Candidate, covariance: Floats) -> float:
    """Squared distance between two poses in deviations of `covariance` (6, 6): eᵀ·covariance⁻¹·e."""
    turn = rotation_vector(b.map_from_base[:3, :3] @ a.map_from_base[:3, :3].T)
    away = np.concatenate([b.map_from_base[:3, 3] - a.map_from_base[:3, 3], turn])
    return float(away @ np.linalg.solve(covariance, away))


def _way(elapsed_s: float) -> Floats:
    """Covariance of the way that the robot may have come."""
    return np.diag(np.square(np.array([MAX_SPEED_M_S] * 3 + [MAX_TURN_RAD_S] * 3) * elapsed_s))


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
