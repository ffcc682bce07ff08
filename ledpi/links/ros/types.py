"""Contents → bytes: ROS 2's types and their CDR, by rosbags, without ROS."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

# Of vision_msgs 4 (ROS 2 Humble and later), which rosbags does not bring along.
VISION_MSGS = {
    "vision_msgs/msg/ObjectHypothesis": "string class_id\nfloat64 score\n",
    "vision_msgs/msg/ObjectHypothesisWithPose": (
        "vision_msgs/ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose\n"
    ),
    "vision_msgs/msg/BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size\n",
    "vision_msgs/msg/Detection3D": (
        "std_msgs/Header header\nvision_msgs/ObjectHypothesisWithPose[] results\n"
        "vision_msgs/BoundingBox3D bbox\nstring id\n"
    ),
    "vision_msgs/msg/Detection3DArray": "std_msgs/Header header\nvision_msgs/Detection3D[] detections\n",
}


@cache
def types() -> Typestore:
    """The types of ROS 2 Humble, which later ones have not changed, and vision_msgs."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in VISION_MSGS.items():
        store.register(get_types_from_msg(text, name))
    return store


def definition(name: str) -> str:
    """The type's text and that of all it is made of, as bags hold them (`ros2msg`)."""
    return str(types().generate_msgdef(name, ros_version=2)[0])


def type_hash(name: str) -> str:
    """The type's hash by REP-2016, `RIHS01_…`."""
    return str(types().hash_rihs01(name))


def to_cdr(name: str, values: dict[str, Any]) -> bytes:
    """The bytes of a message, with the four of its encapsulation first."""
    return bytes(types().serialize_cdr(_made(name, values), name))


def _made(name: str, values: dict[str, Any]) -> Any:
    """A message of rosbags, with all that it is made of."""
    store = types()
    fields = {field: _field(kind, values[field]) for field, kind in store.fielddefs[name][1]}
    return store.types[name](**fields)


def _field(description: Any, value: Any) -> Any:
    kind, what = description
    if kind == Nodetype.NAME:
        return _made(what, value)
    if kind == Nodetype.BASE:
        return value
    (of, inner), _ = what
    if of == Nodetype.NAME:
        return [_made(inner, each) for each in value]
    name = inner[0]
    if name == "string":
        return list(value)
    return np.frombuffer(value, np.uint8) if isinstance(value, bytes) else np.array(value, np.dtype(name))
