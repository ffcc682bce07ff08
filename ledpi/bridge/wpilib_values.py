"""A frame as WPILib's values, for NetworkTables and for data logs. docs/networktables.md has their names. Pure."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from typing import Literal, NamedTuple

from ledpi.bridge.target import Line
from ledpi.bridge.wpilib_poses import camera_link_from_tag, pose_of
from ledpi.core.records import Pose
from ledpi.wire.message import wire_pose

# WPILib's schemas of what is packed below, for dashboards to show it.
SCHEMAS = {
    "Translation3d": "double x;double y;double z",
    "Quaternion": "double w;double x;double y;double z",
    "Rotation3d": "Quaternion q",
    "Pose3d": "Translation3d translation;Rotation3d rotation",
}
_POSE3D = struct.Struct("<7d")


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
