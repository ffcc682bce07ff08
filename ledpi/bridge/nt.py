"""`kind: nt`: NetworkTables 4, by WPILib's own ntcore. docs/networktables.md has the topics and a robot program.

Each value carries the time at which its pose was true, on NetworkTables' clock, which client and server keep equal.
"""

from __future__ import annotations

import struct
import time
from typing import Any

import ntcore
import numpy as np

from ledpi.bridge.payload import pose_of
from ledpi.bridge.target import Line, TargetLostError
from ledpi.config.outputs import OutputSettings
from ledpi.core.geometry import (
    CAMERA_LINK_FROM_CAMERA,
    FACING_FROM_MARKER,
    matrix_from_quaternion,
    quaternion_from_matrix,
)
from ledpi.core.records import Floats, Pose
from ledpi.wire.message import wire_pose

OPEN_S = 0.25  # that one look for the server takes; ntcore itself goes on looking
IDENTITY = "ledpi"
# WPILib's schemas of what is packed below, for dashboards to show it.
SCHEMAS = {
    "Translation3d": "double x;double y;double z",
    "Quaternion": "double w;double x;double y;double z",
    "Rotation3d": "Quaternion q",
    "Pose3d": "Translation3d translation;Rotation3d rotation",
}
POSE3D = struct.Struct("<7d")


class NtTarget:
    """One server: a robot's, or a simulation's."""

    def __init__(self, settings: OutputSettings) -> None:
        self._address = settings.address
        self._where = "{}:{}".format(*settings.address)
        self._table = f"/{settings.topic}"
        self._instance: Any = None
        self._publishers: dict[str, Any] = {}

    def open(self) -> None:
        if self._instance is None:
            self._instance = ntcore.NetworkTableInstance.create()
            self._instance.setServer(*self._address)
            self._instance.startClient4(IDENTITY)
            for name, schema in SCHEMAS.items():
                self._instance.addSchema(f"struct:{name}", "structschema", schema)
        until_s = time.monotonic() + OPEN_S
        while not self._instance.isConnected():
            if time.monotonic() > until_s:
                raise TargetLostError(f"{self._where}: no NetworkTables server answers; are host and port right?")
            time.sleep(0.01)

    def tell_setup(self, hello: Line) -> None:
        """Nothing: each value stands for itself."""

    def send(self, frame: Line, now_ns: int) -> bool:
        self._check()
        markers, robot = frame["markers"], frame["robot"]
        for marker in markers:
            if marker["position_m"] is not None and marker["alternate"] is None:
                self._put_pose(f"panels/{marker['id']}", camera_link_from_tag(pose_of(marker)), marker, now_ns)
        if robot is not None:
            self._put_pose("robot", pose_of(robot), robot, now_ns)
        self._put("ids", "IntegerArray", [marker["id"] for marker in markers], _nt_time(frame, now_ns))
        self._instance.flush()
        return True

    def tell_state(self, state: str, health: Line | None) -> None:
        self._check()
        self._put("state", "String", state, 0)
        if health is not None:
            self._put("no_fix", "String", str(health.get("no_fix")), 0)
            self._put("frames_per_s", "Double", float(health.get("decoded_per_s") or 0.0), 0)
        self._instance.flush()

    def tick(self) -> None:
        self._check()

    def close(self) -> None:
        instance, self._instance = self._instance, None
        self._publishers.clear()
        if instance is not None:
            instance.stopClient()
            ntcore.NetworkTableInstance.destroy(instance)

    def _check(self) -> None:
        """A server that is back must not be told what was true before: all begins anew."""
        if not self._instance.isConnected():
            raise TargetLostError(f"{self._where}: the connection is lost")

    def _put_pose(self, name: str, pose: Pose, of: Line, now_ns: int) -> None:
        """The deviations first, so that they are there when the pose is."""
        at_us = _nt_time(of, now_ns)
        wire = wire_pose(pose)
        if wire.deviation_m is not None and wire.deviation_rad is not None:
            self._put(f"{name}/std_devs", "DoubleArray", [*wire.deviation_m, *wire.deviation_rad], at_us)
        self._put(f"{name}/pose", "Raw", POSE3D.pack(*wire.position_m, *wire.quaternion_wxyz), at_us)

    def _put(self, name: str, kind: str, value: object, at_us: int) -> None:
        publisher = self._publishers.get(name)
        if publisher is None:
            topic = getattr(self._instance, f"get{kind}Topic")(f"{self._table}/{name}")
            options = ntcore.PubSubOptions(keepDuplicates=True, periodic=0.005)
            publisher = topic.publish("struct:Pose3d", options) if kind == "Raw" else topic.publish(options)
            self._publishers[name] = publisher
        publisher.set(value, at_us)


def _nt_time(of: Line, now_ns: int) -> int:
    """When it was exposed, in µs of this machine's NetworkTables clock; ntcore tells the server in its own."""
    return int(ntcore._now()) - (now_ns - int(of["exposed_ns"])) // 1000


def camera_link_from_tag(camera_from_marker: Pose) -> Pose:
    """The same pose as WPILib has it: camera x ahead, y left, z up; tag x out of it, z up.

    Its covariance is turned likewise.
    """
    turn, quaternion = CAMERA_LINK_FROM_CAMERA, camera_from_marker.quaternion_wxyz
    rotation = turn @ matrix_from_quaternion(quaternion) @ FACING_FROM_MARKER.T
    covariance: Floats | None = camera_from_marker.covariance
    if covariance is not None:
        both = _both(turn)
        covariance = both @ covariance @ both.T
    return Pose(
        position_m=turn @ camera_from_marker.position_m,
        quaternion_wxyz=quaternion_from_matrix(rotation),
        covariance=covariance,
    )


def _both(rotation: Floats) -> Floats:
    """(6, 6) the rotation of positions and of rotations."""
    both = np.zeros((6, 6))
    both[:3, :3] = both[3:, 3:] = rotation
    return both
