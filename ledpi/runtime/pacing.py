"""The budget of a frame's search, so that it takes about a frame period on the machine that it runs on."""

from __future__ import annotations

from dataclasses import dataclass

SHARE = 0.9  # of a frame period: the rest is for capture and publisher
# Budgets, in places at which the model is compared with the picture: what a candidate that is a panel takes, so that
# each has its turn at last; and what a picture full of texture can use.
MIN_BUDGET, MAX_BUDGET = 25_000, 1_000_000
MEMORY = 0.05  # weight of a new frame: speeds change as processors are throttled, within seconds


@dataclass(slots=True)
class Pacing:
    """Pacing of one daemon. The decoder counts its work in places; only here is it known how long these take."""

    period_ms: float
    unit_ms: float = 0.0003  # that a place takes, all else counted in: before the first frame, a PC's; a Pi's is 0.0015

    def budget_after(self, spent: int, took_ms: float) -> int:
        """For the next frame, after one that compared at so many places and took so long.

        One that compared at less than a candidate's has done little else but find; it tells the less of what a place
        takes.
        """
        if spent > 0:
            weight = MEMORY * min(spent / MIN_BUDGET, 1.0)
            self.unit_ms += weight * (took_ms / spent - self.unit_ms)
        return min(max(int(SHARE * self.period_ms / max(self.unit_ms, 1e-6)), MIN_BUDGET), MAX_BUDGET)
