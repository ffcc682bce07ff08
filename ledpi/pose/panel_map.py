"""The places of panels: what a map holds, once it is read. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from ledpi.core.records import Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MapPanel:
    """A panel's place, and how well that is known."""

    map_from_marker: Floats  # (4, 4)
    side_m: float | None = None  # None: as the configuration says
    position_sigma_m: float = 0.0  # along each axis
    angle_sigma_rad: float = 0.0  # about each axis


PanelMap = Mapping[int, MapPanel]  # by ID
