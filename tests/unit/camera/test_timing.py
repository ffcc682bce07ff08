"""Which frame period keeps the bands moving, and what counts as an exposure that was honoured."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ledpi.camera.timing import (
    MIN_PHASE_ADVANCE_CYCLES,
    choose_frame_length_rows,
    exposure_honoured,
    frame_duration_us,
)

CLASSES_HZ = (1250.0, 2450.0)
PERCENT = np.linspace(-0.01, 0.01, 9).tolist()


def advance(frequency_hz: float, period_us: float) -> float:
    cycles = frequency_hz * period_us * 1e-6
    return abs(cycles - round(cycles))


def test_the_bound_is_where_a_difference_is_as_deep_as_a_frame() -> None:
    """A sine that advances by the bound differs from itself by a sine of its own amplitude."""
    x = np.linspace(0, 2 * math.pi, 10_001)
    step = np.sin(x + 2 * math.pi * MIN_PHASE_ADVANCE_CYCLES) - np.sin(x)
    assert step.max() == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize(
    ("shortest", "frequencies_hz", "rows"),
    [
        # 504 rows advance 1256 Hz by 21.3139 cycles and 2450 Hz by 41.5757: nothing is missing.
        (504, (1256.0, 2450.0), 504),
        # 504 + r rows advance 1250 Hz by 0.2121 + 0.0421·r and 2050 Hz by −0.2121 + 0.0690·r: alike, but for the sign,
        # so that far away no frame tells them apart. 2050 Hz stands still until r = 6, with 0.2020 and 0.4647.
        (504, (1250.0, 2050.0), 510),
        # One class of two panels may advance alike: 21.3804 and 21.3976 cycles.
        (508, (1250.0, 1251.0), 508),
    ],
    ids=["moving", "alike", "one class"],
)
def test_a_few_rows_more_set_phases_moving(shortest: int, frequencies_hz: tuple[float, ...], rows: int) -> None:
    """By hand, at 33.67 µs a row; no more than it takes."""
    assert rows == choose_frame_length_rows(shortest_rows=shortest, row_time_us=33.67, frequencies_hz=frequencies_hz)


@pytest.mark.parametrize("row_time_us", [31.75, 33.67])
def test_oscillators_that_are_off_do_not_stop_both_classes(row_time_us: float) -> None:
    """1237.5 and 2474.5 Hz, both 1 % off, stand still in 504 rows of 33.67 µs: 21.0000 and 41.9915 cycles."""
    off = [(CLASSES_HZ[0] * (1 + one), CLASSES_HZ[1] * (1 + other)) for one in PERCENT for other in PERCENT]
    assert max(advance(f, 504 * 33.67) for f in (1237.5, 2474.5)) < 0.01
    rows = choose_frame_length_rows(shortest_rows=504, row_time_us=row_time_us, frequencies_hz=CLASSES_HZ)
    assert all(max(advance(f, rows * row_time_us) for f in pair) >= 1 / 12 for pair in off)


@pytest.mark.parametrize("seed", range(5))
def test_all_frequencies_move_and_no_frame_much_shorter_would_do(seed: int) -> None:
    """For random rows and frequencies the answer suits every class; each a tenth shorter fails in some class."""
    random = np.random.default_rng(seed)
    row_us = float(random.uniform(18, 40))
    frequencies = tuple(random.uniform(300, 4000, 3))
    rows = choose_frame_length_rows(shortest_rows=504, row_time_us=row_us, frequencies_hz=frequencies)
    assert all(advance(f, rows * row_us) >= MIN_PHASE_ADVANCE_CYCLES for f in frequencies)
    for shorter in range(504, int(rows / 1.1)):
        assert any(advance(f, shorter * row_us) < MIN_PHASE_ADVANCE_CYCLES for f in frequencies)


@pytest.mark.parametrize("row_us", [33.6727, 31.7486, 21.17, 20.0])
def test_libcamera_rounds_the_asked_duration_to_the_wanted_rows(row_us: float) -> None:
    """Rounding down with the true row time gives the rows wanted, though ours came from whole µs."""
    ours_us = math.floor(504 * row_us) / 504
    for rows in range(504, 900):
        assert math.floor(frame_duration_us(rows, ours_us) / row_us) == rows


@pytest.mark.parametrize(
    ("reported_us", "honoured"),
    [(10000, True), (9967, True), (9966, True), (9965, False), (10001, False), (33, False)],
)
def test_exposures_within_one_row_below_are_honoured(reported_us: int, honoured: bool) -> None:
    """10 ms of 33.67 µs rows: 296 rows, 9966.3 µs, reported as 9966; one row less, or any more, is not it."""
    assert exposure_honoured(asked_us=10000.0, reported_us=reported_us, row_time_us=33.67) is honoured
