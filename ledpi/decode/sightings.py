"""Which of a frame's sightings can all be true: a panel is in one place, and shows one ID."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from ledpi.records import Floats, Rejected, Sighting

SAME_PLACE = Rejected(stage="identify", reason="same_panel_twice")
SAME_ID = Rejected(stage="identify", reason="same_id_twice")


def one_of_each(sightings: Iterable[Sighting]) -> tuple[list[Sighting], list[tuple[Sighting, Rejected]]]:
    """The surest sighting of each panel, and what was dropped. An ID that is in two places at once is in neither."""
    kept: list[Sighting] = []
    dropped: list[tuple[Sighting, Rejected]] = []
    for sighting in sorted(sightings, key=lambda s: -s.margin):
        centre = sighting.corners_px.mean(axis=0)
        if any(_inside(centre, other.corners_px) for other in kept):
            dropped.append((sighting, SAME_PLACE))
        else:
            kept.append(sighting)
    ids = [s.id for s in kept]
    dropped += [(s, SAME_ID) for s in kept if ids.count(s.id) > 1]
    return [s for s in kept if ids.count(s.id) == 1], dropped


def _inside(point: Floats, corners: Floats) -> bool:
    """Whether a point lies within a convex quad, clockwise in the picture."""
    along = np.roll(corners, -1, axis=0) - corners
    to = point - corners
    return bool((along[:, 0] * to[:, 1] - along[:, 1] * to[:, 0] > 0).all())
