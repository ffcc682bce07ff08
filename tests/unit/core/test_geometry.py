"""Rotations and squares in perspective, against OpenCV's own functions and what is known by hand."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from ledpi.core.geometry import (
    box,
    corners_apart,
    matrix_from_quaternion,
    project_to_quad,
    quaternion_from_matrix,
    rotation_angle_deg,
)
from ledpi.core.records import Floats

HALF = math.sqrt(0.5)

# (axis × angle in degrees, quaternion w x y z)
KNOWN = [
    ((0, 0, 0), (1, 0, 0, 0)),
    ((0, 0, 90), (HALF, 0, 0, HALF)),
    ((0, -90, 0), (HALF, 0, -HALF, 0)),
    ((60, 0, 0), (math.cos(math.pi / 6), 0.5, 0, 0)),
    ((180, 0, 0), (0, 1, 0, 0)),
    ((0, 180, 0), (0, 0, 1, 0)),
    ((0, 0, 180), (0, 0, 0, 1)),
]


def rodrigues(vector: Floats) -> Floats:
    return np.asarray(cv2.Rodrigues(vector)[0], dtype=np.float64)


def random_rotation_vectors(count: int) -> list[Floats]:
    """Axis × angle in radians, angles up to a half turn, the very small and the very large among them."""
    random = np.random.default_rng(7)
    axes = random.normal(size=(count, 3))
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    extremes = [1e-9, 1e-4, math.pi - 1e-4, math.pi - 1e-9]
    angles = np.concatenate([random.uniform(0, math.pi, count - 4), extremes])
    return list(axes * angles[:, None])


@pytest.mark.parametrize(("axis_angle_deg", "quaternion"), KNOWN)
def test_known_rotations(axis_angle_deg: tuple[int, ...], quaternion: tuple[float, ...]) -> None:
    """Rotations about single axes have the quaternions that one writes down by hand."""
    matrix = rodrigues(np.radians(np.array(axis_angle_deg, dtype=float)))
    np.testing.assert_allclose(quaternion_from_matrix(matrix), quaternion, atol=1e-12)
    np.testing.assert_allclose(matrix_from_quaternion(np.array(quaternion)), matrix, atol=1e-12)


def test_rotations_are_those_of_opencv() -> None:
    """cos and sin of half the angle, and the matrix that cv2.Rodrigues makes of the same vector."""
    for vector in random_rotation_vectors(60):
        angle = float(np.linalg.norm(vector))
        expected = np.array([math.cos(angle / 2), *(math.sin(angle / 2) * vector / angle)])
        matrix = rodrigues(vector)
        np.testing.assert_allclose(quaternion_from_matrix(matrix), expected, rtol=0, atol=1e-8)
        np.testing.assert_allclose(matrix_from_quaternion(expected), matrix, rtol=0, atol=1e-9)


def test_a_quaternion_of_any_length_is_a_rotation() -> None:
    """The length does not matter, but there must be one."""
    np.testing.assert_allclose(
        matrix_from_quaternion(np.array([3.0, 0, 0, 3.0])), [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-12
    )
    with pytest.raises(ValueError, match="length zero"):
        matrix_from_quaternion(np.zeros(4))


def test_angle_between_rotations_by_hand() -> None:
    """90° from the identity to a quarter turn; a quaternion and its negative are the same rotation."""
    identity, quarter = np.array([1.0, 0, 0, 0]), np.array([HALF, 0, 0, HALF])
    assert rotation_angle_deg(identity, quarter) == pytest.approx(90)
    assert rotation_angle_deg(identity, -quarter) == pytest.approx(90)
    assert rotation_angle_deg(quarter, -quarter) == pytest.approx(0, abs=1e-5)


def test_a_small_angle_between_rounded_quaternions() -> None:
    """A truth of six digits is a millionth too long, and the angle is still the one between them: 0.02°."""
    a = np.array([0.083410, -0.995565, 0.041817, 0.011986])
    half = np.radians(0.01)
    b = np.cos(half) * a + np.sin(half) * np.array([0.995565, 0.083410, 0.011986, -0.041817])
    assert rotation_angle_deg(1.000001 * a, 0.999999 * b) == pytest.approx(0.02, rel=1e-6)


def test_the_middle_of_a_square_is_where_its_diagonals_cross() -> None:
    """Lies, in a trapezium with sides of 4 and 2, 3 high, two thirds from the longer to the shorter; corners stay."""
    corners = np.array([[1.0, 0.0], [3.0, 0.0], [4.0, 3.0], [0.0, 3.0]])
    assert project_to_quad(corners, np.array([[0.5, 0.5]])) == pytest.approx(np.array([[2.0, 1.0]]))
    assert project_to_quad(corners, box(0, 0, 1, 1)) == pytest.approx(corners)


def test_corners_are_apart_by_the_one_that_is_furthest_from_all_others() -> None:
    """One corner is off by (3, 4); the order in which either square has them does not matter."""
    one, other = [[0, 0], [10, 0], [10, 10], [0, 10]], [[10, 10], [0, 10], [-3, -4], [10, 0]]
    assert corners_apart(one, other) == corners_apart(other, one) == 5.0
