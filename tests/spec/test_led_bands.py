"""The shutter equations predict the bands in real photographs of a blinking lamp."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from evaluation.accuracy import led_bands as bench
from tests.builders.lamp import photographed_lamp

FREQUENCIES = [500.0, 700.0, 800.0, 1000.0, 1500.0, 2000.0, 2500.0, 3000.0]


def correlation(picture: np.ndarray, frequency_hz: float) -> float:
    part = bench.part_with_bands(picture, 1e6 / frequency_hz / 33.67)
    assert part is not None
    photograph = bench.Photograph("made", frequency_hz, part.astype(float))
    return bench.fitted(bench.row_profile(photograph, bench.srgb_tone), frequency_hz)[0]


def test_the_measure_knows_bands_of_the_right_frequency_from_others() -> None:
    """On a made-up lamp: above 0.999 for its own frequency, below 0.9 for one 10 % off or for a steady lamp."""
    lamp = photographed_lamp(1000.0, depth=1.0)
    assert correlation(lamp, 1000.0) > 0.999
    assert correlation(lamp, 1100.0) < 0.9
    assert correlation(photographed_lamp(1000.0, depth=0.0), 1000.0) < 0.9


def test_saturated_pixels_are_left_out() -> None:
    """A row's light is the mean of its unsaturated pixels; a row that is mostly saturated has none."""
    values = np.array([[100.0, 100.0, 255.0, 100.0], [255.0, 255.0, 255.0, 100.0]])
    profile = bench.row_profile(bench.Photograph("made", 1000.0, values), lambda v: v / 200.0)
    np.testing.assert_array_equal(profile, [0.5, np.nan])


def test_a_lamp_of_too_few_periods_is_left_out() -> None:
    """Less than one and a half periods of bands are no evidence."""
    assert bench.part_with_bands(photographed_lamp(100.0, depth=0.5), 297.0) is None


def test_without_the_photographs_it_says_what_is_missing(tmp_path: Path) -> None:
    """They are not part of the project, so most who try it have none."""
    with pytest.raises(SystemExit, match="holds no photographs"):
        bench.measure(tmp_path)


@pytest.mark.slow
def test_real_lamps_show_the_predicted_bands(shared: Callable[[str], Path]) -> None:
    """Every photograph, at every frequency, correlates at 0.98 or better, and by far less at a frequency 10 % off.

    Leaves mostly tone under sRGB: with the curve from photographs at 500 Hz, the others' median is 0.99 or better.
    """
    found, _ = bench.photographs(shared("real/led_bands"))
    assert len(found) > 90
    right, wrong = (bench.correlations(found, bench.srgb_tone, scale=scale) for scale in (1.0, 1.1))
    assert list(right) == FREQUENCIES
    assert all(len(values) >= 10 for values in right.values())
    assert {f: min(values) for f, values in right.items() if min(values) < 0.98} == {}
    assert max(max(values) for values in wrong.values()) < 0.95
    assert max(float(np.median(values)) for values in wrong.values()) < 0.9
    tone = bench.measured_tone([p for p in found if p.frequency_hz == 500.0])
    for frequency, values in bench.correlations([p for p in found if p.frequency_hz != 500.0], tone).items():
        assert np.median(values) > 0.99, frequency
