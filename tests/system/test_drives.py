"""A robot that drives by a real daemon's state, in closed loop: by the program on the tap, and in C over the line."""

from __future__ import annotations

import math
import os
import threading
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evaluation.drives.robot import DT_S, Plant, steered
from examples.tap_robot import NEAR_M, STAND, drive, go_through
from ledpi.config.settings import load_config
from ledpi.core.geometry import CAMERA_LINK_FROM_CAMERA, inverse, matrix_from_rpy_deg, transform
from ledpi.core.records import Floats
from tests.builders.daemon import daemon_in_thread
from tests.builders.driving import MAP, Drive, tap_of
from tests.builders.receiver import needs_gcc
from tests.builders.tap import reach
from tests.builders.waiting import limit_s

POINTS = [0.5 + 0.15j, 1.0 + 0.0j]  # of the map
DARK_FROM_M, DARK_NS = 0.4, 1_500_000_000  # from there on, for so long, it sees no panel
BASE_FROM_CAMERA = transform(CAMERA_LINK_FROM_CAMERA, np.zeros(3))


class Robot:
    """Two wheels that slip, a gyro that drifts, and a camera, in real time; it is that camera's trajectory, too."""

    moves = True

    def __init__(self) -> None:
        self._plant, self._motion = Plant(np.random.default_rng(51), np.zeros(3)), STAND
        self._rows: list[list[float]] = []  # each DT_S: x, y, yaw; the totals of both wheels and the gyro
        self._lock = threading.Lock()
        self._until_s = time.monotonic() + limit_s()
        self.camera, self._dark_ns = Drive(self), 0

    def at(self, t_ns: int) -> Floats:
        """The row at a time (CLOCK_MONOTONIC): until then it drives as it was told last. It stands where it begins."""
        return self._row((t_ns - self.camera.began_ns) * 1e-9 if self.camera.began_ns else 0.0)

    def _row(self, t_s: float) -> Floats:
        with self._lock:
            at = max(0.0, t_s / DT_S)
            while len(self._rows) < at + 2:
                self._rows.append([*self._plant.pose.tolist(), *self._plant.odometry().totals])
                self._plant.step(*self._motion)
            one, two = np.array(self._rows[int(at) : int(at) + 2])
            return one + (at % 1) * (two - one)

    def scene_from_body(self, t_s: float) -> Floats:
        x, y, yaw = self._row(t_s)[:3].tolist()
        turn = matrix_from_rpy_deg(0, 0, math.degrees(yaw))
        return inverse(BASE_FROM_CAMERA) @ transform(turn, np.array([x, y, 0.0])) @ BASE_FROM_CAMERA

    def drive(self, speed_m_s: float, turn_rad_s: float) -> None:
        assert time.monotonic() < self._until_s
        self._motion = speed_m_s, turn_rad_s
        now_ns = time.monotonic_ns()
        if not self._dark_ns and self.at(now_ns)[0] > DARK_FROM_M:
            self._dark_ns = now_ns
        self.camera.dark = now_ns - self._dark_ns < DARK_NS

    def totals(self) -> dict[str, float]:
        return dict(zip(("left_m", "right_m", "yaw_rad"), self.at(time.monotonic_ns())[3:].tolist(), strict=True))


def drive_in_c(line: int, robot: Robot) -> None:
    """The other end of the line is a file descriptor."""
    steers = steered()
    steers.begin((0.0, 0.0, 0.0), 1.0)
    for point in POINTS:
        while not steers.is_there(now_us := time.monotonic_ns() // 1000, point.real, point.imag, NEAR_M):
            with suppress(BlockingIOError):
                steers.hear(os.read(line, 4096), now_us)
            os.write(line, steers.say(now_us, **robot.totals()))
            robot.drive(*steers.go_to(now_us, point.real, point.imag))
            time.sleep(0.02)
    robot.drive(*STAND)


@pytest.mark.alone  # odometry that is held up for longer than 0.25 s is none
@pytest.mark.slow
@needs_gcc
@pytest.mark.parametrize("source", ["tap", "serial"])
def test_a_robot_drives_by_the_state(source: str, tmp_path: Path) -> None:
    """From point to point, a part of the way without a panel, so by its odometry: each state is as near as it says."""
    (tmp_path / "markers.yaml").write_text(MAP)
    line, port = os.openpty()
    os.set_blocking(line, False)
    keys = ("panels.side_m=0.16", f"map={tmp_path}/markers.yaml", f"tap.socket={tmp_path}/tap.sock")
    keys += ("rewind.seconds=0", f"odometry.source={source}", f"serial.port={os.ttyname(port)}")
    config, robot, states = load_config(None, keys), Robot(), list[dict[str, Any]]()
    try:
        with tap_of(config) as tap, daemon_in_thread(config, robot.camera, tap), reach(tmp_path / "tap.sock") as seen:
            watching = threading.Thread(
                target=lambda: states.extend(told for told in seen.lines() if told["type"] == "robot_state")
            )
            watching.start()
            if source == "tap":
                with reach(tmp_path / "tap.sock") as client:
                    drive(client, robot, go_through(POINTS))
            else:
                drive_in_c(line, robot)
            arrived_ns = time.monotonic_ns()
            seen.close()
            watching.join()
    finally:
        os.close(port)
        os.close(line)
    driven = [state for state in states if state["mode"] == "odometry" and state["t_ns"] < arrived_ns]
    assert abs(complex(*driven[-1]["position_m"]) - POINTS[-1]) < NEAR_M + 0.05
    assert max(state["way_m"] for state in driven) > 0.3  # since a panel was seen
    for state in driven:
        error_m = abs(complex(*state["position_m"]) - complex(*robot.at(state["t_ns"])[:2]))
        assert error_m < 3 * math.sqrt(state["covariance"][0] + state["covariance"][4]) + 0.005
