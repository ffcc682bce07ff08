"""A word is plausible or not: by hand, of cells whose evidence is their own alone."""

from __future__ import annotations

import numpy as np
import pytest

from ledpi.core.records import Floats, Rejected, Singles
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.identify.codewords import rank_codewords
from ledpi.decode.identify.decision import FALSE_ID_RATE, INCONSISTENT, Reading, decide
from ledpi.decode.identify.plausibility import misfit_inflation
from ledpi.markers.dictionaries import load_dictionary
from tests.builders.decode import SPEC

FAINT = 0.08
WHITE = (np.arange(16) % 2 == 1).astype(np.float32)


def panel_with(information: float, unlike: float, white: Singles = WHITE) -> Evidence:
    """Evidence of a panel that shows the word, cosines and sines known by `information`; and of something `unlike` it.

    This much log-likelihood, alike in all cells, of the wave that the word does not say they have.
    """
    bands: Floats = np.zeros((16, 4))
    bands[np.arange(16), np.where(white > 0, 2, 0)] = FAINT
    other = np.abs(bands[:, [2, 3, 0, 1]]) > 0
    bands[other] = np.sqrt(2.0 * unlike / 16 / information) * (-1.0) ** (np.arange(16) // 2)
    everywhere = information * np.eye(64).reshape(16, 4, 16, 4)
    return Evidence(score=information * bands, information=everywhere, prior=np.full(4, FAINT**2 / 2))


@pytest.mark.parametrize(("unlike", "inflation"), [(54.0, 1.0), (2 * 55.3, 2.0), (4 * 55.3, 4.0)])
def test_what_a_word_leaves_beyond_noise_and_a_sixteenth_of_what_it_explains_counts_as_noise(
    unlike: float, inflation: float
) -> None:
    """Noise in 60 dimensions is 30 nats, with a deviation of 5.5: 46.4 are allowed, and 8.9 for the word's 143.

    Each of the word's four bands was open beforehand by ½·ln(1 + 8·3000·0.0032) = 2.2 nats, which are no misfit.
    """
    evidence = panel_with(3000.0, unlike)
    fit = rank_codewords(evidence, WHITE[None])
    assert fit.likelihood[0] == pytest.approx(143.0, abs=0.5)
    assert misfit_inflation(evidence, fit) == pytest.approx(inflation, rel=0.02)


def decide_with(unlike: float) -> Reading | Rejected:
    """On a panel that shows ID 7, with so much that is unlike it."""
    book = Codebook.build([7, 23], load_dictionary("DICT_4X4_50"), SPEC)
    return decide(panel_with(3000.0, unlike, white=book.white[0]), book, FALSE_ID_RATE)


def test_a_word_is_read_as_long_as_its_odds_are_enough_by_the_noise_it_leaves() -> None:
    """The margin that is reported is divided by that noise too."""
    clean, worse = decide_with(20.0), decide_with(1.1 * 55.3)
    assert isinstance(clean, Reading)
    assert isinstance(worse, Reading)
    assert worse.margin < clean.margin / 1.1
    assert decide_with(1.4 * 55.3) == INCONSISTENT
