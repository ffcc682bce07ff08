"""A panel that was read, and the robot's place, as a program uses them."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from ledpi.core.geometry import matrix_from_quaternion
from ledpi.core.records import BodyPose, Floats, MarkerPose, PlanarSolution, RobotFix

# An upright panel that faces the camera: the marker's x, y, z (right, up, out of it) along the camera's x, −y, −z.
_FACING = np.diag([1.0, -1.0, -1.0])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Marker:
    """A panel, and where it is from the camera. The arrays are read-only.

    The pose is in OpenCV's camera frame: x right, y down, z ahead. The marker's own frame has its origin at the panel's
    centre, x right, y up, z out of it. Without a lens the pose is None, and so is all that follows from it.
    """

    id: int
    corners_px: Floats  # (4, 2): top left, top right, bottom right, bottom left of the marker as its ID is drawn
    margin: float  # natural-log likelihood ratio to the best explanation that is not this ID
    frames_used: int  # how many pictures tell the ID; 1 outside a stream
    time_ns: int  # of mid-exposure of the panel's centre row, on the clock of the time that came with the picture
    position_m: Floats | None  # (3,) of the panel's centre
    quaternion_wxyz: Floats | None  # (4,) camera_from_marker, unit length
    covariance: Floats | None  # (6, 6): x y z (m²), rotation about the camera's x y z (rad²)
    mirrored: Marker | None  # the other pose that the corners allow as well, where it cannot be excluded

    @property
    def distance_m(self) -> float | None:
        """From the camera to the panel's centre."""
        return None if self.position_m is None else float(np.linalg.norm(self.position_m))

    @property
    def yaw(self) -> float | None:
        """Radians about the camera's y axis (down): 0 faces the camera, positive faces to the picture's left."""
        turned = self._turned()
        return None if turned is None else math.atan2(turned[0, 2], turned[2, 2])

    @property
    def pitch(self) -> float | None:
        """Radians about the camera's x axis, after yaw: 0 faces the camera, positive faces to the picture's bottom."""
        turned = self._turned()
        return None if turned is None else -math.asin(float(np.clip(turned[1, 2], -1.0, 1.0)))

    @property
    def roll(self) -> float | None:
        """Radians within the panel's plane: 0 is upright, positive is clockwise as seen in the picture.

        Of a panel on the ceiling and a camera that looks up this is the robot's heading.
        """
        turned = self._turned()
        return None if turned is None else math.atan2(turned[1, 0], turned[1, 1])

    def to_dict(self) -> dict[str, Any]:
        """Numbers, lists and None only, as JSON has them, under the names of the attributes."""
        angles = {name: getattr(self, name) for name in ("distance_m", "yaw", "pitch", "roll")}
        return _plain(self) | angles | {"mirrored": None if self.mirrored is None else self.mirrored.to_dict()}

    def _turned(self) -> Floats | None:
        """The rotation from the upright panel that faces the camera: yaw about y · pitch about x · roll about z."""
        if self.quaternion_wxyz is None:
            return None
        turned: Floats = matrix_from_quaternion(self.quaternion_wxyz) @ _FACING
        return turned


def marker_of(decoded: MarkerPose) -> Marker:
    """The decoder's record, as a program uses it."""
    mirrored = None if decoded.alternate is None else _marker(decoded, decoded.alternate, None)
    return _marker(decoded, decoded.solution, mirrored)


def _marker(decoded: MarkerPose, solution: PlanarSolution | None, mirrored: Marker | None) -> Marker:
    detection = decoded.detection
    pose = None if solution is None else solution.camera_from_marker
    return Marker(
        id=detection.id,
        corners_px=detection.corners_px,
        margin=detection.margin,
        frames_used=detection.frames_used,
        time_ns=decoded.mid_exposure_ns,
        position_m=None if pose is None else pose.position_m,
        quaternion_wxyz=None if pose is None else pose.quaternion_wxyz,
        covariance=None if pose is None else pose.covariance,
        mirrored=mirrored,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Fix:
    """The robot's pose in the map, map_from_base_link: x ahead, y left, z up. The arrays are read-only."""

    position_m: Floats  # (3,)
    quaternion_wxyz: Floats  # (4,) unit length
    covariance: Floats | None  # (6, 6): x y z (m²), rotation about the map's x y z (rad²)
    panels_used: tuple[int, ...]
    panels_rejected: tuple[int, ...]  # those that contradict the others
    time_ns: int  # on the clock of the time that came with the picture

    @property
    def heading(self) -> float:
        """Radians about the map's z axis: 0 looks along x, positive turns towards y."""
        turned = matrix_from_quaternion(self.quaternion_wxyz)
        return math.atan2(turned[1, 0], turned[0, 0])

    def to_dict(self) -> dict[str, Any]:
        """Numbers, lists and None only, as JSON has them."""
        return _plain(self) | {"heading": self.heading}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Body:
    """A body's pose, camera_from_body, by its panels in view; from OpenCV's camera to its own frame."""

    position_m: Floats  # (3,) of its origin
    quaternion_wxyz: Floats  # (4,) unit length
    covariance: Floats | None  # (6, 6): x y z (m²), rotation about the camera's x y z (rad²)
    panels_used: tuple[int, ...]
    panels_rejected: tuple[int, ...]  # those that contradict the others
    time_ns: int  # on the clock of the time that came with the picture

    def to_dict(self) -> dict[str, Any]:
        """Numbers, lists and None only, as JSON has them."""
        return _plain(self)


def _plain(record: Marker | Fix | Body) -> dict[str, Any]:
    """The fields that are not records of their own."""
    values = {field.name: getattr(record, field.name) for field in fields(record) if field.name != "mirrored"}
    return {
        name: value.tolist() if isinstance(value, np.ndarray) else list(value) if isinstance(value, tuple) else value
        for name, value in values.items()
    }


def fix_of(decoded: RobotFix | None) -> Fix | None:
    """The decoder's record, as a program uses it."""
    if decoded is None:
        return None
    pose = decoded.map_from_base_link
    return Fix(
        position_m=pose.position_m,
        quaternion_wxyz=pose.quaternion_wxyz,
        covariance=pose.covariance,
        panels_used=decoded.panels_used,
        panels_rejected=decoded.panels_rejected,
        time_ns=decoded.mid_exposure_ns,
    )


def body_of(decoded: BodyPose) -> Body:
    """The decoder's record, as a program uses it."""
    pose = decoded.camera_from_body
    return Body(
        position_m=pose.position_m,
        quaternion_wxyz=pose.quaternion_wxyz,
        covariance=pose.covariance,
        panels_used=decoded.panels_used,
        panels_rejected=decoded.panels_rejected,
        time_ns=decoded.mid_exposure_ns,
    )
