"""Cells that give no light: erasures. They say nothing of their class, and leave the others what these say."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ledpi.core.dictionaries import load_dictionary
from ledpi.core.records import Floats, Frame, Rejected
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.evidence.waves import band_prior
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.identify.decision import Reading, decide
from ledpi.pipeline.pipeline import Pipeline
from tests.builders.decode import (
    PINHOLE,
    SPEC,
    TRUE_10_MS_US,
    Bits,
    Canvas,
    camera_info,
    drawn,
    panel_settings,
    reason,
    square,
    word,
)
from tests.builders.samples import erased_cells, evidence_at, read_at

BOOK = Codebook.build(list(range(50)), load_dictionary("DICT_4X4_50"), SPEC)
PRIOR = band_prior(Canvas().frame(None), SPEC)
EACH = 20.0  # log-likelihood by which a cell that is seen tells its class


def shown(marker_id: int, gains: Floats, side: float, seed: int) -> tuple[Frame, Floats]:
    """A frame of a panel, and its corners there."""
    rng = np.random.default_rng(seed)
    corners = square(310 + rng.uniform(), 240 + rng.uniform(), side, 20 * rng.uniform())
    canvas = Canvas(exposure_us=TRUE_10_MS_US)
    canvas.panel(corners, word(marker_id), light=0.5, gains=gains, phases=tuple(rng.uniform(size=2)))
    return canvas.frame(seed), corners


def evidence_for(cells: Bits, erased: tuple[int, ...] = ()) -> Evidence:
    """Evidence of a panel that shows a pattern's bands of the usual depth; of `erased` cells there is none."""
    white, bands = cells.reshape(-1), np.sqrt(PRIOR)
    own = EACH / (0.5 * float((bands[:2] ** 2).sum())) * np.eye(4)  # of either class; both, as information is of all
    information = np.zeros((16, 4, 16, 4))
    for cell in set(range(16)) - set(erased):
        information[cell, :, cell, :] = own
    each = np.where(np.repeat(white[:, None], 4, axis=1) == np.array([False, False, True, True]), bands, 0.0)
    score = np.einsum("cidj,dj->ci", information, each)
    return Evidence(score=score, information=information, prior=PRIOR)


@pytest.mark.parametrize("side", [24.0, 60.0])
def test_of_a_dead_cell_nothing_is_known_and_of_all_others_something(side: float) -> None:
    """Its neighbours' light in it is not taken for its own."""
    gains = np.ones((4, 4))
    gains[1, 2] = 0.0
    evidence = evidence_at(*shown(7, gains, side, 1))
    assert np.flatnonzero(erased_cells(evidence)).tolist() == [6]


def test_cells_of_unlike_brightness_are_all_lit() -> None:
    """Down to half of the others' light."""
    evidence = evidence_at(*shown(7, np.random.default_rng(2).uniform(0.5, 1.0, (4, 4)), 60.0, 1))
    assert not erased_cells(evidence).any()


def test_a_far_panel_with_a_dead_cell_is_read() -> None:
    """At 50 px a side one frame in ten is not enough with a dead cell; half were not while its light counted."""
    read = 0
    for seed in range(12):
        gains = np.ones(16)
        gains[seed] = 0.0
        reading = read_at(*shown(7, gains.reshape(4, 4), 50.0, seed), BOOK)
        assert isinstance(reading, Rejected) or reading.id == 7
        read += isinstance(reading, Reading)
    assert read >= 9


@pytest.mark.slow
def test_in_deep_bands_a_panel_with_a_dead_cell_is_read() -> None:
    """At 60 px a side, whichever cell it is."""
    path = Pipeline(camera_info(exposure_us=300.0), panel_settings(), intrinsics=PINHOLE, stream=False)
    read = []
    for dead in range(16):
        gains = np.ones(16)
        gains[dead] = 0.02
        canvas = Canvas(exposure_us=300.0)
        canvas.panel(square(310.4, 240.2, 60.0, 12), word(7), light=0.3, gains=gains.reshape(4, 4), phases=(0.1, 0.5))
        read += [marker.detection.id for marker in path.decode(canvas.frame(dead)).markers]
    assert set(read) == {7}
    assert len(read) >= 14


@pytest.mark.slow
def test_where_no_cell_can_be_corrected_a_dead_one_is_still_erased() -> None:
    """Words of DICT_4X4_1000 differ in two cells; a dead one is seen as either class, and is no error."""
    settings = panel_settings("panels.dictionary=DICT_4X4_1000")
    path = Pipeline(camera_info(exposure_us=150.0), settings, intrinsics=PINHOLE, stream=False)
    cells, read = load_dictionary("DICT_4X4_1000").codewords[700], []
    for dead in range(16):
        gains = np.ones(16)
        gains[dead] = 0.02
        canvas = Canvas(exposure_us=150.0)
        canvas.panel(square(310.4, 240.2, 100.0, 12), cells, light=0.3, gains=gains.reshape(4, 4), phases=(0.3, 0.7))
        read += [marker.detection.id for marker in path.decode(canvas.frame(dead)).markers]
    assert set(read) == {700}
    assert len(read) >= 14


@pytest.mark.parametrize(("erased", "correctable"), [((), 1), ((6,), 1), ((6, 8), 0), ((0, 1), 1), ((6, 8, 10), 0)])
def test_how_many_cells_may_be_wrong_beside_those_erased(erased: tuple[int, ...], correctable: int) -> None:
    """The words nearest to 7 are 44 and 45: they differ from it in 6, 8, 10, 14 and in 2, 6, 12, 14."""
    own = int(np.flatnonzero((BOOK.ids == 7) & (BOOK.quarter_turns == 0))[0])
    assert BOOK.correctable_beside(np.isin(np.arange(16), erased), own) == correctable


def test_with_two_wrong_cells_beside_the_erased_one_it_is_no_word() -> None:
    """Words differ in three cells at least: that pattern may be another panel's."""
    wrong = word(7).copy()
    wrong[0, 0] ^= True
    wrong[3, 2] ^= True
    assert reason(decide(evidence_for(wrong, erased=(5,)), BOOK, 1e-6)) == "identify.not_in_dictionary"


def test_two_words_that_differ_in_erased_cells_only_are_not_distinguished() -> None:
    """Without 6, 8, 10 and 14 a panel may be 7 or 44: it is read as neither. Where 14 is seen, it is 7."""
    assert reason(decide(evidence_for(word(7), erased=(6, 8, 10, 14)), BOOK, 1e-6)) == "identify.ambiguous"
    assert getattr(decide(evidence_for(word(7), erased=(6, 8, 10)), BOOK, 1e-6), "id", None) == 7


def test_an_erased_cell_takes_no_more_than_one_bit_from_the_odds() -> None:
    """Patterns that differ in it are as likely as those that do not: twice as many, a factor of two."""
    margins = []
    for erased in ((), (5,)):
        reading = decide(evidence_for(word(39), erased=erased), BOOK, 1e-6)
        assert isinstance(reading, Reading)
        margins.append(reading.margin)
    # Of 16 or 15 cells any two may be what is wrong: the pairs, with what one more cell says of each.
    assert margins[0] - margins[1] < math.log(2) + 1.0


def test_a_word_that_but_for_a_cell_in_doubt_is_two_larger_cells_is_not_read() -> None:
    """Word 37 from the left: two columns of either class, but for a cell that tells a fifth of what others do."""
    like_37 = drawn("1100/1110/1100/1100")
    assert getattr(decide(evidence_for(like_37), BOOK, 1e-6), "id", None) == 37
    doubtful = evidence_for(like_37)
    doubtful.score[6] /= 5.0
    doubtful.information[6, :, 6] /= 5.0
    assert reason(decide(doubtful, BOOK, 1e-6)) == "identify.not_in_dictionary"
