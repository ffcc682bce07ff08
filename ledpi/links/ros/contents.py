"""A frame of the tap → the contents of ROS 2 messages, as plain dictionaries with the messages' own fields.

Who has ROS fills its messages from them (ros/ledpi_ros), who has none writes their bytes (`types.py`): bags, and the
bridge to Zenoh. Frames of reference are REP-103's and REP-105's: the camera's optical frame is `camera`, a panel's has
x right, y up, z out of it. docs/ros.md lists the topics.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from ledpi.core.geometry import matrix_from_quaternion, quaternion_from_matrix
from ledpi.core.records import CameraInfo, DistortionModel, Floats

Values = dict[str, Any]
Sides = Callable[[int], float]  # of a panel, by its ID: m

POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
DOCK_POSE = "geometry_msgs/msg/PoseStamped"
TF, TRANSFORM = "tf2_msgs/msg/TFMessage", "geometry_msgs/msg/TransformStamped"
ODOMETRY = "nav_msgs/msg/Odometry"
DETECTIONS = "vision_msgs/msg/Detection3DArray"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
STRING = "std_msgs/msg/String"

UNKNOWN_VARIANCE = 1e6  # m² or rad²: a filter gives it no weight
# A dock's x points into it, as a robot that has driven in faces, its z points up: Nav2 then needs no further rotation.
MARKER_FROM_DOCK = np.array([[0.0, -1, 0], [0, 0, 1], [-1, 0, 0]])
OK, WARN, ERROR, STALE = 0, 1, 2, 3  # levels of diagnostic_msgs/DiagnosticStatus
# sensor_msgs/distortion_models.hpp knows three. Its rational_polynomial is OpenCV's, with as many terms as there are.
ROS_MODELS: Mapping[DistortionModel, str] = {
    "plumb_bob": "plumb_bob",
    "rational_polynomial": "rational_polynomial",
    "thin_prism": "rational_polynomial",
    "equidistant": "equidistant",
}
BASE_FRAME = "base_link"
_PLANE = (0, 1, 5)  # of a pose's six: x, y, rotation about z
_NO_POSITION, _NO_ROTATION = (math.nan,) * 3, (math.nan,) * 4


class Message(NamedTuple):
    """One message: where it belongs, of what type, when it is true (ns), and what it holds."""

    topic: str
    type: str
    stamp_ns: int
    values: Values


@dataclass(frozen=True, slots=True, kw_only=True)
class Names:
    """Names of topics and of frames of reference."""

    topic: str = "/ledpi"  # what topics begin with; without / it is relative to the node's namespace
    source: str = "ledpi"  # who diagnostics are of
    camera_frame: str = "camera_optical_frame"
    map_frame: str = "map"
    frame_prefix: str = ""  # of the panels' frames
    publish_tf: bool = True
    dock_id: int | None = None  # the panel on a dock, if there is one

    @property
    def dock_topic(self) -> str:
        """The topic where Nav2's docking server of the same namespace listens."""
        namespace, slash, _ = self.topic.rpartition("/")
        return f"{namespace}{slash}detected_dock_pose"


def _unknown_m(marker_id: int) -> float:
    return 0.0


def frame_messages(frame: Values, names: Names, unix_offset_ns: int, side_m: Sides = _unknown_m) -> list[Message]:
    """The messages of one `decoded` line. `unix_offset_ns`: what to add to its times to get Unix time.

    Detections are published of every frame, as "nothing seen" is news too; an ID that is read without a lens has a pose
    of NaN there. No listener could tell a panel's pose from its mirror image, so where both are possible it is in the
    detections alone, with both.
    """
    stamp_ns = frame["exposed_ns"] + unix_offset_ns
    found = [_detection(marker, names, unix_offset_ns, side_m(marker["id"])) for marker in frame["markers"]]
    header = _header(stamp_ns, names.camera_frame)
    messages = [Message(f"{names.topic}/detections", DETECTIONS, stamp_ns, {"header": header, "detections": found})]
    certain = [m for m in frame["markers"] if m["position_m"] is not None and m["alternate"] is None]
    if certain and names.publish_tf:
        transforms = [_transform(marker, names, unix_offset_ns) for marker in certain]
        messages.append(Message("/tf", TF, stamp_ns, {"transforms": transforms}))
    for marker in certain:
        at_ns = marker["exposed_ns"] + unix_offset_ns
        messages.append(_pose(f"{names.topic}/panel_{marker['id']}", marker, at_ns, names.camera_frame))
        if marker["id"] == names.dock_id:
            messages.append(_dock(marker, at_ns, names))
    if (robot := frame["robot"]) is not None:
        messages.append(_pose(f"{names.topic}/pose", robot, robot["exposed_ns"] + unix_offset_ns, names.map_frame))
    return messages


def odometry_messages(state: Values, names: Names, unix_offset_ns: int) -> list[Message]:
    """The robot's state in the map's plane; none where there is none.

    Height, roll and pitch are not known, nor what the velocity errs by.
    """
    if state["position_m"] is None:
        return []
    stamp_ns, (x, y), yaw = state["t_ns"] + unix_offset_ns, state["position_m"], state["yaw_rad"]
    covariance = UNKNOWN_VARIANCE * np.eye(6)
    covariance[np.ix_(_PLANE, _PLANE)] = np.reshape(state["covariance"], (3, 3))
    pose = {"position_m": [x, y, 0.0], "quaternion_wxyz": [math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)]}
    speed, turn = state["velocity"]
    twist = {"linear": {"x": speed, "y": 0.0, "z": 0.0}, "angular": {"x": 0.0, "y": 0.0, "z": turn}}
    values = {
        "header": _header(stamp_ns, names.map_frame),
        "child_frame_id": BASE_FRAME,
        "pose": _with_covariance(pose | {"covariance": covariance.ravel().tolist()}),
        "twist": {"twist": twist, "covariance": (UNKNOWN_VARIANCE * np.eye(6)).ravel().tolist()},
    }
    return [Message(f"{names.topic}/odometry", ODOMETRY, stamp_ns, values)]


def health_message(
    state: str, health: Values | None, names: Names, stamp_ns: int, *, contradicting: bool = False
) -> Message:
    """The daemon's state for `ros2 topic echo /diagnostics` and rqt_runtime_monitor.

    `contradicting`: panels have contradicted the map since the last one.
    """
    health = health or {}
    level = {"running": OK, "starting": WARN, "stopping": WARN, "camera_lost": ERROR}.get(state, STALE)
    wrong = _wrong(health, contradicting) if level == OK else []
    keys = ("no_fix", "frames_per_s", "decoded_per_s", "dropped_frames", "in_view")
    said: Values = {key: health[key] for key in keys if key in health}
    said |= {f"rejected.{key}": count for key, count in health.get("rejected", {}).items()}
    if health.get("temperature_c") is not None:
        said["temperature_c"] = health["temperature_c"]
    status = {
        "level": WARN if wrong else level,
        "name": f"{names.source}: daemon",
        "message": "; ".join(wrong) or state.replace("_", " "),
        "hardware_id": names.camera_frame,
        "values": [{"key": key, "value": str(value)} for key, value in said.items()],
    }
    return Message("/diagnostics", DIAGNOSTICS, stamp_ns, {"header": _header(stamp_ns, ""), "status": [status]})


def _wrong(health: Values, contradicting: bool) -> list[str]:
    """Lists what a person has to put right, though frames come."""
    no_fix = health.get("no_fix")
    found = {
        "frames are decoded too late: this computer is too slow": no_fix == "behind",
        "nothing is decoded": no_fix != "behind" and health.get("decoded_per_s") == 0,
        "no lens is known: calibrate it (camera.intrinsics)": no_fix == "uncalibrated",
        "panels contradict the map": contradicting,
    }
    return [text for text, holds in found.items() if holds]


def camera_info_message(camera: CameraInfo, topic: str, stamp_ns: int, frame_id: str) -> Message:
    """The lens, as ROS has it; zeros where it is not calibrated, as ROS says that."""
    lens = camera.intrinsics
    k = np.zeros((3, 3)) if lens is None else lens.matrix()
    projection = np.hstack([k, np.zeros((3, 1))])
    values = {
        "header": _header(stamp_ns, frame_id),
        "height": camera.height,
        "width": camera.width,
        "distortion_model": "plumb_bob" if lens is None else ROS_MODELS[lens.distortion_model],
        "d": [] if lens is None else [float(number) for number in lens.distortion],
        "k": k.ravel().tolist(),
        "r": np.eye(3).ravel().tolist(),
        "p": projection.ravel().tolist(),
        "binning_x": 0,
        "binning_y": 0,
        "roi": {"x_offset": 0, "y_offset": 0, "height": 0, "width": 0, "do_rectify": False},
    }
    return Message(topic, CAMERA_INFO, stamp_ns, values)


def image_message(png: bytes, topic: str, stamp_ns: int, frame_id: str) -> Message:
    """A grey picture as PNG, without loss."""
    values = {"header": _header(stamp_ns, frame_id), "format": "mono8; png compressed mono8", "data": png}
    return Message(topic, COMPRESSED_IMAGE, stamp_ns, values)


def _detection(marker: Values, names: Names, unix_offset_ns: int, side_m: float) -> Values:
    """One panel; a second hypothesis is its mirror pose, where that is not excluded."""
    score = 1.0 / (1.0 + math.exp(-marker["margin"]))  # of this ID against the best other explanation
    hypotheses = [
        {"hypothesis": {"class_id": str(marker["id"]), "score": score}, "pose": _with_covariance(pose)}
        for pose in (marker, marker["alternate"])
        if pose is not None
    ]
    return {
        "header": _header(marker["exposed_ns"] + unix_offset_ns, names.camera_frame),
        "results": hypotheses,
        "bbox": {"center": _pose_of(marker), "size": {"x": side_m, "y": side_m, "z": 0.0}},
        "id": str(marker["id"]),
    }


def _pose(topic: str, of: Values, stamp_ns: int, frame_id: str) -> Message:
    return Message(topic, POSE, stamp_ns, {"header": _header(stamp_ns, frame_id), "pose": _with_covariance(of)})


def _dock(marker: Values, stamp_ns: int, names: Names) -> Message:
    """For Nav2's docking server."""
    rotation = matrix_from_quaternion(np.array(marker["quaternion_wxyz"])) @ MARKER_FROM_DOCK
    pose = {"position_m": marker["position_m"], "quaternion_wxyz": quaternion_from_matrix(rotation).tolist()}
    values = {"header": _header(stamp_ns, names.camera_frame), "pose": _pose_of(pose)}
    return Message(names.dock_topic, DOCK_POSE, stamp_ns, values)


def _transform(marker: Values, names: Names, unix_offset_ns: int) -> Values:
    pose = _pose_of(marker)
    return {
        "header": _header(marker["exposed_ns"] + unix_offset_ns, names.camera_frame),
        "child_frame_id": f"{names.frame_prefix}panel_{marker['id']}",
        "transform": {"translation": pose["position"], "rotation": pose["orientation"]},
    }


def _with_covariance(pose: Values) -> Values:
    """Gives what is not known a variance that gives it no weight."""
    covariance = pose.get("covariance")
    if covariance is None:
        unknown: Floats = UNKNOWN_VARIANCE * np.eye(6)
        covariance = unknown.ravel().tolist()
    return {"pose": _pose_of(pose), "covariance": [float(number) for number in covariance]}


def _pose_of(pose: Values) -> Values:
    x, y, z = pose["position_m"] or _NO_POSITION
    qw, qx, qy, qz = pose["quaternion_wxyz"] or _NO_ROTATION
    return {
        "position": {"x": float(x), "y": float(y), "z": float(z)},
        "orientation": {"x": float(qx), "y": float(qy), "z": float(qz), "w": float(qw)},
    }


def _header(stamp_ns: int, frame_id: str) -> Values:
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    return {"stamp": {"sec": seconds, "nanosec": nanoseconds}, "frame_id": frame_id}


class RosStream:
    """One daemon's lines → messages: what a frame does not say is kept of other lines. Pure."""

    def __init__(self, names: Names) -> None:
        self._names = names
        self._hello: Values = {}
        self._contradicting = False  # since the last health

    def begin(self, hello: Values) -> None:
        """Takes the panels and map of the daemon that now runs."""
        self._hello = hello

    def frame(self, line: Values, unix_offset_ns: int) -> list[Message]:
        """The messages of a `decoded` line."""
        against_map = (line["robot"] or {}).get("panels_rejected")
        self._contradicting |= bool(against_map) or "fix.panels_contradict" in line["rejected"]
        return frame_messages(line, self._names, unix_offset_ns, self._side_m)

    def robot(self, line: Values, unix_offset_ns: int) -> list[Message]:
        """The message of a `robot_state` line; none where there is no state."""
        return odometry_messages(line, self._names, unix_offset_ns)

    def health(self, state: str, health: Values | None, stamp_ns: int) -> Message:
        """The message of a state, and of the `health` line that told it, if there was one."""
        contradicting, self._contradicting = self._contradicting, False
        return health_message(state, health, self._names, stamp_ns, contradicting=contradicting)

    def _side_m(self, marker_id: int) -> float:
        """Looks into the map, then into the panels' settings; 0 where nobody says."""
        panels = self._hello.get("panels", {})
        own = (self._hello.get("map") or {}).get(str(marker_id)) or panels.get("overrides", {}).get(str(marker_id), {})
        return float(own.get("side_m") or panels.get("side_m", 0.0))
