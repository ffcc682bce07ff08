"""No cell counts for more than the model is worth: by hand, of cells whose evidence is their own alone."""

from __future__ import annotations

import numpy as np
import pytest

from ledpi.core.dictionaries import load_dictionary
from ledpi.core.records import Floats, Rejected, Singles
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.identify.codewords import rank_codewords
from ledpi.decode.identify.decision import FALSE_ID_RATE, Reading, decide
from ledpi.decode.identify.model_error import with_model_error
from tests.builders.decode import SPEC

FAINT = 0.08
WHITE = (np.arange(16) % 2 == 1).astype(np.float32)
BOOK = Codebook.build([7, 23], load_dictionary("DICT_4X4_50"), SPEC)


def shown_by(white: Singles) -> Floats:
    """(16, 4) the bands of a panel of these classes."""
    bands: Floats = np.zeros((16, 4))
    bands[np.arange(16), np.where(white > 0, 2, 0)] = FAINT
    return bands


def evidence_of(bands: Floats, information: float) -> Evidence:
    """Evidence by which each cosine and sine is known alike."""
    everywhere = information * np.eye(64).reshape(16, 4, 16, 4)
    return Evidence(score=information * bands, information=everywhere, prior=np.full(4, FAINT**2 / 2))


def with_misfit(white: Singles, information: float, nats: float) -> Evidence:
    """A panel of these classes, and so much log-likelihood of the wave that they do not say, alike in all cells."""
    bands = shown_by(white)
    other = np.abs(bands[:, [2, 3, 0, 1]]) > 0
    bands[other] = np.sqrt(2.0 * nats / 16 / information) * (-1.0) ** (np.arange(16) // 2)
    return evidence_of(bands, information)


@pytest.mark.parametrize(("nats", "ratio"), [(8.0, 1.0), (11.0, 2.0), (43.0, 18.0)])
def test_what_a_cell_shows_beside_its_codeword_is_an_error_of_that_cell(nats: float, ratio: float) -> None:
    """Noise leaves a χ² of 4 on average, and of 18, which is 9 nats, once in a thousand."""
    bands = shown_by(WHITE)
    bands[5, 0] = np.sqrt(2.0 * nats / 3000.0)
    evidence = evidence_of(bands, 3000.0)
    known = with_model_error(evidence, rank_codewords(evidence, WHITE[None]), WHITE)
    own, before = known.own_information, evidence.own_information
    np.testing.assert_allclose(own[5], before[5] / ratio, rtol=0.15)
    np.testing.assert_array_equal(np.delete(own, 5, axis=0), np.delete(before, 5, axis=0))


@pytest.mark.parametrize(("nats", "ratio"), [(54.0, 1.0), (1.5 * 55.3, 1.5)])
def test_what_is_left_of_all_cells_alike_counts_as_noise(nats: float, ratio: float) -> None:
    """Noise in 60 dimensions is 30 nats, with a deviation of 5.5: 46.4 are allowed, and a sixteenth of 143."""
    evidence = with_misfit(WHITE, 3000.0, nats)
    known = with_model_error(evidence, rank_codewords(evidence, WHITE[None]), WHITE)
    np.testing.assert_allclose(known.information, evidence.information / ratio, rtol=0.03)
    np.testing.assert_allclose(known.score, evidence.score / ratio, rtol=0.03)


def test_the_reported_margin_counts_the_error() -> None:
    clean, worse = (decide(with_misfit(BOOK.white[0], 3000.0, nats), BOOK, FALSE_ID_RATE) for nats in (20.0, 60.8))
    assert isinstance(clean, Reading)
    assert isinstance(worse, Reading)
    assert worse.margin < clean.margin / 1.08
    assert isinstance(decide(with_misfit(BOOK.white[0], 3000.0, 1.4 * 55.3), BOOK, FALSE_ID_RATE), Rejected)


@pytest.mark.parametrize("information", [30_000.0, 300_000.0, 3_000_000.0])
def test_light_does_not_make_a_codeword_of_a_pattern_two_cells_off(information: float) -> None:
    """Blur leaves the codeword's class a little stronger in both: by a few percent of all, so by any number of nats."""
    near, shown = BOOK.white[0].copy(), shown_by(BOOK.white[0])
    near[:2] = 1.0 - near[:2]
    shown[:2] = 0.55 * shown[:2] + 0.45 * shown_by(near)[:2]
    assert isinstance(decide(evidence_of(shown, information), BOOK, FALSE_ID_RATE), Rejected)
    assert isinstance(decide(evidence_of(shown_by(BOOK.white[0]), information), BOOK, FALSE_ID_RATE), Reading)


def test_a_cell_in_doubt_is_corrected_and_one_of_the_other_class_is_none() -> None:
    """A cell without bands is hidden or dark; one that blinks at the other frequency belongs to another pattern."""
    hidden, other = shown_by(BOOK.white[0]), shown_by(BOOK.white[0])
    hidden[5] = 0.0
    other[5] = other[5, [2, 3, 0, 1]]
    assert isinstance(decide(evidence_of(hidden, 6000.0), BOOK, FALSE_ID_RATE), Reading)
    assert isinstance(decide(evidence_of(other, 6000.0), BOOK, FALSE_ID_RATE), Rejected)
