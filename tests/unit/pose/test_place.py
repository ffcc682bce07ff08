"""Poses in time: what a robot in motion sees of a panel, through a shutter that rolls."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ledpi.camera.recording.reader import TruthMarker
from ledpi.camera.simulate.render import scene_truth
from ledpi.camera.simulate.scene import Panel, Scene, SimulatedSensor
from ledpi.camera.simulate.scenes import ov5647_lens, whole_rows_us
from ledpi.camera.simulate.trajectory import Gliding, Still, facing_camera
from ledpi.core.geometry import rotation_angle_deg
from ledpi.core.records import Detection, Frame, MarkerPose, PanelSpec, PlanarSolution, Rejected
from ledpi.pose.corners import independent
from ledpi.pose.fix import Robot
from ledpi.pose.place import Placer

SENSOR = SimulatedSensor(intrinsics=ov5647_lens(), exposure_us=whole_rows_us(10000, 33.67), row_time_us=33.67)
SPEC = PanelSpec(side_m=0.16, black_hz=1250.0, white_hz=2450.0)
PERIOD_S = SENSOR.frame_length_rows * SENSOR.row_time_us * 1e-6


def scene(velocity_m_s: tuple[float, float, float], turn_rad_s: float = 0.0) -> Scene:
    """A panel 0.8 m ahead, turned by 35°, before a robot on its way."""
    motion = Gliding(
        start=np.eye(4),
        velocity_m_s=np.array(velocity_m_s),
        angular_velocity_rad_s=np.array([0.0, turn_rad_s, 0.0]),
        start_s=1.0,
    )
    place = Still(facing_camera(np.array([0.05, 0.0, 0.8]), yaw_deg=35))
    panel = Panel(codeword=np.zeros((4, 4), bool), spec=SPEC, motion=place, marker_id=7)
    return Scene(sensor=SENSOR, panels=(panel,), camera_motion=motion)


def frame(seq: int) -> Frame:
    return Frame(
        pixels=np.zeros((480, 640), np.uint8),
        seq=seq,
        row0_readout_ns=SENSOR.row0_readout_ns(seq),
        exposure_us=SENSOR.exposure_us,
        row_time_us=SENSOR.row_time_us,
        transfer="srgb",
    )


def detection(now: TruthMarker, before: TruthMarker | None = None) -> Detection:
    """Exact corners, each where its own row's time sees it, and the velocity since the frame before."""
    velocity = None if before is None else (now.corners_px - before.corners_px) / PERIOD_S
    return Detection(
        id=7,
        corners_px=now.corners_px,
        covariance_px2=independent(0.05),
        margin=30.0,
        frames_used=2,
        velocity_px_s=velocity,
    )


def placed(placer: Placer, seq: int, seen: Detection) -> tuple[MarkerPose, PlanarSolution]:
    (marker,) = placer.place(frame(seq), [seen])
    assert isinstance(marker, MarkerPose)
    assert marker.solution is not None
    return marker, marker.solution


@pytest.mark.parametrize(("velocity", "turn"), [((0.7, 0.0, 0.0), 0.0), ((0.0, 0.0, 1.0), 0.0), ((0.3, 0.0, 0.5), 1.0)])
def test_a_moving_robots_pose_is_as_exact_as_a_resting_ones(velocity: tuple[float, float, float], turn: float) -> None:
    """0.7 m/s to the side, 1 m/s ahead, both with 1 rad/s: at the centre row's moment to 0.5 mm and 0.2°.

    Corners taken as they are seen would be sheared: more than four times as far off.
    """
    built = scene(velocity, turn)
    ((before,), (now,)) = (scene_truth(built, seq) for seq in (0, 1))
    true = now.camera_from_marker

    def errors(seen: Detection) -> tuple[float, float]:
        pose = placed(Placer(SENSOR.intrinsics, {7: 0.16}, stream=True), 1, seen)[1].camera_from_marker
        return float(np.linalg.norm(pose.position_m - true.position_m)), rotation_angle_deg(
            pose.quaternion_wxyz, true.quaternion_wxyz
        )

    position_m, angle_deg = errors(detection(now, before))
    assert position_m < 0.5e-3
    assert angle_deg < 0.2
    assert errors(detection(now))[1] > 4 * angle_deg


def test_the_time_is_the_centre_rows() -> None:
    """Row 0 is mid-exposed half an exposure before its read-out, the centre's row so many row times later."""
    ((now,),) = [scene_truth(scene((0, 0, 0)), 1)]
    placer = Placer(SENSOR.intrinsics, {7: 0.16}, stream=True)
    marker, solution = placed(placer, 1, detection(now))
    _, y, z = solution.camera_from_marker.position_m
    row = SENSOR.intrinsics.fy * y / z + SENSOR.intrinsics.cy
    expected_us = SENSOR.row0_readout_ns(1) / 1e3 - SENSOR.exposure_us / 2 + row * 33.67
    assert marker.mid_exposure_ns / 1e3 == pytest.approx(expected_us, abs=33.67)


def test_alone_a_frame_has_no_past() -> None:
    """As a stream, the second frame's pose follows from the first; alone it does not."""
    lens, still = SENSOR.intrinsics, scene((0, 0, 0))
    place = Still(facing_camera(np.array([0, 0, 4.0]), yaw_deg=20))
    far = replace(still, panels=(replace(still.panels[0], motion=place),))
    ((now,),) = [scene_truth(far, 1)]
    seen = detection(now)
    mirrored = replace(seen, corners_px=seen.corners_px * [-1, 1] + [2 * lens.cx, 0])
    mirrored = replace(mirrored, corners_px=mirrored.corners_px[[1, 0, 3, 2]])
    turned = {}
    for stream in (True, False):
        placer = Placer(lens, {7: 0.16}, stream=stream)
        for seq in (1, 2, 3):
            first = placed(placer, seq, seen)[1]
        last = placed(placer, 4, mirrored)[1]
        turned[stream] = rotation_angle_deg(
            first.camera_from_marker.quaternion_wxyz, last.camera_from_marker.quaternion_wxyz
        )
    assert turned[True] < 10
    assert turned[False] > 30


def test_each_sighting_gets_its_answer() -> None:
    """A pose, or the reason that there is none, in the order of the detections."""
    ((now,),) = [scene_truth(scene((0, 0, 0)), 1)]
    kite = replace(detection(now), id=8, corners_px=np.array([[300.0, 200], [340, 180], [420, 260], [310, 240]]))
    answers = Placer(SENSOR.intrinsics, {7: 0.16, 8: 0.16}, stream=True).place(frame(1), [kite, detection(now)])
    assert isinstance(answers[0], Rejected)
    assert isinstance(answers[1], MarkerPose)


def test_panels_that_hang_upright_are_reported_from_their_mirror_images() -> None:
    """A camera that looks up by 35° at a panel 3.5 m away: its mirror image leans by 70° from the wall.

    Whatever this frame's noise says, it is excluded where panels are known to hang upright.
    """
    up = np.array([0.0, -math.cos(math.radians(35)), math.sin(math.radians(35))])  # in the camera's frame
    base_link_from_camera = np.eye(4)
    # Rows: ahead, left and up as the camera sees them.
    ahead = np.array([0.0, math.sin(math.radians(35)), math.cos(math.radians(35))])
    base_link_from_camera[:3, :3] = [ahead, [-1.0, 0.0, 0.0], up]
    hung = Still(facing_camera(np.array([0.0, 0.0, 3.5]), pitch_deg=-35))
    before = scene((0, 0, 0))
    ((now,),) = [scene_truth(replace(before, panels=(replace(before.panels[0], motion=hung),)), 1)]
    answers = []
    for upright in (False, True):
        robot = Robot(base_link_from_camera=base_link_from_camera, panels_upright=upright)
        placer = Placer(SENSOR.intrinsics, {7: 0.16}, stream=True, robot=robot)
        answers.append(placed(placer, 1, replace(detection(now), covariance_px2=independent(0.5))))
    (unknown, _), (known, solution) = answers
    assert unknown.alternate is not None
    assert known.alternate is None
    apart = rotation_angle_deg(solution.camera_from_marker.quaternion_wxyz, now.camera_from_marker.quaternion_wxyz)
    assert apart < 5
