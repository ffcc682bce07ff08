"""Scenes in which a pose may be further off than its deviations say, and how far off it is."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from ledpi.core.geometry import matrix_from_quaternion
from ledpi.core.records import Floats, MarkerPose, Pose
from ledpi.pipeline.pipeline import Pipeline
from ledpi.simulate.render import Renderer
from ledpi.simulate.scene import Panel, PanelAppearance, Room, Scene, SimulatedSensor, uneven_gains
from ledpi.simulate.scenes import ov5647_lens, whole_rows_us
from ledpi.simulate.sensor import sensor_info
from ledpi.simulate.trajectory import Gliding, Still, facing_camera
from tests.builders.decode import panel_settings
from tests.builders.simulate import SPEC, load_dictionary

ROW_TIME_US = 33.67
IDS = (0, 1, 2, 4, 5, 6, 7, 8, 10, 11, 12, 13)


def sensor(exposure_us: float, row_time_us: float = ROW_TIME_US) -> SimulatedSensor:
    exposure_us = whole_rows_us(exposure_us, row_time_us)
    return SimulatedSensor(intrinsics=ov5647_lens(), exposure_us=exposure_us, row_time_us=row_time_us)


def any_panel(rng: np.random.Generator, near_m: float, far_m: float) -> Panel:
    """Of any ID and make, somewhere in the middle of the view, turned by up to 60°."""
    marker_id, depth_m = int(rng.choice(IDS)), rng.uniform(near_m, far_m)
    place_m = depth_m * np.array([rng.uniform(-0.25, 0.25), rng.uniform(-0.17, 0.17), 1.0])
    yaw, pitch, roll = rng.uniform(-60, 60), rng.uniform(-15, 15), rng.uniform(-30, 30)
    return Panel(
        codeword=load_dictionary("DICT_4X4_50").codeword(marker_id),
        spec=SPEC,
        motion=Still(facing_camera(place_m, yaw_deg=yaw, pitch_deg=pitch, roll_deg=roll)),
        marker_id=marker_id,
        brightness=rng.uniform(0.25, 0.6),
        cell_gains=uneven_gains(rng, 4, 0.05),
        appearance=PanelAppearance(
            gap=rng.uniform(0.03, 0.12),
            falloff=rng.uniform(0.05, 0.35),
            hot_spot=rng.uniform(0.1, 0.4),
            leds=int(rng.choice([1, 1, 2])),
            depth=float(rng.choice([0.0, 0.0, 0.06])),
        ),
    )


def any_room(rng: np.random.Generator) -> Room:
    return Room(level=rng.uniform(0.02, 0.1), contrast=rng.uniform(0.2, 0.6), texture=int(rng.integers(3)))


def turning(seed: int, turn_rad_s: float, exposure_us: float = 10_000.0) -> Scene:
    """A robot that turns to either side while it drives on at up to 0.3 m/s."""
    rng = np.random.default_rng(seed)
    motion = Gliding(
        start=np.eye(4),
        velocity_m_s=np.array([0.0, 0.0, rng.uniform(0.0, 0.3)]),
        angular_velocity_rad_s=np.array([0.0, rng.choice([-1, 1]) * turn_rad_s, 0.0]),
        start_s=1.0,
    )
    panels = (any_panel(rng, 0.5, 1.4),)
    return Scene(sensor=sensor(exposure_us), panels=panels, camera_motion=motion, room=any_room(rng))


@dataclass(frozen=True)
class Judged:
    """A pose beside the truth."""

    nees: float  # squared errors over what the covariance says of them, six degrees of freedom: 6 where it is right
    off_m: float
    off_deg: float
    deviations: float  # by how many the place is off
    plain: bool  # without an alternate


def poses(scene: Scene, seed: int, frames: int, *, stream: bool) -> Iterator[Judged]:
    """What is made of a scene's frames."""
    renderer, lens = Renderer(scene, seed=seed), scene.sensor.intrinsics
    pipeline = Pipeline(sensor_info(scene.sensor), panel_settings(), intrinsics=lens, stream=stream)
    for seq in range(frames):
        decoded = pipeline.decode(renderer.frame(seq))
        true = {marker.id: marker.camera_from_marker for marker in renderer.truth(seq)}
        yield from (judged(marker, true[marker.detection.id]) for marker in decoded.markers)


def judged(marker: MarkerPose, true: Pose) -> Judged:
    """The preferred pose: of its turn's error about the camera's axes, or the marker's, the kinder one counts."""
    assert marker.solution is not None
    pose = marker.solution.camera_from_marker
    assert pose.covariance is not None
    rotation, is_turned = (matrix_from_quaternion(each.quaternion_wxyz) for each in (pose, true))
    turn: Floats = cv2.Rodrigues(is_turned @ rotation.T)[0][:, 0]
    off_m = true.position_m - pose.position_m
    errors = (np.concatenate([off_m, turn]), np.concatenate([off_m, rotation.T @ turn]))
    place2 = float(off_m @ np.linalg.solve(pose.covariance[:3, :3], off_m))
    return Judged(
        nees=min(float(error @ np.linalg.solve(pose.covariance, error)) for error in errors),
        off_m=float(np.linalg.norm(off_m)),
        off_deg=math.degrees(float(np.linalg.norm(turn))),
        deviations=math.sqrt(place2),
        plain=marker.alternate is None,
    )
