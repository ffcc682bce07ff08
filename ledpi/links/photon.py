"""A frame in PhotonLib's packet, so that a robot program which uses PhotonLib needs no change. Pure.

The layout is PhotonVision's own message definition (`photonstruct:PhotonPipelineResult`), which its number names:
little endian, lists with a byte of length, an optional value with a byte that says whether it is there.
"""

from __future__ import annotations

import math
import struct
from typing import Any

import numpy as np

from ledpi.core import geometry
from ledpi.core.records import Floats, Pose
from ledpi.links.wpilib_values import camera_link_from_tag, pose_of

MESSAGE = "4b2ff16a964b5e2bf04be0c1454d91c4"  # of PhotonLib 2025.3 to 2026.3
TYPE = f"photonstruct:PhotonPipelineResult:{MESSAGE}"
PROPERTIES = {"message_uuid": MESSAGE}
MOST_TARGETS = 20
_METADATA = struct.Struct("<4q")  # number, captured and published (µs of the robot's clock), since its clock was asked
_TARGET = struct.Struct("<4d2if7d7dd")
_FIX = struct.Struct("<7d7d3d")  # PnpResult
MOST_USED, MOST_ID = 32, 32767  # of the panels of a fix
_NO_OBJECT = (-1, -1.0)  # fields of detected objects, which panels are not
_BOTTOM_LEFT_FIRST = (3, 2, 1, 0)  # PhotonVision goes round against the clock


def mount_of(hello: dict[str, Any]) -> Floats:
    """base_link_from_camera_link, (4, 4): x ahead, y left, z up, as the configuration has it."""
    mount = hello.get("camera_mount") or {}
    turn = geometry.matrix_from_rpy_deg(*(mount.get("rpy_deg") or (0.0, 0.0, 0.0)))
    return geometry.transform(turn, np.array(mount.get("position_m") or (0.0, 0.0, 0.0)))


def packet(
    frame: dict[str, Any], size: tuple[int, int], captured_us: int, published_us: int, mount: Floats | None = None
) -> bytes:
    """All panels of a frame that have a pose; and, of several panels of a map, the camera's place on it.

    `size`: of the picture. Times are the robot's own. `mount`: as of `mount_of`.
    """
    placed = [marker for marker in frame["markers"] if marker["position_m"] is not None][:MOST_TARGETS]
    targets = b"".join(_target(marker, size) for marker in placed)
    head = _METADATA.pack(frame["seq"], captured_us, published_us, 0) + bytes([len(placed)])
    return head + targets + _multi_tag(frame, mount)


def _multi_tag(frame: dict[str, Any], mount: Floats | None) -> bytes:
    """An optional value: where on the field the camera is. By one panel alone PhotonVision gives none."""
    fix = frame["robot"]
    used = [used for used in (fix or {}).get("panels_used", ()) if used <= MOST_ID][:MOST_USED]
    if fix is None or len(used) < 2:
        return b"\0"
    robot = pose_of(fix)
    field_from_base = geometry.transform(geometry.matrix_from_quaternion(robot.quaternion_wxyz), robot.position_m)
    field_from_camera = field_from_base @ (np.eye(4) if mount is None else mount)
    place = [*field_from_camera[:3, 3].tolist(), *geometry.quaternion_from_matrix(field_from_camera[:3, :3]).tolist()]
    errors_px = [marker["reprojection_px"] or 0.0 for marker in frame["markers"] if marker["id"] in used]
    error_px = sum(errors_px) / max(1, len(errors_px))
    both = [*place, *place]  # the alternate, too: a fix that is told has no mirror image
    return b"\1" + _FIX.pack(*both, error_px, error_px, 0.0) + struct.pack(f"<b{len(used)}h", len(used), *used)


def _target(marker: dict[str, Any], size: tuple[int, int]) -> bytes:
    best, other = camera_link_from_tag(pose_of(marker)), marker["alternate"]
    alternate = best if other is None else camera_link_from_tag(pose_of(other))
    x, y, z = best.position_m  # ahead, left, up
    corners = marker["corners_px"]
    values = _TARGET.pack(
        math.degrees(math.atan2(-y, x)),  # positive to the right, and up, as PhotonVision has them
        math.degrees(math.atan2(z, math.hypot(x, y))),
        100.0 * abs(geometry.quad_area(corners)) / (size[0] * size[1]),
        0.0,
        marker["id"],
        *_NO_OBJECT,
        *_transform(best),
        *_transform(alternate),
        0.0 if other is None else min(1.0, marker["reprojection_px"] / max(other["reprojection_px"], 1e-9)),
    )
    return values + _corners(_box(corners)) + _corners([corners[k] for k in _BOTTOM_LEFT_FIRST])


def _transform(pose: Pose) -> list[float]:
    return [float(number) for number in (*pose.position_m, *pose.quaternion_wxyz)]


def _box(corners: list[list[float]]) -> list[list[float]]:
    (left, top), (right, bottom) = np.min(corners, axis=0), np.max(corners, axis=0)
    return [[left, bottom], [right, bottom], [right, top], [left, top]]


def _corners(corners: list[list[float]]) -> bytes:
    return bytes([len(corners)]) + b"".join(struct.pack("<2d", *corner) for corner in corners)
