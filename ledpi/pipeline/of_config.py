"""The pipeline of a configuration, for whatever frames come from."""

from __future__ import annotations

from ledpi.config.robot import base_link_from_camera, load_own_map
from ledpi.config.settings import Config
from ledpi.core.records import CameraInfo, Intrinsics, PanelValues
from ledpi.pipeline.pipeline import Pipeline
from ledpi.pose.fix import Robot


def pipeline_of(
    config: Config,
    camera: CameraInfo,
    lens: Intrinsics | None,
    source_panel: PanelValues | None = None,
    *,
    robot: Robot | None = None,
    stream: bool = True,
) -> Pipeline:
    """Makes one that has seen nothing. `robot`: where it is loaded already. Raises LedpiError."""
    return Pipeline(
        camera,
        config.panels,
        intrinsics=lens,
        source_panel=source_panel,
        robot=load_robot(config) if robot is None else robot,
        method=config.decode.method,
        stream=stream,
    )


def load_robot(config: Config) -> Robot:
    """Reads the map too, if there is one. Raises ConfigError."""
    return Robot(
        base_link_from_camera=base_link_from_camera(config.robot.camera_mount),
        panels=load_own_map(config),
        panels_upright=config.panels.upright,
    )
