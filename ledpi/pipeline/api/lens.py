"""Values of a program: its lens, a panel that was read, and the robot's place."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from numbers import Real
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ledpi.config.lens_forms import of_model
from ledpi.config.values import check_lens
from ledpi.core.errors import ConfigError, raising, shortened
from ledpi.core.geometry import matrix_from_quaternion
from ledpi.core.records import (
    COEFFICIENTS,
    BodyPose,
    DistortionModel,
    Floats,
    Intrinsics,
    MarkerPose,
    PlanarSolution,
    Pose,
    RobotFix,
)


@dataclass(frozen=True, slots=True, kw_only=True)
class Lens:
    """A camera and its lens by one of OpenCV's models, in pixels of pictures of `size` (width, height).

    Those are the pictures that it was calibrated with, and that are read: numbers of another size would give wrong
    distances. `distortion` is as OpenCV has it: k1 k2 p1 p2, k3, k4 k5 k6, s1 s2 s3 s4, as many as there are; empty for
    none. `model` says "equidistant" for the k1 k2 k3 k4 of `cv2.fisheye`, and must be given where there are four.

    Raises ConfigError for a lens that cannot be.

    >>> Lens(size=(640, 480), fx=500, fy=500, cx=320, cy=240).distortion
    ()
    """

    size: tuple[int, int]
    fx: float
    fy: float
    cx: float
    cy: float
    distortion: tuple[float, ...] = ()
    model: DistortionModel | None = None

    def __post_init__(self) -> None:
        self.intrinsics()

    @classmethod
    def from_matrix(
        cls,
        matrix: ArrayLike,
        distortion: ArrayLike = (),
        *,
        size: tuple[int, int],
        model: DistortionModel | None = None,
    ) -> Lens:
        """Takes a 3 × 3 camera matrix, or nine numbers: OpenCV's `cameraMatrix` and `distCoeffs`, ROS's `k` and `d`.

        Raises ConfigError for a matrix of another form.

        >>> Lens.from_matrix([[500, 0, 320], [0, 510, 240], [0, 0, 1]], size=(640, 480))
        Lens(size=(640, 480), fx=500.0, fy=510.0, cx=320.0, cy=240.0, distortion=(), model=None)
        """
        values, coefficients = np.asarray(matrix, np.float64), np.asarray(distortion, np.float64)
        if values.size != 9:
            raise ConfigError(f"lens: the camera matrix must be 3 × 3 or nine numbers, not {values.shape}")
        fx, skew, cx, zero, fy, cy, *last = values.ravel().tolist()
        if skew != 0 or zero != 0 or last != [0, 0, 1]:
            raise ConfigError("lens: the camera matrix must be [fx, 0, cx, 0, fy, cy, 0, 0, 1]")
        bent = tuple(coefficients.ravel().tolist())
        return cls(size=size, fx=fx, fy=fy, cx=cx, cy=cy, distortion=bent, model=model)

    def intrinsics(self) -> Intrinsics:
        """As the decoder takes it. Raises ConfigError where no lens makes pictures of this size so."""
        width, height = _checked_size(self.size)
        if self.model is not None and self.model not in COEFFICIENTS:
            raise ConfigError(f"lens: model must be one of {', '.join(COEFFICIENTS)}, not {self.model!r}")
        try:
            model, distortion = of_model(self.model, self.distortion)
        except ValueError as error:
            raise ConfigError(f"lens: distortion {error}") from None
        for name in ("fx", "fy", "cx", "cy"):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, Real):
                raise ConfigError(f"lens: {name} must be a number, in pixels, not {shortened(value)}")
        with raising("lens", ConfigError):
            check_lens(width, height, fx=self.fx, fy=self.fy, cx=self.cx, cy=self.cy)
            return Intrinsics(
                width=width,
                height=height,
                fx=self.fx,
                fy=self.fy,
                cx=self.cx,
                cy=self.cy,
                distortion=distortion,
                distortion_model=model,
            )


def _checked_size(size: object) -> tuple[int, int]:
    try:
        width, height = (int(side) for side in size)  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        raise ConfigError(f"lens: size must be (width, height) of the pictures, not {size!r}") from None
    if min(width, height) < 1:
        raise ConfigError(f"lens: size must be (width, height) of the pictures, not {size!r}")
    return width, height


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
        return plain(self) | angles | {"mirrored": None if self.mirrored is None else self.mirrored.to_dict()}

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
class ByPanels:
    """A pose by the panels in view. The arrays are read-only."""

    position_m: Floats  # (3,)
    quaternion_wxyz: Floats  # (4,) unit length
    covariance: Floats | None  # (6, 6): x y z (m²), rotation about x y z (rad²), of the map or of the camera
    panels_used: tuple[int, ...]
    panels_rejected: tuple[int, ...]  # those that contradict the others
    time_ns: int  # on the clock of the time that came with the picture

    def to_dict(self) -> dict[str, Any]:
        """Numbers, lists and None only, as JSON has them."""
        return plain(self)


class Fix(ByPanels):
    """The robot's pose in the map, map_from_base_link: x ahead, y left, z up."""

    __slots__ = ()

    @property
    def heading(self) -> float:
        """Radians about the map's z axis: 0 looks along x, positive turns towards y."""
        turned = matrix_from_quaternion(self.quaternion_wxyz)
        return math.atan2(turned[1, 0], turned[0, 0])

    def to_dict(self) -> dict[str, Any]:
        """Numbers, lists and None only, as JSON has them."""
        return plain(self) | {"heading": self.heading}


class Body(ByPanels):
    """A body's pose, camera_from_body, by its panels in view; from OpenCV's camera to its own frame."""

    __slots__ = ()


def plain(record: Any) -> dict[str, Any]:
    """The fields of a record that are none of their own, in what JSON has."""
    values = {field.name: getattr(record, field.name) for field in fields(record) if field.name != "mirrored"}
    return {
        name: value.tolist() if isinstance(value, np.ndarray) else list(value) if isinstance(value, tuple) else value
        for name, value in values.items()
    }


def fix_of(decoded: RobotFix | None) -> Fix | None:
    """The decoder's record, as a program uses it."""
    return None if decoded is None else Fix(**_by_panels(decoded.map_from_base_link, decoded))


def body_of(decoded: BodyPose) -> Body:
    """The decoder's record, as a program uses it."""
    return Body(**_by_panels(decoded.camera_from_body, decoded))


def _by_panels(pose: Pose, decoded: RobotFix | BodyPose) -> dict[str, Any]:
    return {
        "position_m": pose.position_m,
        "quaternion_wxyz": pose.quaternion_wxyz,
        "covariance": pose.covariance,
        "panels_used": decoded.panels_used,
        "panels_rejected": decoded.panels_rejected,
        "time_ns": decoded.mid_exposure_ns,
    }
