"""Scenes for the simulator's tests, and truth that owes nothing to the code under test."""

from __future__ import annotations

from statistics import NormalDist

import cv2
import numpy as np

from ledpi.camera.simulate.scene import Panel, PanelAppearance, Room, Scene, SimulatedSensor
from ledpi.camera.simulate.trajectory import Still, Trajectory, facing_camera
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.records import Floats, Intrinsics, PanelSpec

PINHOLE = Intrinsics(width=640, height=480, fx=640.0, fy=640.0, cx=320.0, cy=240.0)
LENS = Intrinsics(
    width=640, height=480, fx=643.0, fy=641.0, cx=322.0, cy=238.0, distortion=(0.08, -0.18, 0.0008, -0.0006, 0.05)
)
SPEC = PanelSpec(side_m=0.16, black_hz=1250.0, white_hz=2450.0)
FLAT = PanelAppearance(gap=0.0, bezel=0.0, falloff=0.0, hot_spot=0.0, albedo=0.0)  # every cell evenly lit to its edges
DARK = Room(level=0.0)
WORD_7 = np.array([[1, 1, 0, 0], [0, 1, 0, 0], [1, 1, 1, 1], [0, 0, 1, 0]], bool)  # ID 7 of DICT_4X4_50, from the top


def sensor(lens: Intrinsics = LENS, *, psf_sigma_px: float = 0.7, exposure_us: float = 9967.0) -> SimulatedSensor:
    return SimulatedSensor(
        intrinsics=lens, exposure_us=exposure_us, row_time_us=33.67, frame_length_rows=504, psf_sigma_px=psf_sigma_px
    )


def panel(
    motion: Trajectory, *, marker_id: int = 7, appearance: PanelAppearance = FLAT, brightness: float = 0.4
) -> Panel:
    word = load_dictionary("DICT_4X4_50").codeword(marker_id)
    return Panel(
        codeword=word, spec=SPEC, motion=motion, marker_id=marker_id, appearance=appearance, brightness=brightness
    )


def single_class_panel(motion: Trajectory, *, brightness: float = 0.4) -> Panel:
    """A decoy: all cells blink alike, so that every row of it is even."""
    return Panel(
        codeword=np.ones((4, 4), bool), spec=SPEC, motion=motion, marker_id=None, appearance=FLAT, brightness=brightness
    )


def standing(
    x_m: float = 0.0, y_m: float = 0.0, z_m: float = 1.0, yaw_deg: float = 0.0, roll_deg: float = 0.0
) -> Still:
    return Still(facing_camera(np.array([x_m, y_m, z_m]), yaw_deg=yaw_deg, roll_deg=roll_deg))


def dark_scene(*panels: Panel, camera: SimulatedSensor) -> Scene:
    return Scene(sensor=camera, panels=panels, room=DARK)


MOMENTS = 20_000


def moments_on(start_s: float, length_s: float, frequency_hz: float, phase_cycles: float, duty: float = 0.5) -> Floats:
    """Those of 20,000 evenly spaced moments in [start, start + length] at which the square wave is on."""
    moments = start_s + length_s * (np.arange(MOMENTS) + 0.5) / MOMENTS
    return moments[(phase_cycles + frequency_hz * moments) % 1.0 < duty]


def share_on(start_s: float, length_s: float, frequency_hz: float, phase_cycles: float, duty: float = 0.5) -> float:
    """Share of [start, start + length] in which the square wave is on."""
    return len(moments_on(start_s, length_s, frequency_hz, phase_cycles, duty)) / MOMENTS


def light_by_counting(
    scene: Scene, phases_cycles: tuple[float, ...], seq: int, row: int, columns: range, *, steps: int
) -> Floats:
    """Counts what the pixels of a row collect of the scene's one FLAT panel, by points in area, blur and time."""
    camera, only = scene.sensor, scene.panels[0]
    area = (np.arange(7) + 0.5) / 7 - 0.5
    if camera.psf_sigma_px > 0:
        blur = camera.psf_sigma_px * np.array([NormalDist().inv_cdf((i + 0.5) / 9) for i in range(9)])
        blur *= camera.psf_sigma_px / blur.std()
        area = (area[:, None] + blur).ravel()
    x, dx, dy = np.meshgrid(np.array(columns), area, area, indexing="ij")
    rays = np.column_stack([_rays(np.stack([x + dx, row + dy], -1).reshape(-1, 2), camera.intrinsics), np.ones(x.size)])
    exposure_s = camera.exposure_us * 1e-6
    start_s = camera.row0_readout_ns(seq) * 1e-9 + row * camera.row_time_us * 1e-6 - exposure_s
    light = np.zeros(len(columns))
    for step in range(steps):
        begin = start_s + exposure_s * step / steps
        on = [
            share_on(begin, exposure_s / steps, f, phase, only.spec.duty)
            for f, phase in zip((only.spec.black_hz, only.spec.white_hz), phases_cycles, strict=True)
        ]
        pose = only.motion.scene_from_body(begin + exposure_s / steps / 2)
        on_plane = rays @ np.linalg.inv(pose[:3, [0, 1, 3]]).T
        across = 4 * (on_plane[:, 0] / on_plane[:, 2] / only.spec.side_m + 0.5)
        down = 4 * (0.5 - on_plane[:, 1] / on_plane[:, 2] / only.spec.side_m)
        lit = (across >= 0) & (across < 4) & (down >= 0) & (down < 4)
        white = only.codeword[down.astype(int).clip(0, 3), across.astype(int).clip(0, 3)]
        light += np.where(lit, np.where(white, on[1], on[0]), 0.0).reshape(len(columns), -1).mean(axis=1)
    return light / steps * only.brightness / only.spec.duty


def opencv_pixels(points_m: Floats, camera_from_body: Floats, lens: Intrinsics) -> Floats:
    """Returns where OpenCV sees a body's points (N, 3)."""
    turn, shift = cv2.Rodrigues(camera_from_body[:3, :3])[0], camera_from_body[:3, 3]
    return cv2.projectPoints(points_m, turn, shift, lens.matrix(), np.array(lens.distortion))[0].reshape(-1, 2)


def _rays(pixels: Floats, lens: Intrinsics) -> Floats:
    """The rays that OpenCV's own projection puts on these pixels, to 1e-6 px."""
    focal = np.array([lens.fx, lens.fy])
    rays = (pixels - (lens.cx, lens.cy)) / focal
    for _ in range(25):
        in_front = np.column_stack([rays, np.ones(len(rays))])
        rays = rays - (opencv_pixels(in_front, np.eye(4), lens) - pixels) / focal
    return rays
