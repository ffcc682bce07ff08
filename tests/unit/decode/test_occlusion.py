"""Something dark before a corner or an edge of a panel: what it covers says nothing of the bands."""

from __future__ import annotations

import numpy as np
import pytest

from ledpi.core.records import Floats
from ledpi.decode.evidence.occlusion import bands_mimic_occlusion, is_unoccluded, mask_occluded
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.identify.decision import Reading, read_codeword
from ledpi.markers.dictionaries import load_dictionary
from ledpi.pipeline.pipeline import Pipeline
from tests.builders.decode import PINHOLE, SPEC, Canvas, camera_info, panel_settings, square, word
from tests.builders.samples import samples_of

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
    frame = canvas.frame()
    book = Codebook.build(list(range(50)), load_dictionary("DICT_4X4_50"), SPEC)
    reading = read_codeword(samples_of(frame, TRUE), frame, book)
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


def test_what_is_covered_is_not_valid_and_the_rest_is() -> None:
    """The first cell's upper left quarter is covered: of all cells only that one loses samples."""
    canvas = Canvas()
    canvas.panel(TRUE, word(7))
    canvas.lamp(before_the_panel((-0.1, 0.1), (-0.1, 0.1)), 0.0)
    samples = mask_occluded(samples_of(canvas.frame(), TRUE))
    assert samples.valid is not None
    k = samples.lattice.k
    first = samples.valid[0].reshape(k, k)
    assert not first[: k // 3, : k // 3].any()
    assert first[-k // 3 :].all()
    assert samples.valid[1:].all()


@pytest.mark.parametrize("reach", [0.04, 0.05])
def test_the_tip_of_a_corner_is_covered_too(reach: float) -> None:
    """By 4 or 5 px: one sample of the first cell, or little more, which is dark at the panel's rim in any case."""
    canvas = Canvas()
    canvas.panel(TRUE, word(7))
    canvas.lamp(before_the_panel((-0.1, reach), (-0.1, reach)), 0.0)
    samples = mask_occluded(samples_of(canvas.frame(), TRUE))
    assert samples.valid is not None
    assert not samples.valid[0, 0]
    assert samples.valid[0].mean() > 0.8
    assert samples.valid[1:].all()


@pytest.mark.parametrize("darkness", [0.05, 0.01, 0.0], ids=["a corner", "hardly any", "none"])
def test_nothing_is_covered_where_each_sample_has_its_share(darkness: float) -> None:
    """The share is of what cells show at its place on average, over their own means; of samples that are valid."""
    canvas = Canvas()
    canvas.panel(TRUE, word(7))
    if darkness:
        canvas.lamp(before_the_panel((-0.1, darkness), (-0.1, darkness)), 0.0)
    light = samples_of(canvas.frame(), TRUE).light
    least = np.full(light.shape, 0.75, np.float32)
    over_mean = light / light.mean(axis=1, keepdims=True)
    enough = over_mean >= least * over_mean.mean(axis=0)
    assert is_unoccluded(light, None, least) == enough.all()
    assert is_unoccluded(light, enough, least)
    assert is_unoccluded(light, None, np.zeros_like(least))


def test_a_whole_panel_keeps_all_samples() -> None:
    """Gains that differ by a third, bands and the walls between cells cover nothing; nor does a dead cell."""
    gains = np.random.default_rng(1).uniform(0.7, 1.3, (4, 4))
    gains[2, 3] = 0.0
    canvas = Canvas()
    canvas.panel(TRUE, word(7), gains=gains)
    samples = samples_of(canvas.frame(), TRUE)
    assert mask_occluded(samples) is samples


def test_bands_that_darken_as_much_as_a_cover() -> None:
    """At a depth d the darkest is 1 − d, the upper quartile 1 + d/√2: a share of 0.75 at d = 0.163."""
    assert not bands_mimic_occlusion(0.16)
    assert bands_mimic_occlusion(0.17)
