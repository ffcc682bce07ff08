"""The node: ledpi's tap → ROS 2 topics. What is in the messages is ledpi.ros.contents' to say, and is tested there."""

from __future__ import annotations

import threading
import time
from typing import Any

import rclpy
from rclpy.node import Node
from rosidl_runtime_py.utilities import get_message

from ledpi.core.errors import TapError
from ledpi.ros.contents import Message, Names, frame_messages, health_message
from ledpi.tap.client import connect
from ledpi_ros.filling import fill

RETRY_S = 0.5


class LedpiNode(Node):
    """One daemon. A thread follows its tap and publishes; rclpy's executor answers parameters and services."""

    def __init__(self) -> None:
        super().__init__("ledpi")
        self._socket = str(self.declare_parameter("socket", "auto").value)
        dock_id = int(self.declare_parameter("dock_id", -1).value)
        self._names = Names(
            topic=f"/{str(self.declare_parameter('topic', 'ledpi').value).strip('/')}",
            camera_frame=str(self.declare_parameter("camera_frame", "camera_optical_frame").value),
            map_frame=str(self.declare_parameter("map_frame", "map").value),
            dock_id=None if dock_id < 0 else dock_id,
        )
        # Not `_publishers`: rclpy's Node has that name for itself.
        self._by_topic: dict[str, Any] = {}
        threading.Thread(target=self._follow, daemon=True).start()

    def _follow(self) -> None:
        """Until the process ends; waits for a daemon that is not there."""
        while rclpy.ok():
            try:
                tap = connect(self._socket)
            except TapError as error:
                self.get_logger().warning(str(error), throttle_duration_sec=30.0)
                self._publish(self._health("no_daemon", None))
                time.sleep(RETRY_S)
                continue
            with tap:
                for line in tap.lines():
                    self._take(line)

    def _take(self, line: dict[str, Any]) -> None:
        if line["type"] == "decoded":
            for message in frame_messages(line, self._names, time.time_ns() - time.monotonic_ns()):
                self._publish(message)
        elif line["type"] == "health":
            self._publish(self._health(line["state"], line))

    def _health(self, state: str, health: dict[str, Any] | None) -> Message:
        return health_message(state, health, self._names, time.time_ns())

    def _publish(self, message: Message) -> None:
        kind = get_message(message.type)
        if message.topic not in self._by_topic:
            self._by_topic[message.topic] = self.create_publisher(kind, message.topic, 10)
        self._by_topic[message.topic].publish(fill(kind(), message.values, get_message))


def main() -> None:
    rclpy.init()
    node = LedpiNode()
    try:
        rclpy.spin(node)
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
