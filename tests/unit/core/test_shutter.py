"""The rolling shutter's equations, against numerical integration, literals, and sums done by hand."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from ledpi.core.records import Frame
from ledpi.core.shutter import (
    band_width_rows,
    contrast,
    exposure_weight,
    harmonic_amplitude,
    phase_advance_cycles,
    row_mid_exposure_ns,
    row_weights,
)

SAMPLES = 10_000


def is_on(cycles: NDArray[np.float64], duty: float) -> NDArray[np.bool_]:
    """The square wave by its definition: on in the first `duty` of each cycle."""
    return np.mod(cycles, 1.0) < duty


def integrated_weight(start: float, exposure_cycles: float, duty: float) -> float:
    """Mean of the square wave over the exposure by the midpoint rule. Each edge costs at most 1/SAMPLES."""
    midpoints = start + exposure_cycles * (np.arange(SAMPLES) + 0.5) / SAMPLES
    return float(is_on(midpoints, duty).mean())


def integrated_wave(exposure_cycles: float, duty: float, phases: int = 300) -> NDArray[np.float64]:
    """w at evenly spaced phases over one cycle, by numerical integration."""
    return np.array([integrated_weight(p / phases, exposure_cycles, duty) for p in range(phases)])


@pytest.mark.parametrize("duty", [0.5, 0.13, 0.98])
@pytest.mark.parametrize("exposure_cycles", [0.07, 0.5, 3.37, 24.419])
def test_weight_is_the_integral_of_the_wave(exposure_cycles: float, duty: float) -> None:
    """The closed form is the mean of the on/off wave over the exposure, at odd phases of either sign."""
    starts = np.array([-7.31, -0.5, 0.0, 0.1234, 0.4999, 0.87, 5.003, 1234.567])
    expected = [integrated_weight(start, exposure_cycles, duty) for start in starts]
    edges = 2 * (exposure_cycles + 1)
    np.testing.assert_allclose(exposure_weight(starts, exposure_cycles, duty), expected, rtol=0, atol=edges / SAMPLES)


def test_weight_of_whole_cycles_is_the_duty_and_of_no_exposure_is_refused() -> None:
    """An exposure of whole cycles sees the duty, wherever it starts: no bands; one that is not positive is an error."""
    starts = np.linspace(0, 1, 36).reshape(3, 4, 3)
    np.testing.assert_allclose(exposure_weight(starts, 7.0, 0.3), np.full((3, 4, 3), 0.3), rtol=0, atol=1e-12)
    with pytest.raises(ValueError, match="exposure_cycles must be positive"):
        exposure_weight(np.zeros(1), 0.0)


def test_rows_of_a_lamp_by_hand() -> None:
    """1 kHz, 100 µs rows and exposure, 1/20 cycle old: four rows on, a half, four off, a half."""
    weights = row_weights(
        np.arange(10.0), frequency_hz=1000, phase_cycles=0.05, duty=0.5, exposure_us=100, row_time_us=100
    )
    np.testing.assert_allclose(weights, [1, 1, 1, 1, 0.5, 0, 0, 0, 0, 0.5], rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("frequency_hz", "exposure_us", "expected"),
    [
        (1250, 10000, 0.0800),
        (2450, 10000, 0.0408),
        (650, 10000, 0.1538),
        (1250, 9967, 0.0736),
        (2450, 9967, 0.0343),
        (1250, 150, 2.0),  # shorter than half a cycle: from dark to fully on
        (700, 10000, 0.0),  # a multiple of 100 Hz: mains flicker, and bands, are gone
    ],
)
def test_contrast_of_the_working_points(frequency_hz: float, exposure_us: float, expected: float) -> None:
    """The depths that the design names, over the mean."""
    assert contrast(frequency_hz, exposure_us) == pytest.approx(expected, abs=5e-5)


@pytest.mark.parametrize("duty", [0.5, 0.2, 0.8])
@pytest.mark.parametrize("exposure_cycles", [0.1, 0.9, 12.459])
def test_contrast_is_the_swing_of_the_integrated_wave(exposure_cycles: float, duty: float) -> None:
    """Peak to peak over mean of the numerically integrated wave, for any duty."""
    wave = integrated_wave(exposure_cycles, duty, phases=200)
    swing = (wave.max() - wave.min()) / duty
    # The grid of phases misses the peak by at most half a step of 1/200 cycle on each side.
    tolerance = 2 * (0.5 / 200 + 2 / SAMPLES * (exposure_cycles + 1)) / (exposure_cycles * duty)
    assert contrast(exposure_cycles * 1000, 1000, duty) == pytest.approx(swing, abs=tolerance)


@pytest.mark.parametrize(("exposure_cycles", "duty"), [(0.163, 0.5), (1.37, 0.5), (12.459, 0.5), (0.4, 0.3)])
def test_harmonics_are_those_of_the_integrated_wave(exposure_cycles: float, duty: float) -> None:
    """The Fourier transform of the numerically integrated wave has the same amplitudes over the mean."""
    spectrum = np.abs(np.fft.rfft(integrated_wave(exposure_cycles, duty)))
    for harmonic in (1, 2, 3, 5):
        expected = 2 * spectrum[harmonic] / spectrum[0]
        amplitude = harmonic_amplitude(harmonic, exposure_cycles * 1000, 1000, duty)
        assert amplitude == pytest.approx(expected, abs=5e-4)


def test_band_width_by_hand() -> None:
    """480 rows scanned in 16.1616 ms at 1250 Hz: 29700 rows a second over 2500 edges a second, 11.88 rows."""
    assert band_width_rows(1250, rows=480, scan_time_s=0.0161616) == pytest.approx(11.88, abs=5e-5)


@pytest.mark.parametrize(
    ("frequency_hz", "period_us", "expected"),
    # The last is the current driver's: 504 rows of 1852 clocks at 58.333 MHz, 20.0016 cycles
    [(100, 12500, 0.25), (100, 17500, -0.25), (1000, 20000, 0), (1250, 504 * 1852 / (175 / 3), 0.0016)],
)
def test_phase_advance_by_hand(frequency_hz: float, period_us: float, expected: float) -> None:
    """1.25 cycles are a quarter ahead, 1.75 a quarter back, 20 not at all."""
    assert phase_advance_cycles(frequency_hz, period_us) == pytest.approx(expected, abs=2e-5)


@pytest.mark.parametrize(("row", "expected_ns"), [(0, 995_000_000), (100, 998_367_000), (239.5, 1_003_063_965)])
def test_mid_exposure_of_a_row_by_hand(row: float, expected_ns: int) -> None:
    """Half the exposure before the row's read-out, which comes row · 33.67 µs after row 0's."""
    frame = Frame(
        pixels=np.zeros((4, 4), np.uint8),
        seq=0,
        row0_readout_ns=1_000_000_000,
        exposure_us=10000,
        row_time_us=33.67,
        transfer="linear",
    )
    assert row_mid_exposure_ns(frame, row) == expected_ns
