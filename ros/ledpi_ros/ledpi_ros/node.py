"""The node: ledpi's tap → ROS 2 topics. What is in the messages is ledpi.links.ros' to say, and is tested there."""

from __future__ import annotations

import sys
import threading
import time
from typing import Any

import rclpy
from rclpy.exceptions import NameValidationException, ParameterException
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rosidl_runtime_py.utilities import get_message
from tf2_ros import TransformBroadcaster

from ledpi.camera.recording.writer import encode_picture
from ledpi.core.errors import TapError, one_line
from ledpi.daemon.tap.client import Client, connect
from ledpi.daemon.tap.frames import camera_of
from ledpi.links.ros.contents import (
    CAMERA_INFO,
    COMPRESSED_IMAGE,
    TF,
    TRANSFORM,
    Message,
    Names,
    RosStream,
    camera_info_message,
    image_message,
)
from ledpi_ros.filling import fill

RETRY_S = 0.5
JOIN_S = 2.0


class LedpiNode(Node):
    """One daemon. A thread follows its tap and publishes; rclpy's executor answers parameters and services."""

    def __init__(self) -> None:
        super().__init__("ledpi")
        self._socket = str(self.declare_parameter("socket", "auto").value)
        dock_id = int(self.declare_parameter("dock_id", -1).value)
        self._names = Names(
            topic=str(self.declare_parameter("topic", "ledpi").value).rstrip("/"),
            source=self.get_fully_qualified_name().strip("/"),
            camera_frame=str(self.declare_parameter("camera_frame", "camera_optical_frame").value),
            map_frame=str(self.declare_parameter("map_frame", "map").value),
            frame_prefix=str(self.declare_parameter("frame_prefix", "").value),
            publish_tf=bool(self.declare_parameter("publish_tf", True).value),
            dock_id=None if dock_id < 0 else dock_id,
        )
        self._stream = RosStream(self._names)
        self._broadcaster = TransformBroadcaster(self)
        # Not `_publishers`: rclpy's Node has that name for itself.
        self._by_topic: dict[str, Any] = {}
        self._image_topic = f"{self._names.topic}/image_raw/compressed"
        self._info_topic = f"{self._names.topic}/camera_info"
        self._image = self._publisher(self._image_topic, COMPRESSED_IMAGE)
        self._info = self._publisher(self._info_topic, CAMERA_INFO)
        self._asked: int | None = None  # the request for a picture that is open
        self._tap: Client | None = None
        self._ending = threading.Event()
        self.failed = False
        self._thread = threading.Thread(target=self._run, name="tap", daemon=True)
        self._thread.start()

    def end(self) -> None:
        """Publishes nothing more. Before `destroy_node`."""
        self._ending.set()
        if (tap := self._tap) is not None:
            tap.close()
        self._thread.join(JOIN_S)

    def _run(self) -> None:
        try:
            while not self._ending.is_set():
                self._follow()
        except Exception:
            if rclpy.ok():  # else ROS has ended meanwhile, and takes no more messages
                self.failed = True
                raise
        finally:
            rclpy.try_shutdown()  # a node that publishes nothing any more must not look alive

    def _follow(self) -> None:
        """Until this daemon ends; waits a little for one that is not there."""
        self._asked = None
        try:
            self._tap = tap = connect(self._socket)
            with tap:
                for line in tap.lines():
                    if self._ending.is_set():
                        return
                    self._take(tap, line)
        except TapError as error:
            self.get_logger().warning(str(error), throttle_duration_sec=30.0)
            self._publish(self._stream.health("no_daemon", None, time.time_ns()))
            self._ending.wait(RETRY_S)

    def _take(self, tap: Client, line: dict[str, Any]) -> None:
        match line["type"]:
            case "hello":
                self._stream.begin(line)
            case "decoded":
                for message in self._stream.frame(line, _unix_offset_ns()):
                    self._publish(message)
                self._look(tap, line)
            case "robot_state":
                for message in self._stream.robot(line, _unix_offset_ns()):
                    self._publish(message)
            case "health":
                self._publish(self._stream.health(line["state"], line, time.time_ns()))
            case "picture" if line["id"] == self._asked:
                self._show(tap, line)
            case "error" if line.get("id") == self._asked:
                self._asked = None

    def _look(self, tap: Client, frame: dict[str, Any]) -> None:
        """Asks for a picture while somebody has subscribed to pictures: one at a time, the daemon sets the pace."""
        if self._image.get_subscription_count():
            if self._asked is None:
                self._asked = tap.send("picture")
        elif self._info.get_subscription_count():
            self._publish_info(tap, frame["exposed_ns"] + _unix_offset_ns())

    def _show(self, tap: Client, picture: dict[str, Any]) -> None:
        """Publishes a picture, and the lens with the same stamp."""
        self._asked = None
        stamp_ns = picture["decoded"]["exposed_ns"] + _unix_offset_ns()
        png = encode_picture(picture["pixels"])
        self._publish(image_message(png, self._image_topic, stamp_ns, self._names.camera_frame))
        self._publish_info(tap, stamp_ns)

    def _publish_info(self, tap: Client, stamp_ns: int) -> None:
        camera = camera_of(tap.hello)
        self._publish(camera_info_message(camera, self._info_topic, stamp_ns, self._names.camera_frame))

    def _publish(self, message: Message) -> None:
        if message.type == TF:
            transforms = message.values["transforms"]
            kind = get_message(TRANSFORM)
            self._broadcaster.sendTransform([fill(kind(), values, get_message) for values in transforms])
            return
        filled = fill(get_message(message.type)(), message.values, get_message)
        self._publisher(message.topic, message.type).publish(filled)

    def _publisher(self, topic: str, kind: str) -> Any:
        if topic not in self._by_topic:
            self._by_topic[topic] = self.create_publisher(get_message(kind), topic, 10)
        return self._by_topic[topic]


def _unix_offset_ns() -> int:
    return time.time_ns() - time.monotonic_ns()


def main() -> None:
    rclpy.init()
    try:
        node = LedpiNode()
    except (NameValidationException, ParameterException) as error:
        print(f"ledpi: parameters: {one_line(str(error))}", file=sys.stderr)
        sys.exit(2)
    try:
        rclpy.spin(node)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        node.end()
        node.destroy_node()
        rclpy.try_shutdown()
    sys.exit(1 if node.failed else 0)
