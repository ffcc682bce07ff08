"""Counts of jumps of the fix since the process began. A reload makes all else anew, and this stays."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ledpi.pose.panel_map import PanelMap


@dataclass
class Resets:
    """Numbers by which a receiver tells fixes that do not belong together. Not thread-safe: one thread writes each."""

    jumps: int = 0  # of a fix, further than a robot can have gone
    maps: int = 0  # other maps after the first
    _panels: PanelMap | None = None  # of the newest map

    def update_map(self, panels: PanelMap | None) -> None:
        """From now on fixes are in this map."""
        if panels is None:
            return
        if self._panels is not None and not _same_frame(self._panels, panels):
            self.maps += 1
        self._panels = panels


def _same_frame(before: PanelMap, now: PanelMap) -> bool:
    """Tells whether the panels that both maps hold are where they were; there must be one."""
    common = before.keys() & now.keys()
    return bool(common) and all(np.array_equal(before[i].map_from_marker, now[i].map_from_marker) for i in common)
