"""Poses as WPILib has them: a camera with x ahead, y left, z up; a tag with x out of it, z up. Pure."""

from __future__ import annotations

from typing import Any

import numpy as np

from ledpi.core.geometry import (
    CAMERA_LINK_FROM_CAMERA,
    FACING_FROM_MARKER,
    matrix_from_quaternion,
    quaternion_from_matrix,
)
from ledpi.core.records import Floats, Pose


def pose_of(values: dict[str, Any]) -> Pose:
    """The pose of a marker, an alternate or a robot of the tap, as a record."""
    covariance = values.get("covariance")
    return Pose(
        position_m=np.array(values["position_m"]),
        quaternion_wxyz=np.array(values["quaternion_wxyz"]),
        covariance=None if covariance is None else np.array(covariance).reshape(6, 6),
    )


def camera_link_from_tag(camera_from_marker: Pose) -> Pose:
    """The same pose in WPILib's frames; its covariance is turned likewise."""
    turn = CAMERA_LINK_FROM_CAMERA
    rotation = turn @ matrix_from_quaternion(camera_from_marker.quaternion_wxyz) @ FACING_FROM_MARKER.T
    covariance = camera_from_marker.covariance
    return Pose(
        position_m=turn @ camera_from_marker.position_m,
        quaternion_wxyz=quaternion_from_matrix(rotation),
        covariance=None if covariance is None else _both(turn) @ covariance @ _both(turn).T,
    )


def _both(rotation: Floats) -> Floats:
    """(6, 6) the rotation of positions and of rotations."""
    both = np.zeros((6, 6))
    both[:3, :3] = both[3:, 3:] = rotation
    return both
