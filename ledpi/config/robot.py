"""The sections `robot` and `odometry`: how the camera sits on it, where its odometry comes from and how that errs."""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import AfterValidator, Field

from ledpi.config.values import Angles, MountPosition, Section
from ledpi.core.geometry import CAMERA_LINK_FROM_CAMERA, matrix_from_rpy_deg, transform
from ledpi.core.records import Floats
from ledpi.state.inputs import OdometryNoise

# Per root of a metre or a second. A wheel that errs by its own way, or a gyro by a radian a second, measures nothing.
Deviation = Annotated[float, Field(ge=0.0001, le=1, allow_inf_nan=False)]


LEAST_HZ = 0.1  # of states, where there are any


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


def _never_or_soon(hz: float) -> float:
    if hz != 0 and not hz >= LEAST_HZ:
        raise ValueError(f"must be 0, or {LEAST_HZ:g} at least")
    return hz


class RobotSettings(Section):
    """The section `robot`."""

    camera_mount: CameraMount = CameraMount()
    state_hz: Annotated[float, Field(le=100, allow_inf_nan=False), AfterValidator(_never_or_soon)] | None = None


def base_link_from_camera(mount: CameraMount) -> Floats:
    """The camera's optical frame in the robot's, (4, 4)."""
    rotation = matrix_from_rpy_deg(*mount.rpy_deg) @ CAMERA_LINK_FROM_CAMERA
    return transform(rotation, np.array(mount.position_m))
