"""Exposures so short that dark bands cut panels: what is found of a panel is all of it, or nothing."""

from __future__ import annotations

import numpy as np
import pytest
from decode_material import PINHOLE, SHORT_US, SPEC, Canvas, bare, camera_info, drawn, panel_settings, square, word

from ledpi.decode.identify.codebook import repeats
from ledpi.decode.striped.find_striped import StripedFinder
from ledpi.decode.striped.part_of_panel import PART
from ledpi.decode.striped.striped import striped_square
from ledpi.pipeline import Pipeline
from ledpi.records import Floats, Frame, Quad, Rejected

PANEL = square(310.3, 240.6, 130)


def found_at(frame: Frame, corners: Floats) -> Quad | Rejected:
    rows = StripedFinder(640, 480, [SPEC], 8.0).stripe_rows(frame)
    return striped_square(frame, corners[None], 4, [SPEC], rows, PINHOLE)


def frame_of(canvas: Canvas) -> Frame:
    canvas.panel(PANEL, word(7), light=0.3, phases=(0.3, 0.7))
    return canvas.frame()


@pytest.mark.parametrize("columns", [(0, 2), (1, 3)])
def test_two_columns_of_a_panel_are_none(columns: tuple[int, int]) -> None:
    """Their light is explained as well by four columns that are turned away by 60°."""
    left, right = (PANEL[0, 0] + 130 * column / 4 for column in columns)
    top, bottom = PANEL[0, 1], PANEL[2, 1]
    part = np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
    assert isinstance(found_at(frame_of(Canvas(exposure_us=SHORT_US)), part), Rejected)


def test_what_shows_its_bands_beyond_its_sides_is_a_part() -> None:
    """The square of two rows and columns in the middle, turned not at all."""
    assert found_at(frame_of(Canvas(exposure_us=SHORT_US)), square(310.3, 240.6, 65)) == PART


def test_a_panel_beside_something_bright_is_whole() -> None:
    """A white sheet with black lines, as bright as the panel, touches it on both sides: but it does not blink."""
    canvas = Canvas(exposure_us=SHORT_US)
    canvas.light[150:330, 200:420] = 0.5
    canvas.light[150:330:9, 200:420] = 0.02
    assert isinstance(found_at(frame_of(canvas), PANEL), Quad)


def test_patterns_that_repeat_their_rows_or_columns() -> None:
    """Word 17 does so as it hangs; of six columns those that are alike by threes do, too."""
    assert repeats(word(17).ravel()) == (True, False)
    assert repeats(word(17, 1).ravel()) == (False, True)
    assert repeats(word(7).ravel()) == (False, False)
    assert repeats(drawn("000111/000111/000111/111000/111000/111000").ravel()) == (True, True)
    assert repeats(drawn("00110/00110/11001/11001/11001").ravel()) == (False, False)


@pytest.mark.parametrize("turns", range(4))
def test_word_17_is_still_read_from_the_front(turns: int) -> None:
    """As its four corners are those of a square, it is no half of a panel."""
    canvas = Canvas(exposure_us=SHORT_US)
    canvas.panel(PANEL, word(17, turns), light=0.3, phases=(0.3, 0.7))
    pipeline = Pipeline(camera_info(exposure_us=SHORT_US), panel_settings(), intrinsics=PINHOLE, stream=False)
    assert [marker.sighting.id for marker in pipeline.decode(canvas.frame()).markers] == [17]


@pytest.mark.parametrize("exposure_us", [SHORT_US, 300.0])
@pytest.mark.parametrize("side", [90.0, 130.0, 220.0])
@pytest.mark.parametrize("turn_deg", [4.0, 33.0])
def test_bare_leds_are_read_as_one_panel(side: float, turn_deg: float, exposure_us: float) -> None:
    """Bands cut each spot into pieces, and there is nearly no light between them: they are joined first."""
    true = square(310.3, 240.6, side, turn_deg)
    canvas = Canvas(exposure_us=exposure_us)
    canvas.panel(true, word(7), light=0.35, profile=bare, phases=(0.3, 0.7))
    pipeline = Pipeline(camera_info(exposure_us=exposure_us), panel_settings(), intrinsics=PINHOLE, stream=False)
    (marker,) = pipeline.decode(canvas.frame()).markers
    assert marker.sighting.id == 7
    assert np.abs(marker.sighting.corners_px - true).max() < 0.005 * side
