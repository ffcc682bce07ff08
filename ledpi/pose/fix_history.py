"""The last fix, and what it says where a frame leaves the robot's pose open."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ledpi.core.geometry import rotation_vector
from ledpi.core.records import MAX_GAP_NS, Floats
from ledpi.pose.branches import EXCLUDED_BY
from ledpi.pose.motion import MAX_SPEED_M_S, MAX_TURN_RAD_S

NEAR = 22.5  # χ² of 6 that chance exceeds once in 1,000 times: what is further away is not where the robot went


@dataclass(frozen=True, slots=True, eq=False)
class Candidate:
    """A pose that the robot may have."""

    map_from_base: Floats  # (4, 4)
    covariance: Floats  # (6, 6), of a position and a rotation about the map's axes
    used: tuple[int, ...]
    rejected: tuple[int, ...]


class FixHistory:
    """The last fix of one stream."""

    def __init__(self) -> None:
        self._last: Candidate | None = None
        self._at_ns = 0

    def remember(self, fix: Candidate, now_ns: int) -> None:
        """The fix at `now_ns` of the camera's clock is the last one."""
        self._last, self._at_ns = fix, now_ns

    def choose(self, candidates: list[Candidate], now_ns: int) -> Candidate | None:
        """The only candidate, or the one that the last fix leads to and to no other; else None."""
        if len(candidates) == 1:
            return candidates[0]
        elapsed_s = (now_ns - self._at_ns) * 1e-9
        if self._last is None or not candidates or abs(elapsed_s) > MAX_GAP_NS * 1e-9:
            return None
        last = self._last
        grown = last.covariance + _way(elapsed_s)
        ranked = sorted((distance2(last, c, grown + c.covariance), k) for k, c in enumerate(candidates))
        (nearest, k), (next_one, _) = ranked[:2]
        return candidates[k] if nearest < NEAR and next_one > nearest + EXCLUDED_BY else None


def distance2(a: Candidate, b: Candidate, covariance: Floats) -> float:
    """Squared distance between two poses in deviations of `covariance` (6, 6): eᵀ·covariance⁻¹·e."""
    turn = rotation_vector(b.map_from_base[:3, :3] @ a.map_from_base[:3, :3].T)
    away = np.concatenate([b.map_from_base[:3, 3] - a.map_from_base[:3, 3], turn])
    return float(away @ np.linalg.solve(covariance, away))


def _way(elapsed_s: float) -> Floats:
    """Covariance of the way that the robot may have come."""
    return np.diag(np.square(np.array([MAX_SPEED_M_S] * 3 + [MAX_TURN_RAD_S] * 3) * elapsed_s))
