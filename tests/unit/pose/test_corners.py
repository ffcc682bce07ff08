"""What is known of four corners, with squares that are written down here."""

from __future__ import annotations

import numpy as np
import pytest

from ledpi.pose.corners import FLOOR_PX, centre_px, seen_at_row, whiteners

UPRIGHT = np.array([[100.0, 50], [180, 50], [180, 130], [100, 130]])


def test_the_centre_is_where_the_diagonals_cross() -> None:
    """Not the mean of the corners: of a panel seen from the side the nearer half is larger."""
    assert centre_px(UPRIGHT) == (140.0, 90.0)
    trapezium = np.array([[0.0, 0], [30, 10], [30, 20], [0, 30]])
    assert centre_px(trapezium) == pytest.approx((22.5, 15.0))


def test_corners_are_brought_to_one_rows_time() -> None:
    """At 300 px/s to the right and 40 µs a row, the corners 40 rows above the middle are 0.48 px behind."""
    velocity = np.tile([300.0, 0.0], (4, 1))
    moved = seen_at_row(UPRIGHT, velocity, 90.0, 40.0)
    np.testing.assert_allclose(moved - UPRIGHT, [[0.48, 0], [0.48, 0], [-0.48, 0], [-0.48, 0]])


def test_without_a_velocity_corners_stay() -> None:
    """A first sighting."""
    assert seen_at_row(UPRIGHT, None, 90.0, 40.0) is UPRIGHT


@pytest.mark.parametrize("sigma_px", [0.05, 0.4])
def test_errors_of_sides_are_made_independent(sigma_px: float) -> None:
    """A side that is shifted by its deviation, and one that is turned by it, are 1 each, and nothing else."""
    whiten = whiteners(UPRIGHT[None], np.array([sigma_px]), np.zeros(1))[0]
    down_by_shift = np.zeros((4, 2))
    down_by_shift[:2, 1] = np.hypot(sigma_px / 2, FLOOR_PX)  # the upper side
    np.testing.assert_allclose(np.abs(whiten @ down_by_shift.ravel())[[0, 4, 2, 6]], [1, 0, 0, 0], atol=1e-12)
    turned = np.zeros((4, 2))
    turned[0, 1], turned[1, 1] = (sign * np.hypot(np.sqrt(3) * sigma_px / 2, FLOOR_PX) for sign in (-1, 1))
    np.testing.assert_allclose(np.abs(whiten @ turned.ravel())[[0, 4, 2, 6]], [0, 1, 0, 0], atol=1e-12)


def test_a_side_that_motion_blurs_widely_may_be_elsewhere() -> None:
    """5 px to the right during an exposure: the left and right sides by 1.25 px, the upper and lower ones as before."""
    sigmas = np.array([0.05]), np.zeros(1)
    still = whiteners(UPRIGHT[None], *sigmas)[0]
    blurred = whiteners(UPRIGHT[None], *sigmas, np.tile([5.0, 0.0], (1, 4, 1)))[0]
    np.testing.assert_allclose(blurred[[0, 2, 4, 5, 6, 7]], still[[0, 2, 4, 5, 6, 7]])
    moved_right = np.zeros((4, 2))
    moved_right[1:3, 0] = 1.25  # the right side
    assert abs(blurred[1] @ moved_right.ravel()) == pytest.approx(1.0, rel=0.01)
    slower = whiteners(UPRIGHT[None], *sigmas, np.tile([3.0, 0.0], (1, 4, 1)))[0]
    np.testing.assert_allclose(slower, still)


@pytest.mark.parametrize("sigma_px", [0.3, 0.5])
def test_the_sides_of_a_square_share_the_error_of_its_size(sigma_px: float) -> None:
    """The covariance of the four sides' shifts is that of each, and 0.3² px² in all of its places."""
    whiten = whiteners(UPRIGHT[None], np.array([sigma_px]), np.array([0.3]))[0]
    outward = np.zeros((4, 8))  # of a side's middle: half of either end's
    for side, (one, other, sign) in enumerate([(1, 3, -1), (2, 4, 1), (5, 7, 1), (6, 0, -1)]):
        outward[side, [one, other]] = sign / 2
    shifts = outward @ np.linalg.inv(whiten.T @ whiten) @ outward.T
    own = (sigma_px**2 - 0.3**2) / 4 + FLOOR_PX**2
    np.testing.assert_allclose(shifts, own * np.eye(4) + 0.3**2, atol=1e-9)


def test_a_square_seen_from_the_side_grows_about_its_centre() -> None:
    """Half as wide as high: its left and right sides move half as far, and that is one deviation and no turn."""
    narrow = np.array([[100.0, 50], [140, 50], [140, 130], [100, 130]])
    whiten = whiteners(narrow[None], np.array([2.0]), np.array([2.0]))[0]
    mean_px = 2.0 / ((20 + 40) / 2)  # of the distances from the centre
    grown = whiten @ (mean_px * (narrow - (120, 90))).ravel()
    assert np.square(grown[:4]).sum() == pytest.approx(1.0, rel=0.01)
    np.testing.assert_allclose(grown[4:], 0.0, atol=1e-9)
