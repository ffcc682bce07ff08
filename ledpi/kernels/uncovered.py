"""Whether something stands before a panel's cells (uncovered.c)."""

from __future__ import annotations

import numpy as np

from ledpi.kernels.library import at, lib
from ledpi.records import Mask, Singles


def all_uncovered(light: Singles, valid: Mask | None, least: Singles) -> bool:
    """Whether samples (cells, points) show the share `least` (cells, points) of what cells show there on average.

    Each cell's light is over its own mean, and covered by nothing else; `valid` (cells, points) unless that is None.
    """
    room = np.empty(sum(light.shape), np.float32)
    found: bool = lib.ledpi_all_uncovered(*light.shape, at(light), at(valid), at(least), at(room))
    return found
