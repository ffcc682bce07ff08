"""The clock of a controller, learned from questions and answers. Pure.

Each answer bounds how far the controller's clock is ahead: its stamp of arrival is later than our question left, its
stamp of leaving earlier than the answer came. Bounds widen as fast as two crystals can part; the middle of what all
answers leave is the estimate. So the quickest answer of late says most, and a delayed one nothing wrong.
"""

from __future__ import annotations

from dataclasses import dataclass

from ledpi.core.records import Rejected
from ledpi.state.estimator import EARLY_NS, KEPT_NS

UNKNOWN = Rejected(stage="clock", reason="unknown")
JUMPED = Rejected(stage="clock", reason="jumped")

PARTING_PPM = 200  # of two crystals
VAGUE_NS = 50_000_000  # a clock that is known no better, as no answer came for two minutes, is not known
# Bytes that are quicker than the baud rate says (a board that is itself the USB device) shift a bound by less; what is
# further off is another clock.
SLACK_NS = 5_000_000
REPEATED = 3  # that contradict in turn are a clock that was set anew, and not one bad message
WRAP_US = 1 << 32


@dataclass(frozen=True, slots=True, kw_only=True)
class Trip:
    """A question and its answer. Ours are of CLOCK_MONOTONIC, less what the bytes take on the line."""

    asked_ns: int  # as the question's last byte was through
    arrived_us: int  # the controller's 32 bits
    left_us: int
    answered_ns: int  # as the answer's first byte left


class ControllerClock:
    """Bounds of how far the controller's clock is ahead of ours."""

    def __init__(self) -> None:
        self._bounds: tuple[int, int] | None = None  # ns ahead, at `_at_ns`
        self._at_ns = 0
        self._contradicting = 0

    def add(self, trip: Trip) -> Rejected | None:
        """Takes an answer; JUMPED where it contradicts the others. Three in turn that do begin anew."""
        bounds = self._bounds_at(trip.answered_ns)
        at_most = _unwrapped(trip.arrived_us, trip.asked_ns + sum(bounds or (0,)) // 2) - trip.asked_ns
        at_least = _unwrapped(trip.left_us, trip.answered_ns + at_most) - trip.answered_ns
        low, high = bounds or (at_least, at_most)
        if at_least > min(high, at_most) + SLACK_NS or at_most < low - SLACK_NS:
            return self._contradict()
        self._bounds, self._at_ns = (max(low, at_least), min(high, at_most)), trip.answered_ns
        self._contradicting = 0
        return None

    def to_ns(self, clock_us: int, now_ns: int) -> int | Rejected:
        """Our time of one of the controller's; JUMPED where that is not of the last seconds."""
        bounds = self._bounds_at(now_ns)
        if bounds is None:
            return UNKNOWN
        ahead_ns = sum(bounds) // 2
        t_ns = _unwrapped(clock_us, now_ns + ahead_ns) - ahead_ns
        return t_ns if now_ns - KEPT_NS <= t_ns <= now_ns + EARLY_NS else self._contradict()

    def to_us(self, t_ns: int) -> int | None:
        """The controller's 32 bits at one of our times, of lately; None: not known."""
        bounds = self._bounds_at(t_ns)
        return None if bounds is None else (t_ns + sum(bounds) // 2) // 1000 % WRAP_US

    def _bounds_at(self, t_ns: int) -> tuple[int, int] | None:
        """None where it is not known, or no longer."""
        if self._bounds is None:
            return None
        parted_ns = abs(t_ns - self._at_ns) * PARTING_PPM // 1_000_000
        low, high = self._bounds[0] - parted_ns, self._bounds[1] + parted_ns
        return (low, high) if high - low <= VAGUE_NS else None

    def _contradict(self) -> Rejected:
        self._contradicting += 1
        if self._contradicting >= REPEATED:
            self._bounds, self._contradicting = None, 0
        return JUMPED


def _unwrapped(clock_us: int, near_ns: int) -> int:
    """The controller's time in ns, of all that have these 32 bits the one nearest to another."""
    step_us = (clock_us - near_ns // 1000 + WRAP_US // 2) % WRAP_US - WRAP_US // 2
    return (near_ns // 1000 + step_us) * 1000
