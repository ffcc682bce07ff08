"""Something dark before a corner or an edge of a panel: what it covers says nothing of the bands."""

from __future__ import annotations

import numpy as np
import pytest

from ledpi.core.dictionaries import load_dictionary
from ledpi.core.records import Floats
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.identify.decision import Reading
from ledpi.pipeline.pipeline import Pipeline
from tests.builders.decode import PINHOLE, SPEC, Canvas, camera_info, panel_settings, square, word
from tests.builders.samples import read_at

TRUE = square(310.4, 240.2, 100.0, 12)
CORNER, EDGE = ((-0.1, 0.1), (-0.1, 0.12)), ((-0.2, 1.2), (-0.3, 0.12))  # what is hidden, across and down


def before_the_panel(u: tuple[float, float], v: tuple[float, float]) -> Floats:
    """The corners in the picture of what reaches from u to u across the panel, and from v to v down it."""
    unit = np.array([[u[0], v[0]], [u[1], v[0]], [u[1], v[1]], [u[0], v[1]]])
    return TRUE[0] + unit @ np.array([TRUE[1] - TRUE[0], TRUE[3] - TRUE[0]])


@pytest.mark.parametrize("shade", [CORNER, EDGE], ids=["corner", "edge"])
def test_a_single_frame_is_read_although_a_corner_or_an_edge_is_covered(
    shade: tuple[tuple[float, float], tuple[float, float]],
) -> None:
    """The corners are known here; the panel's ID is all that is asked."""
    canvas = Canvas()
    canvas.panel(TRUE, word(7))
    canvas.lamp(before_the_panel(*shade), 0.0)
    book = Codebook.build(list(range(50)), load_dictionary("DICT_4X4_50"), SPEC)
    reading = read_at(canvas.frame(), TRUE, book)
    assert isinstance(reading, Reading), reading
    assert reading.id == 7


@pytest.mark.parametrize(
    ("shade", "exposure_us"),
    [(CORNER, 560.0), (CORNER, 640.0), (CORNER, 1000.0), (EDGE, 500.0), (EDGE, 640.0), (EDGE, 1000.0)],
)
def test_what_is_covered_is_reported_from_bands_that_are_as_dark(
    shade: tuple[tuple[float, float], tuple[float, float]], exposure_us: float
) -> None:
    """By what the panel's whole picture shows of these. Corners are found, too."""
    canvas = Canvas(exposure_us=exposure_us)
    canvas.panel(TRUE, word(7), light=0.3, phases=(0.3, 0.7))
    canvas.lamp(before_the_panel(*shade), 0.0)
    path = Pipeline(camera_info(exposure_us=exposure_us), panel_settings(), intrinsics=PINHOLE, stream=False)
    (marker,) = path.decode(canvas.frame()).markers
    assert marker.detection.id == 7
    assert np.abs(marker.detection.corners_px - TRUE).max() < 0.7


@pytest.mark.parametrize("exposure_us", [130.0, 200.0, 300.0, 450.0])
@pytest.mark.parametrize("side", range(4))
def test_a_panel_with_a_hidden_side_is_read_in_deep_bands(side: int, exposure_us: float) -> None:
    """Something dark before 12 % of any of them: the fit of the whole picture says where, and it is left out."""
    canvas = Canvas(exposure_us=exposure_us)
    canvas.panel(TRUE, word(7), light=0.3, phases=(0.3, 0.7))
    ends = [(-0.2, 1.2), (-0.2, 1.2)]
    ends[1 - side % 2] = [(-0.12, 0.12), (0.88, 1.12), (0.88, 1.12), (-0.12, 0.12)][side]
    canvas.lamp(before_the_panel(*ends), 0.0)
    path = Pipeline(camera_info(exposure_us=exposure_us), panel_settings(), intrinsics=PINHOLE, stream=False)
    (marker,) = path.decode(canvas.frame()).markers
    assert marker.detection.id == 7
    assert np.abs(marker.detection.corners_px - TRUE).max() < 0.8
