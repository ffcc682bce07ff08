"""Checks of the tap's lines, as docs/tap.md describes them: what is otherwise is never drawn. Pure."""

from __future__ import annotations

import math
from typing import Any

from ledpi.core.records import COEFFICIENTS

_NUMBER = (int, float)


def check_line(line: dict[str, Any]) -> None:
    """Raises ValueError that names the key, where the page could not use a line. Unknown types are let pass."""
    if line["type"] in _CHECKS:
        _CHECKS[line["type"]](line)


def _hello(line: dict[str, Any]) -> None:
    camera, panels = _of(line, "camera", dict), _of(line, "panels", dict)
    _positive(camera, "width", "height", "row_time_us")
    if camera.get("fx") is not None:
        _positive(camera, "fx", "fy")
        _number(camera, "cx", "cy")
        if camera.get("distortion") is not None:
            _numbers(camera, "distortion", len(COEFFICIENTS.get(camera.get("distortion_model", "plumb_bob"), ())))
    _positive(panels, "side_m", "black_hz", "white_hz")
    for marker_id, panel in (_of(line, "map", (dict, type(None))) or {}).items():
        if not marker_id.isdecimal():
            raise ValueError("map: an ID must be a number")
        _place(panel)


def _robot_state(line: dict[str, Any]) -> None:
    _of(line, "t_ns", int)
    _of(line, "mode", str)
    if line.get("position_m") is not None:
        _numbers(line, "position_m", 2)
        _numbers(line, "covariance", 9)
        _number(line, "yaw_rad", "way_m", "panel_ns")
        _of(line, "contested", bool)
        _of(line, "moved", list)


def _health(line: dict[str, Any]) -> None:
    _of(line, "state", str)
    for key in ("frames_per_s", "temperature_c"):
        if line.get(key) is not None:
            _number(line, key)
    for fault in line.get("faults") or []:
        _of(fault, "text", str)
        _number(fault, "at_ns")


def _decoded(line: dict[str, Any]) -> None:
    for key in ("seq", "exposed_ns", "sensor_timestamp_ns"):
        _of(line, key, int)
    for marker in _of(line, "markers", list):
        if _of(marker, "id", int) < 0:
            raise ValueError("id: must not be negative")
        _number(marker, "margin")
        _quad(marker)
        if marker.get("position_m") is None:
            marker["position_m"] = None
        else:
            _place(marker)
    _of(line, "rejected", dict)
    if line.get("robot") is not None:
        _place(line["robot"])
        if line["robot"].get("covariance") is not None:
            _numbers(line["robot"], "covariance", 36)


def _picture(line: dict[str, Any]) -> None:
    if "pixels" not in line:
        raise ValueError("pixels: are missing")
    _decoded(_of(line, "decoded", dict))
    for found in [*line.get("rejected", []), *line.get("looks", [])]:
        _quad(found)
        _of(found, "why", (str, type(None)))


def _quad(values: dict[str, Any]) -> None:
    corners = _of(values, "corners_px", list)
    if len(corners) != 4:
        raise ValueError("corners_px: must be four")
    for corner in corners:
        _numbers({"corners_px": corner}, "corners_px", 2)


def _place(values: dict[str, Any]) -> None:
    _numbers(values, "position_m", 3)
    _numbers(values, "quaternion_wxyz", 4)
    if not any(values["quaternion_wxyz"]):
        raise ValueError("quaternion_wxyz: must not be zero")


def _numbers(values: dict[str, Any], key: str, count: int) -> None:
    found = _of(values, key, list)
    if len(found) != count or not all(isinstance(v, _NUMBER) and math.isfinite(v) for v in found):
        raise ValueError(f"{key}: must be {count} numbers")


def _positive(values: dict[str, Any], *keys: str) -> None:
    _number(values, *keys)
    for key in keys:
        if not values[key] > 0:
            raise ValueError(f"{key}: must be above 0")


def _number(values: dict[str, Any], *keys: str) -> None:
    for key in keys:
        if not math.isfinite(_of(values, key, _NUMBER)):
            raise ValueError(f"{key}: must be a number")


def _of(values: Any, key: str, kind: type | tuple[type, ...]) -> Any:
    value = values.get(key) if isinstance(values, dict) else None
    if not isinstance(value, kind):
        raise ValueError(f"{key}: is missing, or of another kind")
    return value


_CHECKS = {
    **{"hello": _hello, "decoded": _decoded, "picture": _picture, "health": _health},
    "robot_state": _robot_state,
}
