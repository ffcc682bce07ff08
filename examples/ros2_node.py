"""A ROS 2 node: ledpi's fixes as geometry_msgs/PoseWithCovarianceStamped on /ledpi/pose, frame `map`.

Not run with ROS yet. The tests run it with stand-ins for rclpy; what `pose_fields` gives was put into a message by the
definitions of ROS 2 Humble and Jazzy, serialised, and read back the same (rosbags 0.11).

    python examples/ros2_node.py /dev/ttyUSB0
"""

from __future__ import annotations

import sys
from dataclasses import dataclass

import serial

from ledpi.wire import FixMessage, Receiver

UNKNOWN_VARIANCE = 1e6  # m² or rad²: a filter gives it no weight


@dataclass(frozen=True, slots=True, kw_only=True)
class PoseFields:
    """What the message holds; map_from_base_link."""

    stamp_ns: int  # of the picture, not of the packet's arrival
    position_m: tuple[float, float, float]
    orientation_xyzw: tuple[float, float, float, float]  # ROS has w last
    covariance: list[float]  # 6 × 6, row-major: x y z, rotation about x y z


def pose_fields(fix: FixMessage, now_ns: int) -> PoseFields:
    """The wire tells deviations only, so the covariance is diagonal."""
    w, x, y, z = fix.pose.quaternion_wxyz
    variances: list[float] = []
    for deviations in (fix.pose.deviation_m, fix.pose.deviation_rad):
        variances += [UNKNOWN_VARIANCE] * 3 if deviations is None else [d * d for d in deviations]
    covariance = [variances[row] if row == column else 0.0 for row in range(6) for column in range(6)]
    return PoseFields(
        stamp_ns=now_ns - fix.age_us * 1000,
        position_m=fix.pose.position_m,
        orientation_xyzw=(x, y, z, w),
        covariance=covariance,
    )


def main() -> None:
    if len(sys.argv) < 2:  # ROS adds arguments of its own
        sys.exit("usage: python examples/ros2_node.py PORT")
    import rclpy
    from geometry_msgs.msg import PoseWithCovarianceStamped
    from rclpy.time import Time

    rclpy.init()
    node = rclpy.create_node("ledpi")
    publisher = node.create_publisher(PoseWithCovarianceStamped, "ledpi/pose", 10)
    receiver = Receiver()
    with serial.Serial(sys.argv[1], 115200, timeout=0.02) as line:
        line.reset_input_buffer()
        while rclpy.ok():
            for message in receiver.feed(line.read(max(1, line.in_waiting))):
                if not isinstance(message, FixMessage):
                    continue
                fields = pose_fields(message, node.get_clock().now().nanoseconds)
                out = PoseWithCovarianceStamped()
                out.header.frame_id = "map"
                out.header.stamp = Time(nanoseconds=fields.stamp_ns).to_msg()
                at, turned = out.pose.pose.position, out.pose.pose.orientation
                at.x, at.y, at.z = fields.position_m
                turned.x, turned.y, turned.z, turned.w = fields.orientation_xyzw
                out.pose.covariance = fields.covariance
                publisher.publish(out)


if __name__ == "__main__":
    main()
