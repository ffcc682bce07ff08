"""Non-maximum suppression: a panel is in one place, and an ID is on one panel."""

from __future__ import annotations

from collections.abc import Iterable

import cv2
import numpy as np

from ledpi.core.records import Detection, Rejected

SAME_PLACE = Rejected(stage="suppression", reason="same_panel")
SAME_ID = Rejected(stage="suppression", reason="same_id")


def suppress_duplicates(detections: Iterable[Detection]) -> list[tuple[Detection, Rejected]]:
    """Suppresses what is not the best detection of its panel, and an ID that is in several places: in all of them."""
    kept: list[Detection] = []
    dropped: list[tuple[Detection, Rejected]] = []
    for detection in sorted(detections, key=lambda s: -s.margin):
        middle = detection.corners_px.mean(axis=0)
        if any(cv2.pointPolygonTest(other.corners_px.astype(np.float32), middle, False) > 0 for other in kept):
            dropped.append((detection, SAME_PLACE))
        else:
            kept.append(detection)
    ids = [s.id for s in kept]
    dropped += [(s, SAME_ID) for s in kept if ids.count(s.id) > 1]
    return dropped
