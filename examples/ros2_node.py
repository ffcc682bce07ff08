"""A ROS 2 node: ledpi's stream as poses with covariance, and panels also on /tf.

| topic | | in frame |
|---|---|---|
| /ledpi/pose | the robot, where ledpi has a map | `map` |
| /ledpi/panel_7 | a panel: x right, y up, z out of it | parameter `camera_frame`: the camera's optical frame |
| /tf | the same panel as `panel_7` | the same |

The poses are geometry_msgs/PoseWithCovarianceStamped. As no listener could tell a panel's pose from its mirror image,
neither is published while both are possible.

Not run with ROS yet. The tests run it with stand-ins for rclpy; what `pose_fields` gives was put into messages by the
definitions of ROS 2 Humble and Jazzy, serialised, and read back the same (rosbags 0.11).

    python -m examples.ros2_node /dev/ttyUSB0 --ros-args -p camera_frame:=camera_optical_frame
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import Any

from examples.linux_robot import heard, wrong
from ledpi.wire import FixMessage, MarkerMessage, Message, WirePose

UNKNOWN_VARIANCE = 1e6  # m² or rad²: a filter gives it no weight


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseFields:
    """A message's fields of a pose."""

    stamp_ns: int  # of the picture, not of the packet's arrival
    position_m: tuple[float, float, float]
    orientation_xyzw: tuple[float, float, float, float]  # ROS has w last
    covariance: list[float]  # 6 × 6, row-major: x y z, rotation about x y z


def pose_fields(pose: WirePose, age_us: int, now_ns: int) -> PoseFields:
    """The wire tells deviations only, so the covariance is diagonal."""
    w, x, y, z = pose.quaternion_wxyz
    variances: list[float] = []
    for deviations in (pose.deviation_m, pose.deviation_rad):
        variances += [UNKNOWN_VARIANCE] * 3 if deviations is None else [d * d for d in deviations]
    covariance = [variances[row] if row == column else 0.0 for row in range(6) for column in range(6)]
    return PoseFields(
        stamp_ns=now_ns - age_us * 1000,
        position_m=pose.position_m,
        orientation_xyzw=(x, y, z, w),
        covariance=covariance,
    )


class Publishers:
    """ROS's end of it."""

    def __init__(self, node: Any) -> None:
        from tf2_ros import TransformBroadcaster

        self._node = node
        self._camera_frame = node.declare_parameter("camera_frame", "camera_optical_frame").value
        self._broadcaster = TransformBroadcaster(node)
        self._topics: dict[str, Any] = {}

    def take(self, message: Message) -> None:
        """Publishes a fix, or a panel whose pose is certain."""
        now_ns = self._node.get_clock().now().nanoseconds
        if isinstance(message, FixMessage):
            self._publish("pose", "map", pose_fields(message.pose, message.age_us, now_ns))
        elif isinstance(message, MarkerMessage) and message.pose is not None and not message.ambiguous:
            fields = pose_fields(message.pose, message.age_us, now_ns)
            self._publish(f"panel_{message.id}", self._camera_frame, fields)
            self._broadcast(f"panel_{message.id}", fields)

    def _publish(self, name: str, frame: str, fields: PoseFields) -> None:
        from geometry_msgs.msg import PoseWithCovarianceStamped

        if name not in self._topics:
            self._topics[name] = self._node.create_publisher(PoseWithCovarianceStamped, f"ledpi/{name}", 10)
        out = PoseWithCovarianceStamped()
        _fill(out.header, frame, fields, out.pose.pose.position, out.pose.pose.orientation)
        out.pose.covariance = fields.covariance
        self._topics[name].publish(out)

    def _broadcast(self, name: str, fields: PoseFields) -> None:
        from geometry_msgs.msg import TransformStamped

        out = TransformStamped()
        _fill(out.header, self._camera_frame, fields, out.transform.translation, out.transform.rotation)
        out.child_frame_id = name
        self._broadcaster.sendTransform(out)


def _fill(header: Any, frame: str, fields: PoseFields, at: Any, turned: Any) -> None:
    """Fills what both kinds of message have under different names."""
    from rclpy.time import Time

    header.frame_id = frame
    header.stamp = Time(nanoseconds=fields.stamp_ns).to_msg()
    at.x, at.y, at.z = fields.position_m
    turned.x, turned.y, turned.z, turned.w = fields.orientation_xyzw


def main() -> None:
    if len(sys.argv) < 2:  # ROS adds arguments of its own
        wrong("usage: python -m examples.ros2_node PORT")
    import rclpy

    rclpy.init()
    publishers = Publishers(rclpy.create_node("ledpi"))
    for messages, _ in heard(sys.argv[1]):
        for message in messages:
            publishers.take(message)
        if not rclpy.ok():
            break


if __name__ == "__main__":
    main()
