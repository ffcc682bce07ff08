"""Which of a frame's sightings can all be true: a panel is in one place, and shows one ID."""

from __future__ import annotations

from collections.abc import Iterable

from ledpi.core.geometry import quad_middle
from ledpi.core.records import Rejected, Sighting

SAME_PLACE = Rejected(stage="identify", reason="same_panel_twice")
SAME_ID = Rejected(stage="identify", reason="same_id_twice")


def one_of_each(sightings: Iterable[Sighting]) -> tuple[list[Sighting], list[tuple[Sighting, Rejected]]]:
    """The surest sighting of each panel, and what was dropped. An ID that is in two places at once is in neither."""
    kept: list[Sighting] = []
    places: list[list[list[float]]] = []  # of those
    dropped: list[tuple[Sighting, Rejected]] = []
    for sighting in sorted(sightings, key=lambda s: -s.margin):
        corners = sighting.corners_px.tolist()
        x, y = quad_middle(corners)
        if any(_inside(x, y, other) for other in places):
            dropped.append((sighting, SAME_PLACE))
        else:
            kept.append(sighting)
            places.append(corners)
    ids = [s.id for s in kept]
    dropped += [(s, SAME_ID) for s in kept if ids.count(s.id) > 1]
    return [s for s in kept if ids.count(s.id) == 1], dropped


def _inside(x: float, y: float, corners: list[list[float]]) -> bool:
    """Whether a point lies within a convex quad, clockwise in the picture."""
    x0, y0 = corners[-1]
    for x1, y1 in corners:
        if not (x1 - x0) * (y - y0) - (y1 - y0) * (x - x0) > 0:
            return False
        x0, y0 = x1, y1
    return True
