"""The publisher's counts, and the state of its port."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class PublisherCounters:
    """Since the publisher was made. Packets written, poses that were not, and the port's state."""

    fixes: int
    statuses: int
    markers: int
    states: int = 0
    asks: int = 0  # for the controller's clock
    replaced: int  # by a newer pose before there was room on the line
    stale: int  # older than max_age_ms when their turn came
    refused: int  # not fit to be sent: out of range, or from the future
    cut: int  # packets that the port took only in part
    opened: int  # times the port was opened
    port: str | None  # None: there is none, and poses go to the tap alone
    connected: bool
    error: str | None  # why the port is not open, or was last lost

    @property
    def sent(self) -> int:
        """Packets of all kinds."""
        return self.fixes + self.statuses + self.markers + self.states + self.asks

    @property
    def unsent(self) -> int:
        """Poses that never reached the line."""
        return self.replaced + self.stale + self.refused
