"""A side may be off by more than the fit says: by rims that are written down here."""

from __future__ import annotations

import numpy as np
import pytest

from ledpi.core.records import Floats
from ledpi.decode.model.fit import ASLANT, side_covariance
from ledpi.decode.model.prior import COMMON, GAP, OWN, RIM
from tests.builders.decode import square

CELL_PX = 20.0
LATTICE = square(100, 100, 4 * CELL_PX)
NOTHING = np.zeros(4)


def deviations(*rims: float, gap: float = 0.1, hidden: Floats = NOTHING, variance: float = 0.0) -> Floats:
    """(4, 2) px of the corners, as rims left, right, above and below, in cells, leave them open."""
    unknown = np.zeros(COMMON + 16 * OWN)
    unknown[GAP], unknown[RIM : RIM + 4] = gap, rims
    return np.sqrt(np.diag(side_covariance(LATTICE, unknown, variance * np.ones(4), hidden, 4)).reshape(4, 2))


@pytest.mark.parametrize("rim", [0.0, 0.05])
def test_of_a_panel_that_is_built_alike_all_around_nothing_is_open(rim: float) -> None:
    """Light ends with the lattice; or half a wall before it, where cells are of one size."""
    np.testing.assert_allclose(deviations(rim, rim, rim, rim), 0.0, atol=1e-9)


def test_a_side_that_ends_further_within_may_be_hidden_as_much() -> None:
    """A strip of 0.05 cells before the right side: its corners may be that much further right, and none elsewhere."""
    px = deviations(0.0, 0.05, 0.0, 0.0)
    np.testing.assert_array_equal(px[[0, 3]], 0.0)
    np.testing.assert_array_equal(px[:, 1], 0.0)
    assert (px[[1, 2], 0] > 0.05 * CELL_PX).all()
    assert (px[[1, 2], 0] < 2 * 0.05 * CELL_PX).all()


def test_what_noise_moves_of_a_rim_leaves_nothing_open() -> None:
    """The fit's own covariance has it; what is beyond is open still."""
    np.testing.assert_array_equal(deviations(0.0, 0.05, 0.0, 0.0, variance=0.05**2), 0.0)
    left_open = deviations(0.0, 0.05, 0.0, 0.0, variance=0.03**2)
    np.testing.assert_allclose(left_open, deviations(0.0, 0.04, 0.0, 0.0))


def test_so_may_one_that_ends_further_without() -> None:
    """Something bright touches it."""
    np.testing.assert_allclose(deviations(0.0, -0.05, 0.0, 0.0), deviations(0.0, 0.05, 0.0, 0.0))


def test_all_sides_may_be_off_together() -> None:
    """No panel is built so: all sides 0.03 cells outward, and its size is as uncertain."""
    unknown = np.zeros(COMMON + 16 * OWN)
    unknown[GAP], unknown[RIM : RIM + 4] = 0.1, -0.03
    outward = (np.sign(LATTICE - LATTICE.mean(axis=0)) * 0.03 * CELL_PX).ravel()
    covariance = side_covariance(LATTICE, unknown, NOTHING, NOTHING, 4) + 1e-9 * np.eye(8)
    assert outward @ np.linalg.solve(covariance, outward) < 1.0


def test_a_hidden_side_may_be_drawn_aslant() -> None:
    """By what hides it at an angle: either end by itself, whatever its rim."""
    px = deviations(0.0, 0.4, 0.0, 0.0, hidden=np.array([0.0, 0.4, 0.0, 0.0]))
    np.testing.assert_allclose(px[[1, 2], 0], ASLANT * CELL_PX)
    np.testing.assert_array_equal(px[[0, 3]], 0.0)
