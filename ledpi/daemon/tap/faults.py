"""The log's newest warnings, for people who look at the daemon and have no journal at hand."""

from __future__ import annotations

import logging
import time
from collections import deque
from typing import Any

from ledpi.core.wording import one_line

FAULTS = 20
MOST_SAID = 300  # characters of one of them


class Faults(logging.Handler):
    """Keeps them from its making to `close`."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self._kept: deque[dict[str, Any]] = deque(maxlen=FAULTS)
        logging.getLogger("ledpi").addHandler(self)

    def emit(self, record: logging.LogRecord) -> None:
        """With the time on CLOCK_MONOTONIC, as all times of the tap are."""
        self._kept.append({"at_ns": time.monotonic_ns(), "text": one_line(record.getMessage())[:MOST_SAID]})

    def kept(self) -> list[dict[str, Any]]:
        """Oldest first: {"at_ns", "text"}."""
        return list(self._kept)

    def close(self) -> None:
        """Hears no more."""
        logging.getLogger("ledpi").removeHandler(self)
        super().close()
