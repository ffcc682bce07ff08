"""The JSON object of a frame: the keys of the documentation, no more and no fewer, whatever was seen."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest

from ledpi.core.records import Decoded, Detection, Floats, MarkerPose, PlanarSolution, Pose, Rejected, RobotFix
from ledpi.pipeline.output import decoded_as_json

FRAME_KEYS = ["recording", "seq", "sensor_timestamp_ns", "decode_ms", "markers", "robot", "rejected"]
MARKER_KEYS = [
    "id",
    "corners_px",
    "margin",
    "frames_used",
    "position_m",
    "quaternion_wxyz",
    "covariance",
    "reprojection_px",
    "alternate",
]
ALTERNATE_KEYS = ["position_m", "quaternion_wxyz", "reprojection_px"]
ROBOT_KEYS = ["position_m", "quaternion_wxyz", "covariance", "panels_used", "panels_rejected"]
CORNERS = np.array([[10.25, 20.5], [110.125, 21.0], [109.0, 121.0], [9.5, 119.75]])


def pose(covariance: Floats | None = None) -> Pose:
    return Pose(
        position_m=np.array([0.1, -0.2, 1.5]), quaternion_wxyz=np.array([0.0, 1.0, 0.0, 0.0]), covariance=covariance
    )


def marker(
    solution: PlanarSolution | None = None, alternate: PlanarSolution | None = None, margin: float = 14.25
) -> MarkerPose:
    return MarkerPose(
        detection=Detection(id=7, corners_px=CORNERS, covariance_px2=0.01 * np.eye(8), margin=margin, frames_used=4),
        mid_exposure_ns=0,
        solution=solution,
        alternate=alternate,
    )


def printed(
    *markers: MarkerPose, robot: RobotFix | None = None, rejected: tuple[Rejected, ...] = (), name: str = "static/d0.6"
) -> dict[str, Any]:
    """The fields that a reader of the printed line gets."""
    decoded = Decoded(
        seq=3,
        row0_readout_ns=1_010_000_000,
        host_offset_ns=99,
        markers=markers,
        robot=robot,
        rejected=rejected,
        stage_ms={"find": 1.25, "fit": 0.5},
    )
    line = json.dumps(decoded_as_json(decoded, name), allow_nan=False)
    read: dict[str, Any] = json.loads(line)
    return read


def test_a_frame_has_the_documented_keys() -> None:
    """In the documented order, also where nothing was seen."""
    frame = printed()
    assert list(frame) == FRAME_KEYS
    assert frame == {
        "recording": "static/d0.6",
        "seq": 3,
        "sensor_timestamp_ns": 1_010_000_000,
        "decode_ms": 1.75,
        "markers": [],
        "robot": None,
        "rejected": {},
    }


def test_a_marker_has_the_documented_keys() -> None:
    """Calibrated, with one pose."""
    (seen,) = printed(marker(PlanarSolution(camera_from_marker=pose(), reprojection_px=0.125, chi2=1.0)))["markers"]
    assert list(seen) == MARKER_KEYS
    assert seen["id"] == 7
    assert seen["corners_px"] == CORNERS.tolist()
    assert (seen["margin"], seen["frames_used"], seen["reprojection_px"]) == (14.25, 4, 0.125)
    assert seen["position_m"] == [0.1, -0.2, 1.5]
    assert seen["quaternion_wxyz"] == [0.0, 1.0, 0.0, 0.0]
    assert seen["covariance"] is None
    assert seen["alternate"] is None


def test_without_intrinsics_the_pose_is_null() -> None:
    """The keys are there all the same."""
    (seen,) = printed(marker())["markers"]
    assert list(seen) == MARKER_KEYS
    assert {key for key, value in seen.items() if value is None} == {
        "position_m",
        "quaternion_wxyz",
        "covariance",
        "reprojection_px",
        "alternate",
    }


def test_the_other_pose_is_reported_where_it_cannot_be_excluded() -> None:
    """With the same keys as the first."""
    one = PlanarSolution(camera_from_marker=pose(), reprojection_px=0.1, chi2=1.0)
    other = PlanarSolution(camera_from_marker=pose(), reprojection_px=0.25, chi2=1.0)
    (seen,) = printed(marker(one, other))["markers"]
    assert list(seen["alternate"]) == ALTERNATE_KEYS
    assert seen["alternate"]["reprojection_px"] == 0.25


def test_a_covariance_is_36_numbers_row_by_row() -> None:
    """As ROS: x y z, then the rotation about x y z."""
    matrix = np.diag([1e-6, 2e-6, 3e-5, 4e-4, 5e-4, 6e-4])
    matrix[0, 2] = matrix[2, 0] = 1.5e-6
    solved = PlanarSolution(camera_from_marker=pose(matrix), reprojection_px=0.1, chi2=1.0)
    (seen,) = printed(marker(solved))["markers"]
    assert len(seen["covariance"]) == 36
    np.testing.assert_allclose(np.reshape(seen["covariance"], (6, 6)), matrix, rtol=1e-5)


def test_a_robots_fix_has_the_documented_keys() -> None:
    """map_from_base_link, and which panels it is from."""
    fix = RobotFix(map_from_base_link=pose(np.eye(6)), mid_exposure_ns=0, panels_used=(7, 23), panels_rejected=(4,))
    robot = printed(robot=fix)["robot"]
    assert list(robot) == ROBOT_KEYS
    assert (robot["panels_used"], robot["panels_rejected"]) == ([7, 23], [4])
    assert robot["position_m"] == [0.1, -0.2, 1.5]
    assert len(robot["covariance"]) == 36


def test_rejections_are_counted_by_stage_and_reason() -> None:
    """In alphabetic order, so that two runs can be compared line by line."""
    small, bands = Rejected(stage="find", reason="too_small"), Rejected(stage="identify", reason="no_bands")
    frame = printed(rejected=(bands, small, small))
    assert list(frame["rejected"].items()) == [("find.too_small", 2), ("identify.no_bands", 1)]


@pytest.mark.parametrize(("value", "shown"), [(14.123456, 14.12), (703.5, 703.5), (-2.0, -2.0)])
def test_numbers_are_no_longer_than_they_mean(value: float, shown: float) -> None:
    """A margin to a hundredth."""
    assert printed(marker(margin=value))["markers"][0]["margin"] == shown
