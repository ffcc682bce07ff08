"""A frame as WPILib's values and poses, for NetworkTables and data logs: docs/networktables.md names them. Pure."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Any, Literal, NamedTuple

import numpy as np

from ledpi.core.geometry import (
    CAMERA_LINK_FROM_CAMERA,
    FACING_FROM_MARKER,
    matrix_from_quaternion,
    quaternion_from_matrix,
)
from ledpi.core.records import Floats, Pose
from ledpi.links.target import Line
from ledpi.wire.message import wire_pose

# WPILib's schemas of what is packed below, for dashboards to show it.
SCHEMAS = {
    "Translation3d": "double x;double y;double z",
    "Quaternion": "double w;double x;double y;double z",
    "Rotation3d": "Quaternion q",
    "Pose3d": "Translation3d translation;Rotation3d rotation",
}
_POSE3D = struct.Struct("<7d")


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


class Value(NamedTuple):
    """One of a frame."""

    name: str
    kind: Literal["Raw", "DoubleArray", "IntegerArray"]  # Raw: a packed Pose3d
    value: bytes | list[float] | list[int]
    exposed_ns: int  # when it was true, CLOCK_MONOTONIC


def frame_values(frame: Line) -> Iterator[Value]:
    """The values of a `decoded` line. A panel whose pose may be its mirror image has none."""
    for marker in frame["markers"]:
        if marker["position_m"] is not None and marker["alternate"] is None:
            yield from _pose(f"panels/{marker['id']}", camera_link_from_tag(pose_of(marker)), marker)
    if frame["robot"] is not None:
        yield from _pose("robot", pose_of(frame["robot"]), frame["robot"])
    yield Value("ids", "IntegerArray", [marker["id"] for marker in frame["markers"]], int(frame["exposed_ns"]))


def _pose(name: str, pose: Pose, of: Line) -> Iterator[Value]:
    """The deviations first, so that they are there when the pose is."""
    exposed_ns, wire = int(of["exposed_ns"]), wire_pose(pose)
    if wire.deviation_m is not None and wire.deviation_rad is not None:
        yield Value(f"{name}/std_devs", "DoubleArray", [*wire.deviation_m, *wire.deviation_rad], exposed_ns)
    yield Value(f"{name}/pose", "Raw", _POSE3D.pack(*wire.position_m, *wire.quaternion_wxyz), exposed_ns)
