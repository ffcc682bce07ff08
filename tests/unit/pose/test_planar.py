"""The pose of a square: checked against a projection written out here, and OpenCV's own reading of the marker frame."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from ledpi.core.records import Detection, Floats, Intrinsics, Rejected
from ledpi.pose.corners import corners_at, independent
from ledpi.pose.planar import Solutions, solve_square, solve_squares
from tests.builders.decode import LENS, PINHOLE, reason
from tests.builders.map import covariance_px2, frame, with_errors

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
) -> Solutions:
    return solved(solve_square(corners, independent(sigma_px), side_m, lens))


def solved(answer: Solutions | Rejected) -> Solutions:
    assert isinstance(answer, tuple), reason(answer)
    return answer


def angle_deg(quaternion_wxyz: Floats, rotation: Floats) -> float:
    cosine = (np.trace(matrix_of(quaternion_wxyz) @ rotation.T) - 1) / 2
    return math.degrees(math.acos(max(-1.0, min(1.0, cosine))))


POSES = [
    (turn("y", 40) @ FACING, (0.1, -0.05, 0.7)),
    (turn("y", -65) @ turn("x", 10) @ FACING, (-0.2, 0.1, 0.9)),
    (turn("x", 35) @ FACING @ turn("z", 30), (0.0, 0.0, 0.5)),
    (turn("y", 25) @ FACING @ turn("z", 180), (0.25, 0.15, 1.0)),
    (turn("y", -30) @ turn("x", 20) @ FACING @ turn("z", -100), (-0.1, 0.1, 0.8)),
    (turn("x", -15) @ FACING @ turn("z", 135), (0.1, 0.0, 0.6)),
]


@pytest.mark.parametrize("lens", [PINHOLE, LENS], ids=["pinhole", "distorted"])
@pytest.mark.parametrize(("rotation", "position"), POSES)
def test_exact_corners_give_the_exact_pose(
    rotation: Floats, position: tuple[float, float, float], lens: Intrinsics
) -> None:
    """To 0.1 mm and 0.02°, and no residual to speak of, also of half a turn; twice as far of a panel twice as large."""
    corners = pixels(marker_corners(), rotation, np.array(position), lens)
    best = solve(corners, lens)[0]
    pose = best.camera_from_marker
    np.testing.assert_allclose(pose.position_m, position, rtol=0, atol=1e-4)
    assert angle_deg(pose.quaternion_wxyz, rotation) < 0.02
    assert best.reprojection_px < 1e-3
    larger = solve(corners, lens, side_m=2 * SIDE_M)[0].camera_from_marker
    np.testing.assert_allclose(larger.position_m, 2 * np.array(position), rtol=0, atol=2e-4)
    with pytest.raises(ValueError, match="read-only"):  # they flow through several threads
        pose.position_m[0] = 1.0


@pytest.mark.parametrize("lens", [PINHOLE, LENS], ids=["pinhole", "distorted"])
def test_the_pose_projects_the_square_onto_the_corners(lens: Intrinsics) -> None:
    """Through the projection above; what is left over is what `reprojection_px` says, rms over the corners."""
    rotation, position = POSES[0]
    corners = pixels(marker_corners(), rotation, np.array(position), lens)
    corners += np.array([[0.3, -0.2], [-0.1, 0.2], [0.25, 0.1], [-0.3, -0.1]])
    best = solve(corners, lens)[0]
    pose = best.camera_from_marker
    seen = pixels(marker_corners(), matrix_of(pose.quaternion_wxyz), pose.position_m, lens)
    rms = math.sqrt(np.mean(np.square(seen - corners).sum(axis=1)))
    assert 0.05 < rms < 0.4
    assert best.reprojection_px == pytest.approx(rms, rel=1e-3)


def test_the_order_of_the_corners_turns_the_marker() -> None:
    """The panel hung a quarter turn clockwise: its top left corner is seen top right, its x points down."""
    corners = pixels(marker_corners(), turn("y", 30) @ FACING, np.array([0, 0, 0.8]), PINHOLE)
    best = solve(np.roll(corners, -1, axis=0))[0]
    x_axis = matrix_of(best.camera_from_marker.quaternion_wxyz)[:, 0]
    np.testing.assert_allclose(x_axis, [0, 1, 0], atol=1e-3)


def test_nearly_frontal_and_distant_both_poses_fit() -> None:
    """5 m away and turned by 10°: the pose and its mirror image about the line of sight, the better first."""
    corners = pixels(marker_corners(), turn("y", 10) @ FACING, np.array([0, 0, 5.0]), PINHOLE)
    best, other = solve(corners)
    assert best.chi2 <= other.chi2 < 3
    normals = sorted(matrix_of(s.camera_from_marker.quaternion_wxyz)[0, 2] for s in (best, other))
    np.testing.assert_allclose(normals, [-math.sin(math.radians(10)), math.sin(math.radians(10))], atol=0.02)


def test_a_pose_half_way_to_the_best_is_not_another() -> None:
    """Here the mirror pose is no minimum: followed, it slides into the best one, and is not reported just beside it."""
    corners = pixels(marker_corners(), turn("y", 10) @ turn("x", 20) @ FACING, np.array([0.05, 0.03, 0.5]), PINHOLE)
    best, *others = solve(corners)
    assert best.chi2 < 1e-6
    assert all(other.chi2 > 60 for other in others)


def test_how_badly_a_pose_fits_depends_on_the_corners_errors() -> None:
    """Finds what sharp corners exclude as good as the other where they are known to 3 px only; near by it is not."""
    corners = pixels(marker_corners(), turn("y", 40) @ FACING, np.array([0.2, 0.1, 1.2]), PINHOLE)
    assert solve(corners, sigma_px=0.05)[1].chi2 > 100
    assert solve(corners, sigma_px=3.0)[1].chi2 < 10
    close = pixels(marker_corners(), turn("y", 50) @ FACING, np.array([0, 0, 0.5]), PINHOLE)
    best, other = solve(close)
    assert other.chi2 > best.chi2 + 1000
    assert other.reprojection_px > 5


@pytest.mark.parametrize(
    ("rotation", "position", "sigma_px"),
    [
        (turn("y", 40) @ turn("x", 5) @ FACING, (0.1, -0.05, 0.6), 0.05),
        (turn("y", 50) @ FACING, (0.1, -0.05, 1.0), 0.1),
        (turn("y", -70) @ turn("x", 5) @ FACING, (-0.1, 0.1, 0.6), 0.06),
        (FACING @ turn("z", 30), (0.1, -0.05, 0.6), 0.05),
        (turn("x", 45) @ FACING, (0.2, 0.1, 3.0), 0.05),
    ],
)
def test_errors_are_as_large_as_the_covariance_says(
    rotation: Floats, position: tuple[float, float, float], sigma_px: float
) -> None:
    """1,000 draws: the mean of eᵀ·covariance⁻¹·e within the 95 % band of a χ² of 6, each deviation within 7 %."""
    rng = np.random.default_rng(1)
    exact = pixels(marker_corners(), rotation, np.array(position), LENS)
    covariance = covariance_px2(exact, sigma_px)
    errors, nees = np.empty((1000, 6)), np.empty(1000)
    reported = np.zeros(6)
    for i in range(1000):
        pose = solved(solve_square(with_errors(exact, rng, sigma_px), covariance, SIDE_M, LENS))[0].camera_from_marker
        assert pose.covariance is not None
        turned_by = cv2.Rodrigues(matrix_of(pose.quaternion_wxyz) @ rotation.T)[0][:, 0]
        errors[i] = np.concatenate([pose.position_m - position, turned_by])
        nees[i] = errors[i] @ np.linalg.solve(pose.covariance, errors[i])
        reported += np.diag(pose.covariance) / 1000
    # χ² of 6000 degrees of freedom is normal by then: mean 6000, variance 12000.
    assert abs(nees.mean() - 6) < 1.96 * math.sqrt(12000) / 1000
    np.testing.assert_allclose(np.sqrt(np.mean(errors**2, axis=0) / reported), 1.0, atol=0.07)


@pytest.mark.parametrize(("distance_m", "tilt_deg"), [(2.0, 0.0), (3.0, 0.0), (3.0, 6.0), (5.0, 0.0)])
def test_deviations_hold_where_a_square_is_seen_nearly_face_on(distance_m: float, tilt_deg: float) -> None:
    """400 draws: beyond what a χ² of 6 exceeds once in a thousand is one in fifty at most, of the nearer solution."""
    rng, beyond = np.random.default_rng(3), 0
    for _ in range(400):
        rotation = turn("y", tilt_deg) @ FACING @ turn("z", rng.uniform(0, 90))
        position = distance_m * np.array([rng.uniform(-0.3, 0.3), rng.uniform(-0.2, 0.2), 1.0])
        exact = pixels(marker_corners(), rotation, position, PINHOLE)
        covariance = covariance_px2(exact, 0.15)
        found = solved(solve_square(with_errors(exact, rng, 0.15), covariance, SIDE_M, PINHOLE))
        nees = []
        for pose in (solution.camera_from_marker for solution in found):
            assert pose.covariance is not None
            turned_by = cv2.Rodrigues(matrix_of(pose.quaternion_wxyz) @ rotation.T)[0][:, 0]
            error = np.concatenate([pose.position_m - position, turned_by])
            nees.append(error @ np.linalg.solve(pose.covariance, error))
        beyond += min(nees) > 22.5
    assert beyond <= 8


def test_an_error_of_the_size_is_one_of_the_distance() -> None:
    """Square on at 1 m, all sides outward alike by 0.2 px or so: of the side's half as much as of the distance."""
    corners = pixels(marker_corners(), FACING, np.array([0.0, 0.0, 1.0]), PINHOLE)
    outward = 0.2 * np.sign(corners - corners.mean(axis=0)).ravel()
    covariances = []
    for size in (0.0, 1.0):
        covariance = independent(SIGMA_PX) + size * np.outer(outward, outward)
        pose = solved(solve_square(corners, covariance, SIDE_M, PINHOLE))[0].camera_from_marker
        assert pose.covariance is not None
        covariances.append(pose.covariance)
    half_px = PINHOLE.fx * SIDE_M / 2
    more = covariances[1][2, 2] - covariances[0][2, 2]
    assert math.sqrt(more) == pytest.approx(0.2 / half_px, rel=0.01)
    np.testing.assert_allclose(np.diag(covariances[1])[:2], np.diag(covariances[0])[:2], rtol=0.01)


def test_corners_that_no_pose_explains_inflate_the_covariance() -> None:
    """Seen by a moving camera, of which a frame alone knows nothing: sheared by 3 px, and the distance is off."""
    corners = pixels(marker_corners(), FACING, np.array([0.0, 0.0, 0.6]), PINHOLE)
    corners[:, 0] += 3.0 * (corners[:, 1] - corners[:, 1].mean()) / np.ptp(corners[:, 1])
    pose = solve(corners, sigma_px=0.05)[0].camera_from_marker
    assert pose.covariance is not None
    turned = cv2.Rodrigues(matrix_of(pose.quaternion_wxyz) @ FACING.T)[0][:, 0]
    off = np.concatenate([pose.position_m - (0, 0, 0.6), turned])
    assert np.abs(off).max() > 1e-3
    assert (np.abs(off) < 3 * np.sqrt(np.diag(pose.covariance))).all()


def test_many_squares_are_solved_as_each_alone() -> None:
    """Together only because it is quicker; and one that cannot be solved does not spoil the others."""
    seen = [pixels(marker_corners(), rotation, np.array(position), LENS) for rotation, position in POSES]
    seen.insert(2, np.array([[300.0, 200], [340, 200], [340, 200], [300, 200]]))
    together = solve_squares(np.array(seen), np.tile(independent(SIGMA_PX), (7, 1, 1)), [SIDE_M] * 7, LENS)
    assert isinstance(together[2], Rejected)
    for corners, solutions in zip(seen, together, strict=True):
        alone = solve_square(corners, independent(SIGMA_PX), SIDE_M, LENS)
        if isinstance(solutions, Rejected):
            assert solutions == alone
            continue
        assert isinstance(alone, tuple)
        best, best_alone = (found[0].camera_from_marker for found in (solutions, alone))
        np.testing.assert_allclose(best.position_m, best_alone.position_m, atol=1e-6)


ASLANT = np.array([[0.0, 1.0], [0.0, -1.0], [0.0, 0.0], [0.0, 0.0]])  # how corners move where a side turns


@pytest.mark.parametrize("sigma_px", [0.03, 0.3])
def test_a_quad_that_no_pose_explains_is_none(sigma_px: float) -> None:
    """At 2 m a side of 51 px is 12 px aslant: 2.5 px are left, however exact corners are said to be.

    Nor has a kite a pose, that no square looks like from anywhere, nor a square that is seen exactly from the side.
    """
    corners = pixels(marker_corners(), turn("y", 20) @ FACING, np.array([0.0, 0.0, 2.0]), PINHOLE)
    kite = np.array([[300.0, 200], [340, 180], [420, 260], [310, 240]])
    line = np.array([[300.0, 200], [340, 200], [340, 200], [300, 200]])
    answers = [solve_square(c, independent(sigma_px), SIDE_M, PINHOLE) for c in (corners + 6 * ASLANT, kite, line)]
    assert [reason(answer) for answer in answers] == ["pose.not_square", "pose.not_square", "pose.unsolved"]


def test_what_no_pose_explains_makes_the_mirror_pose_likelier() -> None:
    """Excludes no other pose of corners that err by 1 px in such a way; and deviations grow."""
    corners = pixels(marker_corners(), turn("y", 20) @ FACING, np.array([0.0, 0.0, 2.0]), PINHOLE)
    assert solve(corners)[1].chi2 > 100
    best, other = solve(corners + 2 * ASLANT)
    assert other.chi2 - best.chi2 < 13.8
    assert best.camera_from_marker.covariance is not None
    sigma_deg = math.degrees(math.sqrt(np.trace(best.camera_from_marker.covariance[3:, 3:])))
    assert angle_deg(best.camera_from_marker.quaternion_wxyz, turn("y", 20) @ FACING) < 1.5 * sigma_deg


def test_a_motion_that_is_not_known_is_found_beside_the_pose() -> None:
    """1,000 squares sheared by 2 rad/s, which robots' motions allow for: the pose that explains it is found."""
    rng, chi2 = np.random.default_rng(0), []
    for _ in range(1000):
        yaw, pitch, roll = rng.uniform(-60, 60), rng.uniform(-20, 20), rng.uniform(-30, 30)
        place = rng.uniform(0.5, 1.4) * np.array([rng.uniform(-0.25, 0.25), rng.uniform(-0.17, 0.17), 1.0])
        corners = pixels(marker_corners(), turn("y", yaw) @ turn("x", pitch) @ turn("z", roll) @ FACING, place, LENS)
        row = corners[:, 1].mean()
        corners[:, 0] -= 2.0 * LENS.fx * (corners[:, 1] - row) * 33.67e-6
        seen = Detection(id=7, corners_px=corners, covariance_px2=independent(0.05), margin=30.0, frames_used=1)
        moved, covariances = corners_at(frame(), np.array([row]), [seen], [SIDE_M], LENS)
        chi2.append(solved(solve_square(moved[0], covariances[0], SIDE_M, LENS))[0].chi2)
    assert max(chi2) < 9.2


def test_a_single_minimum_has_a_mirror_pose_too() -> None:
    """Gives both signs of the turn, where corners may be outward alike and only perspective tells it."""
    corners = pixels(marker_corners(), turn("y", 12) @ FACING, np.array([0.0, 0.0, 4.0]), PINHOLE)
    outward = (corners - corners.mean(axis=0)).ravel() / 20
    covariance = independent(0.1) + np.outer(outward * np.tile([1, 0], 4), outward * np.tile([1, 0], 4))
    found = solved(solve_square(corners, covariance, SIDE_M, PINHOLE))
    normals = sorted(matrix_of(s.camera_from_marker.quaternion_wxyz)[0, 2] for s in found)
    np.testing.assert_allclose(normals, [-math.sin(math.radians(12)), math.sin(math.radians(12))], atol=0.05)
    assert found[1].chi2 - found[0].chi2 < 13.8


def test_what_is_not_known_of_corners_makes_them_no_less_square() -> None:
    """A lower right corner that may be anywhere along a line, and is 9 px off along it: a pose, and not a sure one."""
    corners = pixels(marker_corners(), turn("y", 20) @ FACING, np.array([0.0, 0.0, 1.0]), PINHOLE)
    off = np.zeros(8)
    off[4:6] = 9.0 / math.sqrt(2)
    near = solve_square(corners + off.reshape(4, 2), independent(SIGMA_PX), SIDE_M, PINHOLE)
    open_line = solve_square(corners + off.reshape(4, 2), independent(SIGMA_PX) + np.outer(off, off), SIDE_M, PINHOLE)
    assert isinstance(near, tuple)
    assert isinstance(open_line, tuple)
    side_px = PINHOLE.fx * SIDE_M / 1.0
    assert near[0].reprojection_px < 0.04 * side_px < open_line[0].reprojection_px
    assert angle_deg(open_line[0].camera_from_marker.quaternion_wxyz, turn("y", 20) @ FACING) < 1.0
