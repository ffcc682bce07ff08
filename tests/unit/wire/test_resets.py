"""Numbers by which a receiver knows that fixes of before and after do not belong together."""

from __future__ import annotations

import numpy as np
import pytest

from ledpi.core.records import MapPanel, PanelMap
from ledpi.wire.mavlink import Resets


def panels(**x_m: float) -> PanelMap:
    """By `p` and ID: where each is along x."""
    return {int(name[1:]): MapPanel(map_from_marker=place(x)) for name, x in x_m.items()}


def place(x_m: float) -> np.ndarray:
    matrix = np.eye(4)
    matrix[0, 3] = x_m
    return matrix


@pytest.mark.parametrize(
    ("now", "maps"),
    [
        (panels(p7=1.0, p9=2.0), 0),
        (panels(p7=1.0), 0),
        (panels(p7=1.0, p8=5.0), 0),
        (panels(p7=1.1, p9=2.0), 1),
        (panels(p8=1.0), 1),
        (None, 0),
    ],
    ids=["the same", "one less", "another one beside", "one that has moved", "others", "none"],
)
def test_a_map_is_another_one_where_panels_are_elsewhere(now: PanelMap | None, maps: int) -> None:
    """One that was surveyed further is still the same frame; of two without a common panel nobody knows."""
    resets = Resets()
    for seen in (panels(p7=1.0, p9=2.0), now):
        resets.update_map(seen)
    assert resets.maps == maps


def test_a_time_without_a_map_hides_no_change() -> None:
    """Counts against the map before."""
    resets = Resets()
    for seen in (panels(p7=1.0), None, panels(p7=2.0), panels(p7=2.0)):
        resets.update_map(seen)
    assert resets.maps == 1
