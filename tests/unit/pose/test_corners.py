"""Knowledge of four corners, with squares that are written down here."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ledpi.core.records import Detection, Floats
from ledpi.pose.corners import (
    FLOOR_PX,
    SPEED_SIGMA_M_S,
    TURN_SIGMA_RAD_S,
    centre_px,
    corners_at,
    corners_at_row,
    velocity_covariance,
    whiteners,
)
from tests.builders.decode import LENS
from tests.builders.map import frame as made_frame

UPRIGHT = np.array([[100.0, 50], [180, 50], [180, 130], [100, 130]])


def test_the_centre_is_where_the_diagonals_cross() -> None:
    """Not the mean of the corners: of a panel seen from the side the nearer half is larger."""
    assert centre_px(UPRIGHT) == (140.0, 90.0)
    trapezium = np.array([[0.0, 0], [30, 10], [30, 20], [0, 30]])
    assert centre_px(trapezium) == pytest.approx((22.5, 15.0))


def test_corners_are_brought_to_one_rows_time() -> None:
    """At 300 px/s to the right and 40 µs a row, the corners 40 rows above the middle are 0.48 px behind."""
    velocity = np.tile([300.0, 0.0], (4, 1))
    moved = corners_at_row(UPRIGHT, velocity, 90.0, 40.0)
    np.testing.assert_allclose(moved - UPRIGHT, [[0.48, 0], [0.48, 0], [-0.48, 0], [-0.48, 0]])
    # Without a velocity, as of a first detection, they stay.
    assert corners_at_row(UPRIGHT, None, 90.0, 40.0) is UPRIGHT


def test_errors_are_made_independent() -> None:
    """Takes any covariance: what is whitened has the deviation 1, and what the fit does not show is in it."""
    rng = np.random.default_rng(2)
    spread = 0.1 * rng.normal(size=(8, 8))
    covariance = spread @ spread.T
    (whiten,) = whiteners(covariance[None])
    total = covariance + FLOOR_PX**2 * np.eye(8)
    np.testing.assert_allclose(whiten @ total @ whiten.T, np.eye(8), atol=1e-9)


def test_a_size_that_is_not_known_weighs_little() -> None:
    """All corners outward alike by 0.2 px of deviation: such an error is one deviation, any other is many."""
    outward = (UPRIGHT - UPRIGHT.mean(axis=0)).ravel()
    outward *= 0.2 / np.abs(outward)
    (whiten,) = whiteners(np.outer(outward, outward)[None])
    assert np.linalg.norm(whiten @ outward) == pytest.approx(1.0, rel=0.01)
    aside = np.tile([0.2, 0.0], 4)
    assert np.linalg.norm(whiten @ aside) == pytest.approx(2 * 0.2 / FLOOR_PX)


def test_an_unknown_motion_moves_corners_by_the_slopes_of_their_picture() -> None:
    """Central differences of a square that faces the camera 2 m ahead and aside, by each of the six motions."""
    square = np.array([[0.52, -0.48, 2.0], [0.68, -0.48, 2.0], [0.68, -0.32, 2.0], [0.52, -0.32, 2.0]])

    def seen_after(motion: Floats) -> Floats:
        points = square - motion[:3] - np.cross(motion[3:], square)
        return np.asarray(points[:, :2] / points[:, 2:] * (LENS.fx, LENS.fy) + (LENS.cx, LENS.cy)).ravel()

    little = 1e-5 * np.diag([SPEED_SIGMA_M_S] * 3 + [TURN_SIGMA_RAD_S] * 3)
    slopes = np.array([seen_after(step) - seen_after(-step) for step in little]) / 2e-5
    expected = slopes.T @ slopes
    np.testing.assert_allclose(
        velocity_covariance(seen_after(np.zeros(6)).reshape(4, 2), 0.16, LENS), expected, atol=1e-6 * expected.max()
    )


def moved(velocity_px_s: Floats | None, sigma_px_s: float = 6.0) -> Floats:
    """(8,) by how many pixels the motion between rows may have moved each coordinate of a square 80 px high."""
    seen = Detection(
        id=7,
        corners_px=UPRIGHT,
        covariance_px2=np.zeros((8, 8)),
        margin=30.0,
        frames_used=2,
        velocity_px_s=velocity_px_s,
        velocity_covariance=None if velocity_px_s is None else sigma_px_s**2 * np.eye(8),
    )
    _, (covariance,) = corners_at(made_frame(), np.array([90.0]), [seen], [0.16], LENS)
    return np.asarray(np.sqrt(np.diag(covariance)))


def test_a_velocity_that_was_measured_leaves_little_open() -> None:
    """40 rows of 33.67 µs from the middle, of ±6 px/s; where none was measured, 100 times as much."""
    late_s = 40 * 33.67e-6
    np.testing.assert_allclose(moved(np.tile([500.0, 0.0], (4, 1))), late_s * 6.0, rtol=1e-6)
    assert (moved(None) > 100 * late_s * 6.0).all()


def test_a_velocity_that_no_camera_causes_is_not_believed() -> None:
    """The upper side alone moves, by 9 px within a frame: one of the two fits was off, and no motion is known."""
    np.testing.assert_array_equal(moved(np.array([[0.0, -540.0], [0, -540], [0, 0], [0, 0]])), moved(None))


def mean_velocity_px_s(blur_px: float | None, exposure_us: float) -> float:
    """Deviation of how quickly the square as a whole may move aside, in a first frame that is blurred so much."""
    seen = Detection(
        id=7,
        corners_px=UPRIGHT,
        covariance_px2=np.zeros((8, 8)),
        margin=30.0,
        frames_used=1,
        blur_px=None if blur_px is None else np.full(2, blur_px),
    )
    far_rows, along = 1e6, np.tile([0.25, 0.0], 4)  # all corners are as late then
    frame = replace(made_frame(), exposure_us=exposure_us)
    _, (covariance,) = corners_at(frame, np.array([-far_rows]), [seen], [0.16], LENS)
    return float(np.sqrt(along @ covariance @ along) / (far_rows * frame.row_time_us * 1e-6))


def test_what_is_hardly_blurred_has_hardly_moved() -> None:
    """At v·T of 2.8 px within 10 ms it would be blurred by 0.8 px. In 150 µs no robot moves as far."""
    unknown = mean_velocity_px_s(None, 10_000.0)
    assert unknown > 700.0
    assert mean_velocity_px_s(0.8, 10_000.0) == pytest.approx((unknown**-2 + 277.0**-2) ** -0.5, rel=0.01)
    assert mean_velocity_px_s(0.8, 150.0) == pytest.approx(unknown, rel=0.01)
