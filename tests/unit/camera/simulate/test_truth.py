"""The truth that comes with a simulated frame, against OpenCV's projection and against arithmetic."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ledpi.camera.simulate.render import Renderer
from ledpi.camera.simulate.scene import SimulatedSensor
from ledpi.camera.simulate.scenes import drive_scene, ov5647_lens, still_scene, whole_rows_us
from ledpi.camera.simulate.trajectory import Gliding, Still, facing_camera, rotation
from ledpi.core.geometry import inverse, transform
from ledpi.core.records import PanelSpec
from tests.builders.simulate import (
    LENS,
    PINHOLE,
    dark_scene,
    opencv_pixels,
    panel,
    sensor,
    single_class_panel,
    standing,
)

CORNERS_M = np.array([[-0.08, 0.08, 0.0], [0.08, 0.08, 0.0], [0.08, -0.08, 0.0], [-0.08, -0.08, 0.0]])


def test_corners_of_a_still_panel_are_where_opencv_projects_them() -> None:
    """Top left, top right, bottom right, bottom left of the lit grid's outer edge, lens distortion included."""
    motion = standing(0.25, -0.3, 1.2, yaw_deg=35, roll_deg=100)
    (truth,) = Renderer(dark_scene(panel(motion), camera=sensor()), seed=0).truth(3)
    np.testing.assert_allclose(truth.corners_px, opencv_pixels(CORNERS_M, motion.pose, LENS), atol=1e-6)
    assert truth.id == 7
    assert not truth.optional


def test_an_upright_panel_before_the_camera_is_half_a_turn_about_x() -> None:
    """camera_from_marker of a panel 2 m ahead: position (0, 0, 2), quaternion (0, 1, 0, 0); top left is top left."""
    (truth,) = Renderer(dark_scene(panel(standing(z_m=2.0)), camera=sensor(PINHOLE)), seed=0).truth(0)
    pose = truth.camera_from_marker
    np.testing.assert_allclose(pose.position_m, [0, 0, 2])
    np.testing.assert_allclose(np.abs(pose.quaternion_wxyz), [0, 1, 0, 0], atol=1e-12)
    half = 0.08 / 2.0 * 640.0
    around = np.array([[-half, -half], [half, -half], [half, half], [-half, half]])
    np.testing.assert_allclose(truth.corners_px, around + np.array([320, 240]), atol=1e-9)


def test_each_corner_of_a_passing_panel_is_seen_at_its_own_rows_time() -> None:
    """1 m ahead, 0.6 m/s to the right: a corner in row y is where the panel was at that row's mid-exposure."""
    motion = Gliding(start=standing(y_m=-0.1).pose, velocity_m_s=np.array([0.6, 0.0, 0.0]), start_s=1.0)
    (truth,) = Renderer(dark_scene(panel(motion), camera=sensor(PINHOLE)), seed=0).truth(2)

    def at(row: float) -> float:
        """x of the panel's centre, in m, when this row of frame 2 was half-way through its exposure."""
        return 0.6 * ((2 * 504 + row) * 33.67e-6 - 9967e-6 / 2)

    rows = (240 - 0.18 * 640, 240 - 0.02 * 640)
    corners = ((rows[0], -0.08), (rows[0], 0.08), (rows[1], 0.08), (rows[1], -0.08))
    expected = [[320 + 640 * (at(row) + side), row] for row, side in corners]
    np.testing.assert_allclose(truth.corners_px, expected, atol=1e-6)
    np.testing.assert_allclose(truth.camera_from_marker.position_m, [at(240 - 0.1 * 640), -0.1, 1.0], atol=1e-9)


def test_a_panel_partly_in_view_is_optional_and_one_out_of_view_is_not_listed() -> None:
    """Half of a panel may be found or not; nothing is said of panels that no pixel shows, of backs, of decoys."""

    def truth_of(motion: Still) -> list[bool]:
        return [t.optional for t in Renderer(dark_scene(panel(motion), camera=sensor(PINHOLE)), seed=0).truth(0)]

    assert truth_of(standing(x_m=0.40)) == [False]
    assert truth_of(standing(x_m=0.50)) == [True]  # the picture ends 0.5 m from the middle
    assert truth_of(standing(x_m=0.60)) == []
    assert truth_of(standing(x_m=50.0)) == []
    assert truth_of(standing(z_m=-1.0)) == []
    assert truth_of(Still(transform(np.diag([-1.0, -1.0, 1.0]), np.array([0.0, 0.0, 1.0])))) == []
    assert Renderer(dark_scene(single_class_panel(standing()), camera=sensor()), seed=0).truth(0) == ()


def test_gliding_has_the_velocities_that_it_states() -> None:
    """Position and attitude change by velocity × time, angular velocity about the scene's axes."""
    start = transform(rotation(np.array([0.1, 0.2, 0.3])), np.array([1.0, 2.0, 3.0]))
    spin = np.array([0.0, 0.5, 0.0])
    motion = Gliding(start=start, velocity_m_s=np.array([1.0, 0.0, -2.0]), angular_velocity_rad_s=spin, start_s=4.0)
    np.testing.assert_allclose(motion.scene_from_body(4.0), start)
    later = motion.scene_from_body(4.5)
    np.testing.assert_allclose(later[:3, 3], [1.5, 2.0, 2.0])
    np.testing.assert_allclose(later[:3, :3], rotation(0.5 * spin) @ start[:3, :3], atol=1e-12)


def robot_drive() -> Renderer:
    spec = PanelSpec(side_m=0.16, black_hz=1250.0, white_hz=2450.0)
    camera = SimulatedSensor(intrinsics=ov5647_lens(), exposure_us=9967.0)
    return Renderer(drive_scene(camera, {7: spec, 23: spec}, "DICT_4X4_50"), seed=0)


def test_the_robot_sees_both_panels_from_0_7_to_2_9_m_at_a_walking_pace() -> None:
    """Over a whole round: who is in view, how far away, how fast."""
    renderer = robot_drive()
    rounds = [renderer.truth(seq) for seq in range(0, 590, 10)]
    whole = [sorted(t.id for t in truth if not t.optional) for truth in rounds]
    distances = [float(np.linalg.norm(t.camera_from_marker.position_m)) for truth in rounds for t in truth]
    assert np.mean([ids == [7, 23] for ids in whole]) > 0.8
    assert 0.68 < min(distances) < 0.8
    assert 2.4 < max(distances) < 2.9
    path = renderer.scene.camera_motion
    places = np.array([path.scene_from_body(t)[:3, 3] for t in np.linspace(0, 10, 1001)])
    speeds = np.linalg.norm(np.diff(places, axis=0), axis=1) / 0.01
    assert 0.5 < speeds.max() < 0.8


def test_the_robots_round_closes_without_a_jump() -> None:
    """The pose, and how it changes, are the same ten seconds later."""
    path = robot_drive().scene.camera_motion
    for t in (0.0, 3.3, 9.999):
        np.testing.assert_allclose(path.scene_from_body(t), path.scene_from_body(t + 10.0), atol=1e-9)
    step = inverse(path.scene_from_body(9.9995)) @ path.scene_from_body(10.0005)
    assert np.linalg.norm(step[:3, 3]) < 0.001


def test_a_still_scene_is_as_asked() -> None:
    """Distance along the axis; an angle of 60° turns the panel's face to the camera's left."""
    spec = PanelSpec(side_m=0.16, black_hz=1250.0, white_hz=2450.0)
    camera = SimulatedSensor(intrinsics=ov5647_lens(), exposure_us=9967.0)
    scene = still_scene(camera, {7: spec, 9: spec}, "DICT_4X4_50", distance_m=0.9, angle_deg=60.0)
    left, right = Renderer(scene, seed=0).truth(0)
    assert (left.id, right.id) == (7, 9)
    np.testing.assert_allclose(left.camera_from_marker.position_m, [-0.12, 0.0, 0.9], atol=1e-9)
    np.testing.assert_allclose(right.camera_from_marker.position_m, [0.12, 0.0, 0.9], atol=1e-9)
    normal = scene.panels[0].motion.scene_from_body(0.0)[:3, 2]
    np.testing.assert_allclose(normal, [-math.sin(math.radians(60)), 0.0, -math.cos(math.radians(60))], atol=1e-9)


def test_an_exposure_is_whole_rows_rounded_down() -> None:
    """10 ms at the OV5647's 33.6727 µs are 296 rows, 9967.1 µs; the shortest is four rows."""
    assert whole_rows_us(10000.0, 1852 / 55) == pytest.approx(9967.127)
    assert whole_rows_us(150.0, 1852 / 55) == pytest.approx(4 * 1852 / 55)
    assert whole_rows_us(3.0, 1852 / 55) == pytest.approx(4 * 1852 / 55)


def test_facing_camera_turns_about_the_scenes_axes() -> None:
    """Unturned, x is right, y up, z towards the camera; roll turns the marker clockwise in the picture."""
    np.testing.assert_allclose(facing_camera(np.zeros(3))[:3, :3], np.diag([1.0, -1.0, -1.0]))
    rolled = facing_camera(np.zeros(3), roll_deg=90.0)
    np.testing.assert_allclose(rolled[:3, 0], [0, 1, 0], atol=1e-12)  # its right side points down
