"""How often something flat is seen with the shape that it is seen with: what tells a panel from a part of one."""

from __future__ import annotations

import cmath
import math

import numpy as np
import pytest

from ledpi.decode.identify.tilt import LEAST_TILT, log_chance_of_tilt
from ledpi.geometry import matrix_from_rotation_vector

SQUARE, OF_PART = (1, 1), (3, 2)


def seen(width: float, height: float, tilt_deg: float, axis_deg: float) -> tuple[complex, complex]:
    """Sides, from far away, of something so large that is turned about an axis in its own plane."""
    axis = math.radians(axis_deg)
    turn = matrix_from_rotation_vector(math.radians(tilt_deg) * np.array([math.cos(axis), math.sin(axis), 0.0]))
    return complex(*(width * turn[:2, 0])), complex(*(height * turn[:2, 1]))


@pytest.mark.parametrize("axis_deg", [0.0, 30.0, 45.0, 90.0])
@pytest.mark.parametrize("tilt_deg", [20.0, 48.2, 75.0])
def test_a_tilt_is_as_frequent_as_its_cotangent_squared(tilt_deg: float, axis_deg: float) -> None:
    """Whatever it is turned about, and however many cells it has."""
    expected = -2.0 * math.log(math.tan(math.radians(tilt_deg)))
    assert log_chance_of_tilt(seen(1, 1, tilt_deg, axis_deg), SQUARE) == pytest.approx(expected)
    assert log_chance_of_tilt(seen(3, 2, tilt_deg, axis_deg), OF_PART) == pytest.approx(expected)


def test_chances_are_those_of_directions_that_are_all_alike() -> None:
    """Of 400,000 squares and as many of three by two cells, facing anywhere: how many are seen 1.3 times as wide."""
    rng, count, seen_so = np.random.default_rng(1), 400_000, []
    for width, height in (SQUARE, OF_PART):
        shorter, axes = 1.0 - rng.uniform(size=count), rng.uniform(0.0, np.pi, count)
        x, y = -np.sin(axes), np.cos(axes)  # along which it looks shorter
        across = width * (1.0 - shorter * x * x) - 1j * width * shorter * x * y
        down = -height * shorter * x * y + 1j * height * (1.0 - shorter * y * y)
        ratio, skew = np.abs(across / down), (across.conjugate() * down).real / np.abs(across * down)
        seen_so.append(np.count_nonzero((ratio > 1.25) & (ratio < 1.35) & (np.abs(skew) < 0.04)))
    sides = (1.3 + 0j, 1j)
    expected = log_chance_of_tilt(sides, SQUARE) - log_chance_of_tilt(sides, OF_PART)
    assert math.log(seen_so[0] / seen_so[1]) == pytest.approx(expected, abs=0.15)


def test_turns_and_sizes_in_the_picture_do_not_count() -> None:
    """What is rolled, or further off, is as frequent."""
    across, down = seen(1, 1, 40.0, 25.0)
    turned = 17.0 * cmath.rect(1.0, 0.7)
    assert log_chance_of_tilt((across * turned, down * turned), SQUARE) == pytest.approx(
        log_chance_of_tilt((across, down), SQUARE)
    )


def test_what_is_seen_from_the_front_is_no_surer_than_its_sides() -> None:
    """The chance would grow without bound."""
    assert log_chance_of_tilt((1 + 0j, 1j), SQUARE) == pytest.approx(-2.0 * math.log(LEAST_TILT))
    assert log_chance_of_tilt((1.5 + 0j, 1j), OF_PART) == pytest.approx(-2.0 * math.log(LEAST_TILT))


def test_a_line_shows_nothing_flat() -> None:
    """Seen from the edge; no number is divided by nothing."""
    assert log_chance_of_tilt((1 + 0j, 2 + 0j), SQUARE) < -20.0
