"""Markers drawn over the picture that they were read in."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from ledpi.api.exposed import Panels
from ledpi.api.marker import Marker
from ledpi.config.panels import PanelSettings
from ledpi.core.records import Pixels
from ledpi.diagnosis.drawn_markers import DIMMED, Placed, draw_markers
from ledpi.markers.dictionaries import load_dictionary


def drawn(panels: Panels, picture: Pixels, markers: Sequence[Marker]) -> Pixels:
    """(height, width, 3), blue, green, red, as OpenCV shows and writes it: cells, outline, axes and ID of each."""
    settings, lens = _settings(panels), panels.lens_for(picture)
    words = load_dictionary(settings.dictionary)
    canvas = np.repeat((picture * DIMMED).astype(np.uint8)[..., None], 3, axis=2)
    placed = [
        Placed(
            marker_id=marker.id,
            corners_px=marker.corners_px,
            word=words.codeword(marker.id),
            side_m=settings.spec(marker.id).side_m,
            position_m=marker.position_m,
            quaternion_wxyz=marker.quaternion_wxyz,
        )
        for marker in markers
    ]
    draw_markers(canvas, placed, lens)
    return canvas


@lru_cache(maxsize=8)
def _settings(panels: Panels) -> PanelSettings:
    """Kept, as making them takes longer than the drawing."""
    return panels.config().panels
