"""How much a frame may search, so that it takes about a frame period on the machine that it runs on."""

from __future__ import annotations

from dataclasses import dataclass

SHARE = 0.8  # of a frame period: the rest is for what is followed, and for capture and publisher
# Budgets: two candidates, so that each place has its turn at last; and what a picture full of texture can use.
LEAST, MOST = 6, 200
MEMORY = 0.05  # weight of a new frame: speeds change as processors are throttled, within seconds


@dataclass(slots=True)
class Pacing:
    """Of one daemon. The decoder counts its work in fits; only here is it known how long these take."""

    period_ms: float
    unit_ms: float = 1.0  # that a fit on a coarse grid takes, all else counted in: before the first frame, a PC's

    def budget_after(self, spent: int, took_ms: float) -> int:
        """For the next frame, after one that `spent` so many fits and took so long."""
        if spent > 0:
            self.unit_ms += MEMORY * (took_ms / spent - self.unit_ms)
        return min(max(int(SHARE * self.period_ms / max(self.unit_ms, 1e-3)), LEAST), MOST)
