"""Poses from the core are least squares: held against finite differences of OpenCV's projection."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from ledpi.core.geometry import matrix_from_quaternion
from ledpi.core.records import Floats, Intrinsics, Rejected
from ledpi.pose.corners import independent, whiteners
from ledpi.pose.planar import FREEDOM, SURPRISING, solve_squares, square_corners
from ledpi.pose.refine import BEATEN_BY, CONVERGED, fit_body
from tests.builders.decode import LENS, PINHOLE, seen_through, square

UPSIDE_DOWN = np.diag([1.0, -1, -1])  # a panel that faces the camera


def left_over(turn: Floats, at: Floats, points: Floats, seen: Floats, weights: Floats, lens: Intrinsics) -> Floats:
    """(2P,) whitened residuals of points (P, 3) seen at (P, 2)."""
    camera = lens.matrix(), np.array(lens.distortion)
    pixels = cv2.projectPoints(points @ turn.T + at, np.zeros(3), np.zeros(3), *camera)[0].reshape(-1, 2)
    return np.asarray((weights @ (seen - pixels).reshape(-1, 8, 1)).ravel())


def normal_equations(turn: Floats, at: Floats, *given: object) -> tuple[Floats, Floats]:
    """Information (6, 6) and pull (6,) by position and turn, from finite differences. A radian is not known at all."""
    columns = []
    for way in 1e-6 * np.eye(6):
        ends = [
            left_over(cv2.Rodrigues(sign * way[3:])[0] @ turn, at + sign * way[:3], *given)  # type: ignore[arg-type]
            for sign in (1, -1)
        ]
        columns.append((ends[1] - ends[0]) / 2e-6)
    slopes = np.stack(columns, axis=1)
    information = slopes.T @ slopes + np.diag([0, 0, 0, 1, 1, 1])
    return information, slopes.T @ left_over(turn, at, *given)  # type: ignore[arg-type]


@pytest.mark.parametrize("lens", [PINHOLE, LENS])
def test_poses_of_squares_are_least_squares(lens: Intrinsics) -> None:
    """Near and far, face on and oblique, upside down, with errors that hang together: no step would gain."""
    rng, gains = np.random.default_rng(6), []
    for number in range(40):
        turn = cv2.Rodrigues(rng.normal(size=3) * [0.6, 0.6, 2.0])[0] @ UPSIDE_DOWN
        at = turn @ square_corners(0.16).T + np.array([[0.1], [-0.1], [1.0]]) * rng.uniform(0.5, 6)
        corners = seen_through(lens, (at[:2] / at[2]).T * (lens.fx, lens.fy) + (lens.cx, lens.cy))
        corners += rng.normal(0, 0.1, corners.shape)
        spread = rng.normal(0, 0.05, (8, 8)) * (number % 2)
        covariance_px2 = (independent(0.1) + spread @ spread.T)[None]
        weights = whiteners(covariance_px2)
        (solutions,) = solve_squares(corners[None], covariance_px2, [0.16], lens)
        assert isinstance(solutions, tuple)
        sure = 1 + max(0.0, solutions[0].chi2 - SURPRISING) / FREEDOM
        for solution in solutions:
            pose = solution.camera_from_marker
            place = matrix_from_quaternion(pose.quaternion_wxyz), pose.position_m
            given = square_corners(0.16), corners, weights, lens
            assert solution.chi2 == pytest.approx(np.square(left_over(*place, *given)).sum(), rel=1e-6)
            information, pull = normal_equations(*place, *given)
            if solution.chi2 > solutions[0].chi2 + BEATEN_BY:
                continue
            gains.append(float(np.linalg.solve(information, pull) @ pull) / (1 + solution.chi2))
            if gains[-1] < CONVERGED:
                root = np.linalg.cholesky(sure * np.linalg.inv(information))
                half = np.linalg.solve(root, pose.covariance)
                *others, widest = np.linalg.eigvalsh(np.linalg.solve(root, half.T))
                np.testing.assert_allclose(others, 1.0, atol=0.02)
                assert 0.98 < widest < 4.02  # towards the other pose it may be
    assert np.quantile(gains, 0.9) < CONVERGED  # the others' rounds were up


@pytest.mark.parametrize("starts", [1, 2, 5])
def test_poses_of_a_body_are_least_squares(starts: int) -> None:
    """Three squares that hang together, from poses near the true one; of more starts the two likeliest."""
    rng = np.random.default_rng(starts)
    turn = cv2.Rodrigues(np.array([0.2, -0.3, 0.1]))[0] @ UPSIDE_DOWN
    points = np.concatenate([square_corners(0.16) + shift for shift in ([0, 0, 0], [0.5, 0.1, 0.2], [-0.4, 0.2, 0.1])])
    at = turn @ points.T + np.array([[0.1], [-0.1], [2.0]])
    seen = seen_through(LENS, (at[:2] / at[2]).T * (LENS.fx, LENS.fy) + (LENS.cx, LENS.cy))
    seen += rng.normal(0, 0.1, seen.shape)
    weights = whiteners(np.array([independent(sigma) for sigma in (0.05, 0.1, 0.2)]))
    rotations = np.array([cv2.Rodrigues(rng.normal(0, 0.1, 3))[0] @ turn for _ in range(starts)])
    positions = np.array([0.1, -0.1, 2.0]) + rng.normal(0, 0.05, (starts, 3))
    fits = fit_body(rotations, positions, points, seen, weights, LENS, at_most=2)
    assert len(fits.chi2) == min(starts, 2)
    for k, (chi2, covariance) in enumerate(zip(fits.chi2, fits.covariances, strict=True)):
        place = fits.rotations[k], fits.positions[k]
        given = points, seen, weights, LENS
        assert chi2 == pytest.approx(np.square(left_over(*place, *given)).sum(), rel=1e-6)
        information, pull = normal_equations(*place, *given)
        assert np.linalg.solve(information, pull) @ pull < CONVERGED * (1 + chi2)
        expected = np.linalg.inv(information)
        np.testing.assert_allclose(covariance, expected, rtol=0.05, atol=0.02 * expected.max())


def test_corners_without_a_pose_have_none() -> None:
    """All in one place, in a line, nowhere; between others that have one."""
    corners = np.stack([square(300, 200, 50), np.full((4, 2), 9.0), np.full((4, 2), np.nan), square(100, 200, 50)])
    corners[1, :, 0] = [0, 1, 2, 3]
    found = solve_squares(corners, np.tile(independent(0.1), (4, 1, 1)), [0.16] * 4, PINHOLE)
    assert [isinstance(solutions, Rejected) for solutions in found] == [False, True, True, False]
