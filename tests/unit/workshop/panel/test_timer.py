"""Frequencies of a 16 MHz timer of 16 bits, by literal numbers."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ledpi.workshop.panel.frequencies import half_period


@pytest.mark.parametrize(
    ("hz", "cycles", "made_hz", "ppm"),
    [
        (1250.0, 6400, 1250.0, 0.0),
        (2450.0, 3265, 2450.229709, 93.76),  # 8e6/2450 = 3265.306
        (1333.333333, 6000, 1333.333333, 0.0),
        (20000.0, 400, 20000.0, 0.0),
    ],
)
def test_half_a_period_in_whole_cycles(hz: float, cycles: int, made_hz: float, ppm: float) -> None:
    """The nearest whole number of cycles, what it makes, and how far that is off."""
    half = half_period(hz)
    assert half.cycles == cycles
    assert half.frequency_hz == pytest.approx(made_hz, abs=1e-6)
    assert half.error_ppm == pytest.approx(ppm, abs=0.01)


@pytest.mark.parametrize(
    ("hz", "told"),
    [
        (3000.0, "125 ppm .* nearest are 2999.6250 Hz and 3000.7502 Hz"),  # 2667 and 2666 cycles
        (122.0, "too slow .* nearest is 122.0722 Hz"),  # 65535 cycles
        (20010.0, "no time; the nearest is 20000.0000 Hz"),
        (0.0, "must be positive"),
        (float("nan"), "must be positive"),
    ],
)
def test_what_cannot_be_made_names_what_can(hz: float, told: str) -> None:
    """Off by more than 100 ppm, or beyond the timer's 16 bits or its interrupts' time."""
    with pytest.raises(ValueError, match=told):
        half_period(hz)


@pytest.mark.slow
@given(st.floats(min_value=122.08, max_value=20_000.0))
def test_what_is_accepted_is_within_100_ppm_and_nothing_nearer_exists(hz: float) -> None:
    """For any frequency in the timer's range: made to 100 ppm with the best count, or refused because no count does."""
    best_ppm = min(abs(8e6 / n / hz - 1.0) * 1e6 for n in (int(8e6 / hz), int(8e6 / hz) + 1))
    if best_ppm > 100.0:
        with pytest.raises(ValueError, match="nearest are"):
            half_period(hz)
    else:
        assert abs(half_period(hz).error_ppm) == pytest.approx(best_ppm, abs=1e-6)
