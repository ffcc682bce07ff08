"""Non-maximum suppression: a panel is in one place, and an ID is on one panel."""

from __future__ import annotations

from collections.abc import Iterable

from ledpi.core.geometry import quad_middle
from ledpi.core.records import Detection, Rejected

SAME_PLACE = Rejected(stage="suppression", reason="same_panel")
SAME_ID = Rejected(stage="suppression", reason="same_id")


def suppress_duplicates(detections: Iterable[Detection]) -> tuple[list[Detection], list[tuple[Detection, Rejected]]]:
    """The best detection of each panel, and what was dropped. An ID in two places at once is dropped in both."""
    kept: list[Detection] = []
    places: list[list[list[float]]] = []  # of those
    dropped: list[tuple[Detection, Rejected]] = []
    for detection in sorted(detections, key=lambda s: -s.margin):
        corners = detection.corners_px.tolist()
        x, y = quad_middle(corners)
        if any(_inside(x, y, other) for other in places):
            dropped.append((detection, SAME_PLACE))
        else:
            kept.append(detection)
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
