"""A simulated robot drives a figure of eight between panels by the state, and docks: pictures rendered and read.

The controller is firmware/drive/steer.h, in C; wheels slip, a gyro drifts, motors lag. Not live, but as fast as this
computer renders. Writes a picture of the true and the estimated path.
"""

from __future__ import annotations

import argparse
import math
import sys
from pathlib import Path

import cv2
import numpy as np

from evaluation.drives.cases import PICTURE_LATE_NS
from evaluation.drives.docking import Line
from evaluation.drives.robot import BASE_FROM_CAMERA, Plant, Steered, place, steered
from ledpi.camera.simulate.scene import Panel, Scene, SimulatedSensor
from ledpi.camera.simulate.scenes import ov5647_lens, whole_rows_us
from ledpi.camera.simulate.trajectory import Still
from ledpi.camera.simulated import SimulatedCamera
from ledpi.config.panels import PanelSettings
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.geometry import CAMERA_LINK_FROM_CAMERA, inverse, matrix_from_rpy_deg, transform
from ledpi.core.records import Floats, MapPanel, PanelSpec, Pixels
from ledpi.pipeline.pipeline import Pipeline
from ledpi.state.estimator import Estimator

SIDE_M, HEIGHT_M = 0.16, 0.45
WIDE_M, DEEP_M = 4.5, 3.0  # of the room
PANELS = {  # x, y, yaw in degrees
    7: (WIDE_M, 1.5, 180),
    23: (0.0, 1.5, 0),
    5: (1.2, 0.0, 90),
    12: (3.3, 0.0, 90),
    28: (1.2, DEEP_M, -90),
    41: (3.3, DEEP_M, -90),
}
GOAL, PANEL_M = (WIDE_M - 0.6, 1.5, 0.0), 0.6
EIGHT = [(2.25 + math.sin(s), 1.5 + 0.5 * math.sin(2 * s)) for s in np.linspace(0, math.tau, 17)[1:]]
NEAR_M, SAY_EVERY_S = 0.2, 3.0
MOST_S, CONTROL_STEPS = 60.0, 2
PIXELS_A_METRE = 150
SCENE_FROM_MAP = inverse(transform(CAMERA_LINK_FROM_CAMERA, np.zeros(3)))


class Track:
    """The camera's motion, as far as it is known."""

    moves = True

    def __init__(self, pose: Floats) -> None:
        self.poses = [pose]  # each 10 ms

    def scene_from_body(self, t_s: float) -> Floats:
        at = max(0.0, min(t_s * 100, len(self.poses) - 1.0))
        k = min(int(at), len(self.poses) - 2) if len(self.poses) > 1 else 0
        one, two = self.poses[k], self.poses[min(k + 1, len(self.poses) - 1)]
        x, y, yaw = (one + (at - k) * np.array([*(two - one)[:2], math.remainder(two[2] - one[2], math.tau)])).tolist()
        turn = matrix_from_rpy_deg(0, 0, math.degrees(yaw))
        return SCENE_FROM_MAP @ transform(turn, np.array([x, y, 0.0])) @ BASE_FROM_CAMERA


def camera_of(track: Track) -> tuple[SimulatedCamera, SimulatedSensor]:
    """The Pi's camera, at ten pictures a second, so that rendering takes no longer than the drive."""
    row_us = 33.67
    rows = round(0.1 / row_us * 1e6)
    sensor = SimulatedSensor(
        intrinsics=ov5647_lens(), exposure_us=whole_rows_us(10_000, row_us), row_time_us=row_us, frame_length_rows=rows
    )
    words, spec = load_dictionary("DICT_4X4_50"), PanelSpec(side_m=SIDE_M, black_hz=1250.0, white_hz=2450.0)
    panels = tuple(
        Panel(codeword=words.codeword(i), spec=spec, motion=Still(SCENE_FROM_MAP @ at), marker_id=i)
        for i, at in places().items()
    )
    scene = Scene(sensor=sensor, panels=panels, camera_motion=track)
    return SimulatedCamera(scene, seed=0, paced=False), sensor


def places() -> dict[int, Floats]:
    return {i: place(x, y, math.radians(yaw), HEIGHT_M) for i, (x, y, yaw) in PANELS.items()}


def steer(steers: Steered, now_us: int, passed: int) -> tuple[tuple[float, float], int, bool]:
    """Speed and turn rate; how many points of the eight are passed; and whether it has docked."""
    if passed < len(EIGHT) and steers.is_there(now_us, *EIGHT[passed], NEAR_M):
        passed += 1
    if passed < len(EIGHT):
        return steers.go_to(now_us, *EIGHT[passed]), passed, False
    motion, docked = steers.dock(now_us)
    return motion, passed, docked


def drive() -> tuple[Floats, Floats, bool]:
    """The true path and the estimated one, (N, 3) each; and whether the robot has docked."""
    plant = Plant(np.random.default_rng(51), np.array([2.25, 1.5, 0.8]))
    track = Track(plant.pose)
    camera, sensor = camera_of(track)
    settings = PanelSettings(side_m=SIDE_M, ids=list(PANELS))
    pipeline, picture = Pipeline(camera.info, settings, intrinsics=sensor.intrinsics), np.empty((480, 640), np.uint8)
    panels = {
        i: MapPanel(map_from_marker=at, position_sigma_m=0.001, angle_sigma_rad=0.002) for i, at in places().items()
    }
    estimator = Estimator(panels, BASE_FROM_CAMERA)
    motion, passed, docked, seq, said_s, true, told = (0.0, 0.0), 0, False, 0, 0.0, [], []
    steers = steered()
    steers.begin(GOAL, PANEL_M)
    line = Line(plant, estimator, steers)
    while plant.t_ns < MOST_S * 1e9 and not docked:
        plant.step(*motion)
        track.poses.append(plant.pose)
        if plant.t_ns >= sensor.readout_end_ns(seq):
            frame = camera.read(picture)
            assert frame is not None
            line.put(PICTURE_LATE_NS, estimator.add_markers, pipeline.decode(frame).markers)
            seq += 1
        if plant.k % CONTROL_STEPS == 0:
            state = line.tell()
            motion, passed, docked = steer(steers, plant.t_ns // 1000, passed)
            if state is not None:
                true.append(plant.pose)
                told.append(state.pose)
                if plant.t_ns >= said_s * 1e9:
                    said_s = plant.t_ns * 1e-9 + SAY_EVERY_S
                    print(beside(plant.t_ns * 1e-9, plant.pose, state.pose), flush=True)
    return np.array(true), np.array(told), docked


def beside(t_s: float, true: Floats, told: Floats) -> str:
    off_mm = 1e3 * math.hypot(*(told - true)[:2])
    states = (f"{x:6.3f} {y:6.3f} m {math.degrees(yaw):+6.1f}°" for x, y, yaw in (told, true))
    return f"{t_s:5.1f} s  state {'   true '.join(states)}   off by {off_mm:3.0f} mm"


def drawn(true: Floats, told: Floats) -> Pixels:
    """The room from above: true path left, estimated path right."""
    halves = []
    for name, path, colour in (("true", true, (60, 60, 60)), ("estimated", told, (200, 90, 20))):
        canvas = np.full((int(3.5 * PIXELS_A_METRE), int(5.0 * PIXELS_A_METRE), 3), 255, np.uint8)
        cv2.putText(canvas, name, (20, 35), cv2.FONT_HERSHEY_SIMPLEX, 0.9, colour, 2, cv2.LINE_AA)
        for i, (x, y, _) in PANELS.items():
            at = pixel(x, y)
            cv2.circle(canvas, at, 8, (0, 140, 255), -1, cv2.LINE_AA)
            cv2.putText(
                canvas, str(i), (at[0] + 10, at[1] - 8), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (0, 0, 0), 1, cv2.LINE_AA
            )
        points = np.array([pixel(x, y) for x, y, _ in path.tolist()], np.int32)
        cv2.polylines(canvas, [points], False, colour, 2, cv2.LINE_AA)
        cv2.circle(canvas, points[-1].tolist(), 6, colour, -1, cv2.LINE_AA)
        halves.append(canvas)
    return np.hstack(halves)


def pixel(x_m: float, y_m: float) -> tuple[int, int]:
    return round((x_m + 0.25) * PIXELS_A_METRE), round((3.25 - y_m) * PIXELS_A_METRE)


def main() -> int:
    """Exit status: 0 if it has docked."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("drive.png"))
    asked = parser.parse_args()
    true, told, docked = drive()
    off_mm = 1e3 * np.hypot(*(told - true)[:, :2].T)
    x, y, yaw = (true[-1] - GOAL) * (1e3, 1e3, 1)
    off = f"off by {np.sqrt(np.mean(off_mm**2)):.0f} mm (RMS), {off_mm.max():.0f} at most"
    goal = f"{'docked' if docked else 'NOT docked'}, {math.hypot(x, y):.1f} mm and {abs(math.degrees(yaw)):.1f}° off"
    print(f"figure of eight, {len(true) * CONTROL_STEPS / 100:.0f} s: the state is {off}; {goal}; {asked.out}")
    return 0 if cv2.imwrite(str(asked.out), drawn(true, told)) and docked else 1


if __name__ == "__main__":
    sys.exit(main())
