"""Plain dictionaries → ROS 2 messages. Needs no ROS itself."""

from __future__ import annotations

import re
from array import array
from collections.abc import Callable
from typing import Any


def fill(message: Any, values: dict[str, Any], get_message: Callable[[str], Any]) -> Any:
    """Puts `values` into a message's fields, and returns it.

    `get_message` gives the class of a type's name, as rosidl_runtime_py's does.
    """
    kinds = message.get_fields_and_field_types()
    for field, value in values.items():
        if isinstance(value, dict):
            fill(getattr(message, field), value, get_message)
        elif isinstance(value, list) and value and isinstance(value[0], dict):
            inner = get_message(_element(kinds[field]))
            setattr(message, field, [fill(inner(), each, get_message) for each in value])
        elif isinstance(value, bytes):  # whole: rclpy looks at each number of any other sequence
            setattr(message, field, array("B", value))
        elif kinds[field] == "octet":  # rclpy has a byte as bytes
            setattr(message, field, bytes([value]))
        else:
            setattr(message, field, value)
    return message


def _element(kind: str) -> str:
    """`geometry_msgs/msg/TransformStamped` of `sequence<geometry_msgs/TransformStamped>`."""
    found = re.fullmatch(r"sequence<(\w+)/(?:msg/)?(\w+)(?:, \d+)?>", kind)
    assert found is not None, kind
    return f"{found[1]}/msg/{found[2]}"
