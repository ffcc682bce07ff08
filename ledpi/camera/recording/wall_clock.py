"""The time of day, which recordings note for who reads them later. Nothing on the frame path computes with it."""

from __future__ import annotations

import time

from ledpi.core.records import Frame


def unix_offset_ns(frame: Frame) -> int:
    """Returns what to add to the frame's clock to get Unix time, as this machine's clocks stand now."""
    return time.time_ns() - time.monotonic_ns() + frame.host_offset_ns
