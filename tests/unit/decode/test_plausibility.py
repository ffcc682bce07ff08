"""Whether what a word says hangs together: by hand, of cells whose evidence is their own alone."""

from __future__ import annotations

import numpy as np
import pytest

from ledpi.core.records import Floats
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.identify.codewords import rank_codewords
from ledpi.decode.identify.plausibility import is_consistent

FAINT, DEEPER = 0.08, 0.2
WHITE = (np.arange(16) % 2 == 1).astype(np.float32)


def panel_with(information: float, unlike: float, depth: float = FAINT) -> Evidence:
    """Of a panel that shows the word, each cosine and sine known by this `information`; and of something `unlike` it.

    This much log-likelihood, alike in all cells, of the wave that the word does not say they have.
    """
    bands: Floats = np.zeros((16, 4))
    bands[np.arange(16), np.where(WHITE > 0, 2, 0)] = depth
    other = np.abs(bands[:, [2, 3, 0, 1]]) > 0
    bands[other] = np.sqrt(2.0 * unlike / 16 / information) * (-1.0) ** (np.arange(16) // 2)
    everywhere = information * np.eye(64).reshape(16, 4, 16, 4)
    return Evidence(score=information * bands, information=everywhere, prior=np.full(4, depth**2 / 2), residual=0.0)


@pytest.mark.parametrize(("unlike", "consistent"), [(55.0, True), (62.0, False)])
def test_a_word_leaves_no_more_than_noise_and_a_tenth_of_what_it_explains(unlike: float, consistent: bool) -> None:
    """Noise in 60 dimensions is 30 nats, with a deviation of 5.5: 46.4 are allowed, and 14.3 for the word's 143.

    Each of the word's four bands was open beforehand by ½·ln(1 + 8·3000·0.0032) = 2.2 nats, which are no misfit.
    """
    evidence = panel_with(3000.0, unlike)
    fit = rank_codewords(evidence, WHITE[None])
    assert fit.likelihood[0] == pytest.approx(143.0, abs=0.5)
    assert is_consistent(evidence, fit, lead=100.0, exact=True) is consistent


@pytest.mark.parametrize(
    ("exact", "lead", "consistent"), [(True, 20.0, True), (True, 10.0, False), (False, 10.0, True)]
)
def test_of_bands_that_are_not_faint_a_word_leaves_no_more_than_its_lead(
    exact: bool, lead: float, consistent: bool
) -> None:
    """Beyond the 30 nats of noise, by the exact waveform: here 15 are left. Sinusoids leave more of any panel."""
    evidence = panel_with(480.0, 45.0, DEEPER)
    fit = rank_codewords(evidence, WHITE[None])
    assert fit.likelihood[0] == pytest.approx(143.0, abs=2.0)
    assert is_consistent(evidence, fit, lead=lead, exact=exact) is consistent
