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


def test_frozen_phases_cost_a_few_rows() -> None:
    """OV5647 at 31.75 µs a row: 504 rows advance 1250 Hz by 20.0025 cycles; eight rows more set it moving.

    By hand, advances at 504 + r rows: 0.0025 + 0.0396875·r and 0.2049 + 0.0777875·r. 1/6 needs r = 5, and 1/12 more
    than the 0.20 by which 1250 Hz may be off needs r = 8. There 2450 Hz has 0.8272, which is 0.1728 backwards.
    """
    rows = choose_frame_length_rows(shortest_rows=504, row_time_us=31.75, frequencies_hz=CLASSES_HZ)
    assert rows == 512


def test_the_shortest_frame_is_kept_where_phases_move() -> None:
    """At 33.67 µs a row 504 rows advance 1256 Hz by 21.3139 cycles and 2450 Hz by 41.5757: nothing is missing."""
    rows = choose_frame_length_rows(shortest_rows=504, row_time_us=33.67, frequencies_hz=(1256.0, 2450.0))
    assert rows == 504


@pytest.mark.parametrize("row_time_us", [31.75, 33.67])
def test_oscillators_that_are_off_do_not_stop_both_classes(row_time_us: float) -> None:
    """1237.5 and 2474.5 Hz, both 1 % off, stand still in 504 rows of 33.67 µs: 21.0000 and 41.9915 cycles."""
    off = [(CLASSES_HZ[0] * (1 + one), CLASSES_HZ[1] * (1 + other)) for one in PERCENT for other in PERCENT]
    assert max(advance(f, 504 * 33.67) for f in (1237.5, 2474.5)) < 0.01
    rows = choose_frame_length_rows(shortest_rows=504, row_time_us=row_time_us, frequencies_hz=CLASSES_HZ)
    assert all(max(advance(f, rows * row_time_us) for f in pair) >= 1 / 12 for pair in off)


def test_classes_that_advance_alike_cost_a_few_rows() -> None:
    """In 504 rows of 33.67 µs 1250 Hz advances by +0.21 cycles, 2050 Hz by −0.21: far away no frame tells them apart.

    By hand, advances at 504 + r rows: 0.2121 + 0.0421·r and −0.2121 + 0.0690·r. 2050 Hz stands still until r = 6, where
    it has 0.2020 and 1250 Hz 0.4647.
    """
    rows = choose_frame_length_rows(shortest_rows=504, row_time_us=33.67, frequencies_hz=(1250.0, 2050.0))
    assert rows == 510


def test_panels_that_differ_a_little_may_advance_alike() -> None:
    """1250 and 1251 Hz are one class of two panels; 508 rows advance them by 21.3804 and 21.3976 cycles."""
    rows = choose_frame_length_rows(shortest_rows=508, row_time_us=33.67, frequencies_hz=(1250.0, 1251.0))
    assert rows == 508


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


def test_no_suitable_frame_is_said() -> None:
    """A frequency with a whole number of cycles in each row stands still in every frame."""
    with pytest.raises(ValueError, match=r"the phases of 40000 Hz all moving; set camera.frame_duration_us"):
        choose_frame_length_rows(shortest_rows=504, row_time_us=25.0, frequencies_hz=(40_000.0,))


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
