"""Panels before a fisheye of 140°, calibrated with a board: at its rim they are read and placed as in its middle."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ledpi.camera.simulate.render import Renderer
from ledpi.camera.simulate.scene import Panel, Scene, SimulatedSensor
from ledpi.camera.simulate.sensor import sensor_info
from ledpi.camera.simulate.trajectory import Still, facing_camera, rotation
from ledpi.config.panels import PanelSettings
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.geometry import transform
from ledpi.core.records import Intrinsics, PanelSpec
from ledpi.pipeline.pipeline import Pipeline
from ledpi.workshop.calibrate.camera import calibrate_camera
from tests.builders.lenses import BOARD, views_of

FOCAL = 640 / math.radians(140)  # 140° across the picture
FISHEYE = Intrinsics(
    width=640,
    height=480,
    fx=FOCAL,
    fy=FOCAL,
    cx=321.0,
    cy=238.0,
    distortion=(0.02, -0.01, 0.004, -0.001),
    distortion_model="equidistant",
)
SPEC = PanelSpec(side_m=0.16, black_hz=1250.0, white_hz=2450.0)
IDS, YAWS_DEG = (7, 12, 23, 42, 0), (0.0, 15.0, -15.0, 25.0)
DISTANCE_M = 0.65


def placed(aside_deg: float, towards: tuple[float, float], count: int, lens: Intrinsics) -> list[float]:
    """Errors of the distance, over it, of the panels that are read in single frames.

    The panels are seen `aside_deg` off the axis, towards and away from a direction (x, y) of the picture, and decoded
    with `lens`, drawn with FISHEYE.
    """
    sensor = SimulatedSensor(intrinsics=FISHEYE, exposure_us=9966.32, row_time_us=33.67, frame_length_rows=507)
    info, errors = sensor_info(sensor), []
    pipeline = Pipeline(info, PanelSettings(side_m=SPEC.side_m), intrinsics=lens, stream=False)
    for number in range(count):
        marker_id, angle = IDS[number % len(IDS)], math.radians(aside_deg) * (-1) ** number
        axis = np.array([-towards[1], towards[0], 0.0]) / math.hypot(*towards)
        facing = facing_camera(np.array([0, 0, DISTANCE_M]), yaw_deg=YAWS_DEG[number // 2 % 4], roll_deg=3.0 * number)
        pose = transform(rotation(axis * angle), np.zeros(3)) @ facing
        codeword = load_dictionary("DICT_4X4_50").codeword(marker_id)
        panel = Panel(codeword=codeword, spec=SPEC, motion=Still(pose), marker_id=marker_id)
        frame = Renderer(Scene(sensor=sensor, panels=(panel,)), seed=number).frame(0)
        for marker in pipeline.decode(frame).markers:
            assert marker.detection.id == marker_id
            assert marker.solution is not None
            at = marker.solution.camera_from_marker.position_m
            errors.append(float(np.linalg.norm(at - pose[:3, 3])) / DISTANCE_M)
    return errors


@pytest.mark.slow
def test_panels_at_the_rim_are_read_and_placed() -> None:
    """To 1 % of the distance, and in 95 % of what is read in the middle, or more."""
    calibrated = calibrate_camera(views_of(FISHEYE, 24, 65.0), BOARD, 640, 480)
    assert calibrated.rms_px <= 0.2
    middle, rim = (placed(aside_deg, (1.0, 0.0), 12, calibrated.intrinsics) for aside_deg in (0.0, 57.0))
    assert len(middle) >= 8
    assert len(rim) >= 0.95 * len(middle)
    assert max(middle + rim) < 0.01
