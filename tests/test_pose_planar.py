"""The pose of a square: checked against a projection written out here, and OpenCV's own reading of the marker frame."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from decode_material import LENS, PINHOLE, reason

from ledpi.pose.planar import solve_square, square_corners
from ledpi.records import Floats, Intrinsics, PlanarSolution

SIDE_M = 0.16
SIGMA_PX = 0.05


def turn(axis: str, degrees: float) -> Floats:
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    return {
        "x": np.array([[1, 0, 0], [0, c, -s], [0, s, c]]),
        "y": np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]),
        "z": np.array([[c, -s, 0], [s, c, 0], [0, 0, 1.0]]),
    }[axis]


FACING = np.diag([1.0, -1.0, -1.0])  # x as the camera's, y up, z back at it


def pixels(points_m: Floats, rotation: Floats, position_m: Floats, lens: Intrinsics) -> Floats:
    """The pinhole and OpenCV's distortion, equation by equation (OpenCV's manual, calib3d)."""
    x, y, z = rotation @ points_m.T + np.asarray(position_m)[:, None]
    x, y = x / z, y / z
    k1, k2, p1, p2, k3 = lens.distortion
    r2 = x * x + y * y
    radial = 1 + k1 * r2 + k2 * r2**2 + k3 * r2**3
    seen_x = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x)
    seen_y = y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y
    return np.column_stack([lens.fx * seen_x + lens.cx, lens.fy * seen_y + lens.cy])


def marker_corners(side_m: float = SIDE_M) -> Floats:
    """Top left, top right, bottom right, bottom left of the marker, x right and y up in it."""
    h = side_m / 2
    return np.array([[-h, h, 0], [h, h, 0], [h, -h, 0], [-h, -h, 0.0]])


def matrix_of(quaternion_wxyz: Floats) -> Floats:
    """By Rodrigues' formula from the axis and the angle that the quaternion holds."""
    w, *xyz = quaternion_wxyz
    axis = np.array(xyz)
    length = np.linalg.norm(axis)
    angle = 2 * math.atan2(float(length), w)
    return np.asarray(cv2.Rodrigues(axis / max(float(length), 1e-12) * angle)[0])


def solve(
    corners: Floats, lens: Intrinsics = PINHOLE, *, side_m: float = SIDE_M, sigma_px: float = SIGMA_PX
) -> tuple[PlanarSolution, PlanarSolution | None]:
    solved = solve_square(corners, sigma_px, side_m, lens)
    assert isinstance(solved, tuple), reason(solved)
    return solved


POSES = [
    (turn("y", 40) @ FACING, (0.1, -0.05, 0.7)),
    (turn("y", -65) @ turn("x", 10) @ FACING, (-0.2, 0.1, 0.9)),
    (turn("x", 35) @ FACING @ turn("z", 30), (0.0, 0.0, 0.5)),
    (turn("y", 25) @ FACING @ turn("z", 180), (0.25, 0.15, 1.0)),
    (turn("y", -30) @ turn("x", 20) @ FACING @ turn("z", -100), (-0.1, 0.1, 0.8)),
    (turn("x", -15) @ FACING @ turn("z", 135), (0.1, 0.0, 0.6)),
]


def test_the_marker_frame_is_opencvs() -> None:
    """Centre, x right, y up, z out of the panel; corners in the order of OpenCV's ArUco, top left first."""
    np.testing.assert_allclose(
        square_corners(0.2), [[-0.1, 0.1, 0], [0.1, 0.1, 0], [0.1, -0.1, 0], [-0.1, -0.1, 0]]
    )


@pytest.mark.parametrize("lens", [PINHOLE, LENS], ids=["pinhole", "distorted"])
@pytest.mark.parametrize(("rotation", "position"), POSES)
def test_exact_corners_give_the_exact_pose(
    rotation: Floats, position: tuple[float, float, float], lens: Intrinsics
) -> None:
    """camera_from_marker to 0.1 mm and 0.02°, and no residual to speak of, also of half a turn about any axis."""
    best, _ = solve(pixels(marker_corners(), rotation, np.array(position), lens), lens)
    pose = best.camera_from_marker
    np.testing.assert_allclose(pose.position_m, position, rtol=0, atol=1e-4)
    apart = matrix_of(pose.quaternion_wxyz) @ rotation.T
    assert math.degrees(math.acos(min(1.0, (np.trace(apart) - 1) / 2))) < 0.02
    assert best.reprojection_px < 1e-3


@pytest.mark.parametrize("lens", [PINHOLE, LENS], ids=["pinhole", "distorted"])
def test_the_pose_projects_the_square_onto_the_corners(lens: Intrinsics) -> None:
    """Through the projection above; what is left over is what `reprojection_px` says, rms over the corners."""
    rotation, position = POSES[0]
    corners = pixels(marker_corners(), rotation, np.array(position), lens)
    corners += np.array([[0.3, -0.2], [-0.1, 0.2], [0.25, 0.1], [-0.3, -0.1]])
    best, _ = solve(corners, lens)
    pose = best.camera_from_marker
    seen = pixels(marker_corners(), matrix_of(pose.quaternion_wxyz), pose.position_m, lens)
    rms = math.sqrt(np.mean(np.square(seen - corners).sum(axis=1)))
    assert 0.05 < rms < 0.4
    assert best.reprojection_px == pytest.approx(rms, rel=1e-3)


def test_a_larger_panel_is_further_away() -> None:
    """The same corners at twice the side: twice the distance, the same rotation."""
    rotation, position = POSES[0]
    corners = pixels(marker_corners(), rotation, np.array(position), PINHOLE)
    small, large = (solve(corners, side_m=side)[0].camera_from_marker for side in (0.16, 0.32))
    np.testing.assert_allclose(large.position_m, 2 * small.position_m, rtol=1e-4)
    np.testing.assert_allclose(large.quaternion_wxyz, small.quaternion_wxyz, atol=1e-4)


def test_the_order_of_the_corners_turns_the_marker() -> None:
    """The panel hung a quarter turn clockwise: its top left corner is seen top right, its x points down."""
    corners = pixels(marker_corners(), turn("y", 30) @ FACING, np.array([0, 0, 0.8]), PINHOLE)
    best, _ = solve(np.roll(corners, -1, axis=0))
    x_axis = matrix_of(best.camera_from_marker.quaternion_wxyz)[:, 0]
    np.testing.assert_allclose(x_axis, [0, 1, 0], atol=1e-3)


def test_nearly_frontal_and_distant_the_other_pose_is_kept() -> None:
    """5 m away and turned by 10°, a tenth of a pixel cannot tell left from right: both poses are given."""
    corners = pixels(marker_corners(), turn("y", 10) @ FACING, np.array([0, 0, 5.0]), PINHOLE)
    best, alternate = solve(corners)
    assert alternate is not None
    assert best.reprojection_px <= alternate.reprojection_px
    normals = sorted(matrix_of(s.camera_from_marker.quaternion_wxyz)[0, 2] for s in (best, alternate))
    # Turned to one side or, mirrored about the line of sight, to the other.
    np.testing.assert_allclose(normals, [-math.sin(math.radians(10)), math.sin(math.radians(10))], atol=0.02)


def test_close_and_oblique_the_other_pose_is_excluded() -> None:
    """0.5 m away and turned by 50°, perspective shows which side is nearer by many pixels."""
    corners = pixels(marker_corners(), turn("y", 50) @ FACING, np.array([0, 0, 0.5]), PINHOLE)
    _, alternate = solve(corners)
    assert alternate is None


def test_what_cannot_be_excluded_depends_on_the_corners_errors() -> None:
    """A pose that sharp corners decide stays open where the corners are known to 3 px only."""
    corners = pixels(marker_corners(), turn("y", 40) @ FACING, np.array([0.2, 0.1, 1.2]), PINHOLE)
    assert solve(corners, sigma_px=0.05)[1] is None
    assert solve(corners, sigma_px=3.0)[1] is not None


@pytest.mark.parametrize("seed", range(5))
def test_of_noisy_corners_one_of_the_two_poses_is_right(seed: int) -> None:
    """At 2 m with 0.1 px of noise: the true rotation is within 6° of the best pose or of the alternate."""
    rotation = turn("y", 25) @ turn("x", 8) @ FACING
    corners = pixels(marker_corners(), rotation, np.array([0.1, 0, 2.0]), PINHOLE)
    noise = 0.1 * np.random.default_rng(seed).standard_normal((4, 2))
    solutions = [s for s in solve(corners + noise, sigma_px=0.1) if s is not None]
    traces = [np.trace(matrix_of(s.camera_from_marker.quaternion_wxyz) @ rotation.T) for s in solutions]
    assert math.degrees(math.acos(min(1.0, (max(traces) - 1) / 2))) < 6


def test_corners_on_a_line_give_a_reason_not_a_pose() -> None:
    """A square seen exactly from the side shows nothing of itself; numbers that are none never come out."""
    line = np.array([[300.0, 200], [340, 200], [340, 200], [300, 200]])
    solved = solve_square(line, SIGMA_PX, SIDE_M, PINHOLE)
    assert reason(solved) == "pose.unsolved"


def test_poses_cannot_be_changed() -> None:
    """They flow through several threads."""
    corners = pixels(marker_corners(), POSES[0][0], np.array(POSES[0][1]), PINHOLE)
    best, _ = solve(corners)
    with pytest.raises(ValueError, match="read-only"):
        best.camera_from_marker.position_m[0] = 1.0
