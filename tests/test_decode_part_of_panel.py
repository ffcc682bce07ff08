"""Exposures so short that dark bands cut panels: what is found of a panel is all of it, or nothing."""

from __future__ import annotations

import numpy as np
import pytest
from decode_material import (
    FRAME_ROWS,
    PINHOLE,
    ROW_TIME_US,
    SHORT_US,
    SPEC,
    TRUE_10_MS_US,
    Canvas,
    bare,
    camera_info,
    drawn,
    flat,
    panel_settings,
    square,
    word,
)

from ledpi.decode.identify.codebook import Codebook, repeats
from ledpi.decode.striped.find_striped import StripedFinder
from ledpi.decode.striped.part_of_panel import PART
from ledpi.decode.striped.striped import striped_square
from ledpi.dictionaries import load_dictionary
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


def test_words_that_a_part_of_a_panel_may_look_like() -> None:
    """Of DICT_4X4_50 one. Word 17 is what two rows of three cells show, 000 and 010.

    Its second column is sampled from 0.265 to 0.485 of the side; there the middle cell begins at 1/3.
    """
    book = Codebook.build(list(range(50)), load_dictionary("DICT_4X4_50"), SPEC)
    assert {int(book.ids[w]) for w in range(200) if len(book.stretched_beside(w))} == {17}
    middle = (0.485 - 1 / 3) / 0.22
    rows = [[0, middle, middle, 0]] * 2 + [[0.0] * 4] * 2
    assert any(np.allclose(part.reshape(4, 4), rows) for part in book.stretched_beside(17 * 4))


def part_in_stream(exposure_us: float, shape: float, side: float) -> list[list[int]]:
    """IDs in eight frames of a panel, narrower than a square, of which two rows of three cells are lit: 000 and 010."""
    path, lit = Pipeline(camera_info(exposure_us=exposure_us), panel_settings(), intrinsics=PINHOLE), np.zeros((4, 4))
    lit[:2, :3] = 1.0
    corners, ids = square(0, 0, side, 4) * (shape, 1.0) + (310.3, 240.6), []
    for seq in range(8):
        canvas = Canvas(exposure_us=exposure_us)
        cells, start_us = drawn("0000/0100/0000/0000"), seq * FRAME_ROWS * ROW_TIME_US
        canvas.panel(corners, cells, gains=lit, start_us=start_us, light=0.35, profile=flat)
        ids.append([marker.sighting.id for marker in path.decode(canvas.frame(seq, seq=seq)).markers])
    return ids


@pytest.mark.parametrize("exposure_us", [TRUE_10_MS_US, 3000.0, 2000.0])
@pytest.mark.parametrize(("shape", "side"), [(1.0, 45.0), (0.9, 60.0)])
def test_a_part_that_looks_like_a_word_is_not_read_in_a_stream(exposure_us: float, shape: float, side: float) -> None:
    """Taken for four by four cells it shows word 17, but that four of these show both classes."""
    assert part_in_stream(exposure_us, shape, side) == [[]] * 8


@pytest.mark.parametrize("turns", range(4))
@pytest.mark.parametrize("exposure_us", [SHORT_US, TRUE_10_MS_US])
def test_word_17_is_still_read_from_the_front(turns: int, exposure_us: float) -> None:
    """As its four corners are those of a square, it is no half of a panel."""
    canvas = Canvas(exposure_us=exposure_us)
    canvas.panel(PANEL, word(17, turns), light=0.3, phases=(0.3, 0.7))
    pipeline = Pipeline(camera_info(exposure_us=exposure_us), panel_settings(), intrinsics=PINHOLE, stream=False)
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
