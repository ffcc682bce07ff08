"""Scenes in which a pose may be further off than its deviations say, and how far off it is."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import cv2
import numpy as np

from evaluation.simulated import BuiltAppearance
from ledpi.camera.simulate.render import Renderer
from ledpi.camera.simulate.scene import Light, Panel, Room, Scene, SimulatedSensor, SquareWave, uneven_gains
from ledpi.camera.simulate.scenes import ov5647_lens, whole_rows_us
from ledpi.camera.simulate.sensor import sensor_info
from ledpi.camera.simulate.trajectory import Gliding, Still, facing_camera, rotation
from ledpi.core.geometry import matrix_from_quaternion
from ledpi.core.records import Floats, MarkerPose, Pose
from ledpi.pipeline.pipeline import Pipeline
from tests.builders.decode import panel_settings
from tests.builders.simulate import SPEC, load_dictionary

ROW_TIME_US = 33.67
IDS = (0, 1, 2, 4, 5, 6, 7, 8, 10, 11, 12, 13)


def sensor(exposure_us: float, row_time_us: float = ROW_TIME_US) -> SimulatedSensor:
    exposure_us = whole_rows_us(exposure_us, row_time_us)
    return SimulatedSensor(intrinsics=ov5647_lens(), exposure_us=exposure_us, row_time_us=row_time_us)


def any_panel(rng: np.random.Generator, near_m: float, far_m: float) -> Panel:
    """Makes one of any ID and make, somewhere in the middle of the view, turned by up to 60°."""
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
        appearance=BuiltAppearance(
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


def behind_an_edge(seed: int, frames: int, exposure_us: float = 10_000.0) -> Scene:
    """Something dark slides before a panel's side, until it hides a sixth of it, by its edge or at an angle to it."""
    rng = np.random.default_rng(seed)
    panel = any_panel(rng, 0.6, 2.0)
    pose, nearer = panel.motion.scene_from_body(0.0), rng.uniform(0.75, 0.97)
    outward = pose[:3, int(rng.integers(2))] * rng.choice([-1, 1]) * (1, 1, 0)
    tilt = math.radians(rng.choice([0.0, rng.normal(0, 3), rng.uniform(-45, 45)]))
    outward = rotation(np.array([0.0, 0.0, tilt])) @ outward / np.linalg.norm(outward)
    corners_m = (
        np.array([[-1, 1, 0], [1, 1, 0], [1, -1, 0], [-1, -1, 0]]) * SPEC.side_m / 2 @ pose[:3, :3].T + pose[:3, 3]
    )
    place_m, width_m = nearer * pose[:3, 3], 3 * nearer * SPEC.side_m
    reach_m = corners_m / corners_m[:, 2:] * place_m[2] @ outward  # of the panel, as seen in the edge's plane
    hidden_m = np.ptp(reach_m)
    start_m = place_m + (reach_m.max() + 0.03 * hidden_m - place_m @ outward + width_m / 2) * outward
    edge = Light(
        shape="rectangle",
        width_m=width_m,
        height_m=width_m,
        level=float(rng.choice([0.0, 0.02, 0.05])),
        motion=Gliding(
            start=facing_camera(start_m, roll_deg=math.degrees(math.atan2(outward[1], outward[0]))),
            velocity_m_s=-0.2 * hidden_m / (frames * 504 * ROW_TIME_US * 1e-6) * outward,
            start_s=1.0,
        ),
    )
    return Scene(sensor=sensor(exposure_us), panels=(panel,), lights=(edge,), room=any_room(rng))


def touched(seed: int, exposure_us: float = 600.0) -> Scene:
    """LED strips beside a panel, steady or blinking, before or behind its plane, or blinds behind it, or both."""
    rng = np.random.default_rng(seed)
    panel = any_panel(rng, 0.6, 2.0)
    pose, lights = panel.motion.scene_from_body(0.0), []
    kind = rng.choice(["strips", "blinds", "both"])
    for _ in range(0 if kind == "blinds" else int(rng.integers(1, 3))):
        axis, width_m, length_m = int(rng.integers(2)), rng.uniform(0.005, 0.03), rng.uniform(0.2, 0.5)
        away_m = SPEC.side_m / 2 + rng.choice([0.0, rng.uniform(-0.01, 0.02)]) + width_m / 2
        strip = pose.copy()
        strip[:3, :3] = pose[:3, :3] @ rotation(np.array([0.0, 0.0, math.radians(rng.normal(0, 2))]))
        strip[:3, 3] = (pose[:3, 3] + rng.choice([-1, 1]) * away_m * pose[:3, axis]) * rng.choice([0.98, 1.02])
        size_m = (width_m, length_m) if axis == 0 else (length_m, width_m)
        wave = SquareWave(frequency_hz=rng.uniform(300, 5000), duty=rng.uniform(0.3, 0.9))
        light = Light(
            shape="rectangle",
            width_m=size_m[0],
            height_m=size_m[1],
            level=rng.uniform(0.2, 0.95),
            motion=Still(strip),
            wave=wave if rng.random() < 0.5 else None,
        )
        lights.append(light)
    if kind != "strips":
        place_m = 1.03 * pose[:3, 3] + rng.uniform(-0.1, 0.1, 3) * (1, 1, 0)
        blinds = Light(
            shape="lattice",
            width_m=rng.uniform(0.3, 0.8),
            height_m=rng.uniform(0.3, 0.8),
            level=rng.uniform(0.15, 0.8),
            panes=(1, int(rng.integers(5, 20))),
            bar=rng.uniform(0.1, 0.5),
            motion=Still(facing_camera(place_m)),
        )
        lights.append(blinds)
    return Scene(sensor=sensor(exposure_us), panels=(panel,), lights=tuple(lights), room=any_room(rng))


@dataclass(frozen=True)
class Judged:
    """A pose beside the truth."""

    nees: float  # squared errors over what the covariance says of them, six degrees of freedom: 6 where it is right
    off_m: float
    off_deg: float
    deviations: float  # by how many the place is off
    plain: bool  # without an alternate

    @property
    def misleads(self) -> bool:
        """Tells whether a robot would take it for right, and it is 10° off or more, or its place six deviations."""
        return self.plain and (self.off_deg > 10.0 or self.deviations > 6.0)


def poses(scene: Scene, seed: int, frames: int, *, stream: bool) -> Iterator[Judged]:
    """Returns what is made of a scene's frames."""
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
