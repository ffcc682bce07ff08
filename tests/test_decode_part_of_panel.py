"""Exposures so short that dark bands cut panels: what is found of a panel is all of it, or nothing."""

from __future__ import annotations

import math

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
    Profile,
    camera_info,
    diffuser,
    drawn,
    flat,
    panel_settings,
    square,
    word,
)
from samples_material import samples_of

from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.evidence.single_frame import single_evidence
from ledpi.decode.identify.codebook import Codebook, repeats
from ledpi.decode.identify.rivals import odds_against_stretched, prior_odds_of_word
from ledpi.decode.identify.tilt import LEAST_TILT
from ledpi.decode.identify.words import likeliest
from ledpi.dictionaries import load_dictionary
from ledpi.pipeline import Pipeline

PANEL = square(310.3, 240.6, 130)
STEADY_US = 640.0  # four fifths of 1250 Hz' period, and 1.6 of 2450 Hz'


def test_patterns_that_repeat_their_rows_or_columns() -> None:
    """Word 17 does so as it hangs; of six columns those that are alike by threes do, too."""
    assert repeats(word(17).ravel())
    assert repeats(word(17, 1).ravel())
    assert not repeats(word(7).ravel())
    assert repeats(drawn("000111/000111/000111/111000/111000/111000").ravel())
    assert not repeats(drawn("00110/00110/11001/11001/11001").ravel())


def test_words_that_a_part_of_a_panel_may_look_like() -> None:
    """Of DICT_4X4_50 six, five of them if one cell is wrong. Word 17 is what two rows of three cells show, 000 and 010.

    Its second column is sampled from 0.265 to 0.485 of the side; there the middle cell begins at 1/3. Two rows of four
    cells, 0110 and 0000, look exactly like it.
    """
    book = Codebook.build(list(range(50)), load_dictionary("DICT_4X4_50"), SPEC)
    assert {int(book.ids[w]) for w in range(200) if book.stretched_beside(w).cells} == {3, 17, 22, 30, 33, 37}
    middle = (0.485 - 1 / 3) / 0.22
    parts = book.stretched_beside(17 * 4)
    assert parts.cells == ((3, 2), (4, 2))
    np.testing.assert_allclose(parts.white[0], [*[0, middle, middle, 0] * 2, *[0] * 8], atol=1e-6)
    np.testing.assert_array_equal(parts.white[1], book.white[17 * 4])


@pytest.mark.parametrize(
    ("sides", "tan_whole", "tan_part"),
    [((1 + 0j, 1j), LEAST_TILT, math.sqrt(3.0)), ((2 + 0j, 1j), math.sqrt(3.0), LEAST_TILT)],
)
def test_a_part_is_as_likely_as_it_is_tilted(sides: tuple[complex, complex], tan_whole: float, tan_part: float) -> None:
    """Word 22 as a square, and twice as wide: then two rows of four cells are seen from the front.

    The cosine of the other's tilt is a half. What the light says is the same.
    """
    book = Codebook.build(list(range(50)), load_dictionary("DICT_4X4_50"), SPEC)
    corners = square(310.3, 240.6, 60)
    canvas = Canvas(exposure_us=TRUE_10_MS_US)
    canvas.panel(corners, book.white[22 * 4].reshape(4, 4) > 0, phases=(0.3, 0.7))
    evidence = single_evidence(samples_of(canvas.frame(1), corners), canvas.frame(1), SPEC)
    assert isinstance(evidence, Evidence)
    fit, beside = likeliest(evidence, book.white), book.stretched_beside(22 * 4)
    assert (fit.words[0], beside.cells) == (22 * 4, ((4, 2), (4, 2)))
    by_light = fit.likelihood[0] - likeliest(evidence, beside.white).likelihood[0]
    odds = by_light + 2.0 * math.log(tan_part / tan_whole) + prior_odds_of_word(book)
    assert odds_against_stretched(evidence, fit, book, sides) == pytest.approx(odds)


@pytest.mark.parametrize(
    ("exposure_us", "profile"),
    [
        (SHORT_US, flat),
        (300.0, flat),
        *((exposure_us, diffuser) for exposure_us in (560.0, STEADY_US, 1000.0, 1200.0, 2000.0, TRUE_10_MS_US)),
    ],
)
def test_half_a_panel_that_shows_the_very_same_is_no_panel(exposure_us: float, profile: Profile) -> None:
    """Two rows of four cells, 0110 and 0000, from the front: not word 17, in no frame. By its shape, or its walls."""
    path = Pipeline(camera_info(exposure_us=exposure_us), panel_settings(), intrinsics=PINHOLE)
    lit = np.repeat([[1.0], [0.0]], [2, 2], axis=0) * np.ones(4)
    for seq in range(8):
        canvas = Canvas(exposure_us=exposure_us)
        start_us = seq * FRAME_ROWS * ROW_TIME_US
        cells = drawn("0110/0000/0000/0000")
        canvas.panel(square(310.3, 240.6, 60, 4), cells, gains=lit, start_us=start_us, light=0.35, profile=profile)
        assert path.decode(canvas.frame(seq, seq=seq)).markers == ()


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
