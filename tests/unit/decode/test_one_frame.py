"""One frame by itself is looked at twice, and the second look does not believe the first more than the light."""

from __future__ import annotations

import numpy as np
import pytest

from ledpi.core.dictionaries import load_dictionary
from ledpi.core.records import Rejected
from ledpi.decode.evidence.light import LightWeigher
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.identify.one_frame import read_frame
from tests.builders.decode import SHORT_US, SPEC, TRUE_10_MS_US, Canvas, square, word
from tests.builders.evidence_reference import word_log_likelihoods
from tests.builders.samples import WEIGHER, evidence_at, observed, read_at

BOOK = Codebook.build(list(range(50)), load_dictionary("DICT_4X4_50"), SPEC)


def test_a_cell_that_is_surely_of_the_other_class_stays_so() -> None:
    """Two cells are wrong: one is half in a dark band, half hidden. Started as the codeword has them, both fit it."""
    true, shown = square(310.4, 240.2, 60.0, 12), word(7)
    shown[2, 0], shown[3, 0] = ~shown[2, 0], ~shown[3, 0]
    canvas = Canvas(exposure_us=SHORT_US)
    canvas.panel(true, shown, phases=(0.5, 0.25))
    across, up = true[1] - true[0], true[0] - true[3]
    left, right = true[3] - 0.2 * across, true[2] + 0.2 * across
    canvas.lamp(np.array([left + 0.105 * up, right + 0.105 * up, right - 0.2 * up, left - 0.2 * up]), 0.0)
    frame = canvas.frame()
    assert isinstance(read_at(frame, true, BOOK), Rejected)


@pytest.mark.parametrize("side", [60.0, 130.0, 250.0])
@pytest.mark.parametrize("black", [0.0, 0.3, 0.7])
def test_bands_with_harmonics_are_those_that_sinusoids_have_shown(side: float, black: float) -> None:
    """Cosine and sine of either wave: depth and phase are the fundamental's."""
    canvas, corners = Canvas(), square(310.3, 240.6, side, 3.0)
    canvas.panel(corners, word(7), phases=(black, 0.55))
    frame, own = canvas.frame(1), word(7).reshape(1, 16).astype(np.float32)
    sinusoids = word_log_likelihoods(evidence_at(frame, corners), own)[1][0]
    evidence = WEIGHER.with_harmonics(observed(frame, corners), SPEC, sinusoids)
    assert evidence is not None
    bands = word_log_likelihoods(evidence, own)[1][0]
    np.testing.assert_allclose(bands, sinusoids, atol=0.15 * np.abs(sinusoids).max())


@pytest.mark.parametrize("exposure_us", [TRUE_10_MS_US, 800.0])
def test_a_wave_that_no_cell_shows_or_that_the_exposure_leaves_nothing_of_is_no_error(exposure_us: float) -> None:
    """As where all cells of a class are dark; at 800 µs an exposure holds a whole cycle of black's."""
    canvas, corners = Canvas(exposure_us=exposure_us), square(310.3, 240.6, 60.0, 3.0)
    canvas.panel(corners, word(7))
    evidence = WEIGHER.with_harmonics(observed(canvas.frame(1), corners), SPEC, np.array([0.0, 0.0, 0.01, 0.0]))
    assert evidence is not None
    assert np.isfinite(evidence.information).all()


@pytest.mark.slow
def test_harmonics_settle_what_sinusoids_leave_open(monkeypatch: pytest.MonkeyPatch) -> None:
    """A panel of 10 px a cell is read in more frames at 10 ms, and never as another."""
    frames = []
    for seed in range(24):
        canvas, corners = Canvas(), square(310.3 + 0.13 * seed, 240.6, 42.0, 3.0 + 7.0 * seed)
        canvas.panel(corners, word(7), phases=(0.083 * seed % 1.0, 0.31 * seed % 1.0))
        frames.append(observed(canvas.frame(seed), corners))

    def read() -> list[int]:
        readings = [read_frame(seen, BOOK, WEIGHER) for seen in frames]
        return [reading.id for reading in readings if not isinstance(reading, Rejected)]

    twice = read()
    monkeypatch.setattr(LightWeigher, "with_harmonics", lambda *_: None)
    assert len(twice) > len(read())
    assert set(twice) == {7}
