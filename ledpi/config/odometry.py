"""The section `odometry`: where it comes from, and what it errs by."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from ledpi.config.values import Section
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
