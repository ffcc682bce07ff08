"""The second pass starts from an estimate, and does not believe it more than the light."""

from __future__ import annotations

import numpy as np

from ledpi.core.records import Rejected
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.identify.decision import read_codeword
from ledpi.markers.dictionaries import load_dictionary
from tests.builders.decode import SHORT_US, SPEC, Canvas, square, word
from tests.builders.samples import samples_of


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
    book = Codebook.build(list(range(50)), load_dictionary("DICT_4X4_50"), SPEC)
    assert isinstance(read_codeword(samples_of(frame, true), frame, book), Rejected)
