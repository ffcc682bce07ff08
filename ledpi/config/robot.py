"""The sections `robot`, `odometry` and `bodies`: where the camera sits, how odometry errs, what else carries panels.

A body is a dock, a cart, another robot: a map of its own.
"""

from __future__ import annotations

from itertools import combinations
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from ledpi.config.map_yaml import Deviations, PanelPlace
from ledpi.config.outputs import OutputName
from ledpi.config.panels import PanelSettings
from ledpi.config.values import Angles, MarkerId, MountPosition, Section
from ledpi.core.errors import ConfigError
from ledpi.core.geometry import CAMERA_LINK_FROM_CAMERA, matrix_from_rpy_deg, transform
from ledpi.core.records import Floats, PanelMap
from ledpi.state.inputs import OdometryNoise

# Per root of a metre or a second. A wheel that errs by its own way, or a gyro by a radian a second, measures nothing.
Deviation = Annotated[float, Field(ge=0.0001, le=1, allow_inf_nan=False)]


class OdometryDeviations(Section):
    """Errors of it, as random walks."""

    way_per_m: Deviation = 0.02
    yaw_per_m: Deviation = 0.00175  # 0.1°
    yaw_per_s: Deviation = 0.00175


class OdometrySettings(Section):
    """The section `odometry`."""

    source: Literal["serial", "tap", "none"] = "none"
    base_m: Annotated[float, Field(ge=0.01, le=10, allow_inf_nan=False)] | None = None
    deviations: OdometryDeviations = OdometryDeviations()

    @property
    def noise(self) -> OdometryNoise:
        """As the estimator takes it."""
        own = self.deviations
        return OdometryNoise(
            base_m=self.base_m, way_per_m=own.way_per_m, yaw_per_m=own.yaw_per_m, yaw_per_s=own.yaw_per_s
        )


class CameraMount(Section):
    """base_link_from_camera_link: x ahead, y left, z up; zero looks ahead."""

    position_m: MountPosition = (0.0, 0.0, 0.0)
    rpy_deg: Angles = (0.0, 0.0, 0.0)


class RobotSettings(Section):
    """The section `robot`."""

    camera_mount: CameraMount = CameraMount()
    state_hz: Annotated[float, Field(ge=0, le=100, allow_inf_nan=False)] | None = None


def base_link_from_camera(mount: CameraMount) -> Floats:
    """The camera's optical frame in the robot's, (4, 4)."""
    rotation = matrix_from_rpy_deg(*mount.rpy_deg) @ CAMERA_LINK_FROM_CAMERA
    return transform(rotation, np.array(mount.position_m))


BY_RULER = Deviations(position_m=0.002, angle_deg=0.5)  # on one rigid thing, where a map's are taped along walls
Bodies = dict[OutputName, dict[MarkerId, PanelPlace]]


def check_bodies(bodies: Bodies, panels: PanelSettings, where: str) -> None:
    """Raises ConfigError for a body without panels, and for panels that cannot be where they are said to be."""
    try:
        known, body_of = len(panels.words.codewords), dict[int, str]()
        sides_m = {i: panels.spec(i).side_m for places in bodies.values() for i in places}
    except ValueError:
        return  # the panels' own check has said why
    for name, places in bodies.items():
        key = f"{where}: bodies.{name}"
        if not places:
            raise ConfigError(f"{key}: must hold a panel at least, as {{7: {{position_m: [0, 0, 0], yaw_deg: 0}}}}")
        for marker_id in places:
            if marker_id >= known:
                raise ConfigError(f"{key}.{marker_id}: {panels.dictionary} has only the IDs 0 to {known - 1}")
            if body_of.setdefault(marker_id, name) != name:
                raise ConfigError(f"{key}.{marker_id}: is on {body_of[marker_id]}, too; must be on one body")
        for one, other in combinations(places, 2):
            if _coincide(places[one], places[other], sides_m[one] + sides_m[other]):
                raise ConfigError(f"{key}.{other}: is where {one} is; each panel must have a place of its own")


def body_maps(bodies: Bodies) -> dict[str, PanelMap]:
    """The maps, by name. x, y and z are the body's own."""
    return {name: {i: place.map_panel(BY_RULER) for i, place in places.items()} for name, places in bodies.items()}


def _coincide(one: PanelPlace, other: PanelPlace, sides_m: float) -> bool:
    """Tells whether two panels that face the same way overlap. Back to back, or around a corner, they do not."""
    a, b = one.map_from_marker(), other.map_from_marker()
    return bool(np.linalg.norm(a[:3, 3] - b[:3, 3]) < sides_m / 4 and a[:3, 2] @ b[:3, 2] > 0)
