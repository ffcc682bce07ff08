"""Docking in closed loop: the example in C steers a simulated robot before panel 7, which is the map's origin.

Its looks err as in looks.py; what the wire tells the controller are ledpi's own bytes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Protocol

import numpy as np

from evaluation.drives.cases import HIDDEN, ODOMETRY_LATE_NS, PICTURE_LATE_NS
from evaluation.drives.looks import Looks, turned_about_camera
from evaluation.drives.robot import BASE_FROM_CAMERA, BASE_M, Plant, place, steered
from ledpi.core.records import Floats, MapPanel
from ledpi.state.estimator import Estimator, State
from ledpi.state.inputs import Look, Measured, OdometryNoise
from ledpi.wire.codec import encode
from ledpi.wire.state_message import state_message

PANEL, HEIGHT_M = 7, 0.45
SEAT = BASE_FROM_CAMERA[:2, 3]
GOAL = (-0.60, 0.0, 0.0)  # the camera half a metre before the panel
WALL_M = -0.25  # of base_link: the robot touches it
MOST_S = 60.0
EACH_STEPS, FRAME_STEPS = 2, 5  # of 10 ms: odometry and states 50 times a second, pictures 20 times


@dataclass(frozen=True, slots=True, kw_only=True)
class Docking:
    """Faults beside those that always are."""

    gyro: bool = True
    side_share: float = 0.0  # by which the panel is larger than panels.side_m says
    mount_rad: float = 0.0  # by which the camera looks to the left of where robot.camera_mount says
    dead_band_m_s: float = 0.015
    cut_s: float = math.inf  # the line to the controller


DOCKINGS = {
    "dock": Docking(),
    "dock_wheels": Docking(gyro=False),
    "dock_side": Docking(side_share=0.01),
    "dock_mount": Docking(mount_rad=math.radians(1)),
    "dock_dead": Docking(dead_band_m_s=0.04),
}


@dataclass(frozen=True, slots=True)
class Docked:
    """The end of a drive."""

    path: Floats  # (N, 3) true x, y, yaw, 20 times a second; the last is the end
    error: Floats  # x, y, yaw beside the goal
    seconds: float
    touched: bool  # the wall
    moving_s: float  # when the motors were last told to move

    @property
    def backed(self) -> bool:
        """Tells whether it backed up, and came again."""
        return bool((np.maximum.accumulate(self.path[:, 0]) - self.path[:, 0]).max() > 0.2)


def start_of(rng: np.random.Generator) -> Floats:
    """0.6 to 2.5 m from the camera to the panel, up to 50° aside of its axis, the panel up to 15° aside in view."""
    aside, away = math.radians(rng.uniform(-50, 50)), rng.uniform(0.6, 2.5) + SEAT[0]
    return np.array([-away * math.cos(aside), away * math.sin(aside), -aside + math.radians(rng.uniform(-15, 15))])


class Eyes:
    """The panel as it is seen, late, from a camera that is not quite where the configuration says."""

    def __init__(self, rng: np.random.Generator, asked: Docking) -> None:
        at = {PANEL: np.array([0.0, 0.0, math.pi])}
        self._looks, self._asked = Looks(rng, at, at, HIDDEN, HEIGHT_M), asked

    def see(self, t_s: float, pose: Floats) -> list[Look]:
        """Looks as from where base_link would be if the camera's seat were right."""
        seen = turned_about_camera(pose, self._asked.mount_rad)
        return [self._farther(look) for look in self._looks.frame(t_s, seen)]

    def _farther(self, look: Look) -> Look:
        share = 1 / (1 + self._asked.side_share)

        def moved(pose: Measured) -> Measured:
            value = pose.value.copy()
            value[:2] = SEAT + (value[:2] - SEAT) * share
            return replace(pose, value=value)

        other = None if look.alternate is None else moved(look.alternate)
        return replace(look, pose=moved(look.pose), alternate=other)


def panel_alone() -> dict[int, MapPanel]:
    """The map: its origin is the panel."""
    return {PANEL: MapPanel(map_from_marker=place(0, 0, math.pi, HEIGHT_M))}


class Steers(Protocol):
    """A program that docks."""

    def begin(self, goal: tuple[float, float, float], panel_m: float) -> None: ...

    def hear(self, line: bytes, now_us: int) -> None: ...

    def dock(self, now_us: int) -> tuple[tuple[float, float], bool]: ...


class Line:
    """Inputs to the estimator, each as late as it comes; and its states, as bytes, to what steers."""

    def __init__(self, plant: Plant, estimator: Estimator, steers: Steers) -> None:
        self._plant, self.estimator, self._steers = plant, estimator, steers
        self._late: list[tuple[int, Callable[[Any, int], object], Any]] = []
        self._sequence = 0

    def put(self, late_ns: int, add: Callable[[Any, int], object], what: object) -> None:
        """Hands something to a method of the estimator, later."""
        self._late.append((self._plant.t_ns + late_ns, add, what))

    def tell(self, is_cut: bool = False) -> State | None:
        """Odometry goes in, and the state out."""
        now_ns = self._plant.t_ns
        self.put(ODOMETRY_LATE_NS, self.estimator.add_odometry, self._plant.odometry())
        for at_ns, add, what in self._late:
            if at_ns <= now_ns:
                add(what, at_ns)
        self._late = [each for each in self._late if each[0] > now_ns]
        found = self.estimator.at(now_ns)
        state = found if isinstance(found, State) else None
        clock_us = (now_ns if state is None else state.t_ns) // 1000
        if not is_cut:
            self._steers.hear(b"\0" + encode(state_message(state, clock_us=clock_us), self._sequence), now_ns // 1000)
            self._sequence = self._sequence % 0xFFFF + 1
        return state


def dock(seed: int, asked: Docking, steers: Steers | None = None) -> Docked:
    """Drives once; steered by the example in C where nothing else is given."""
    steers = steers or steered()
    rng = np.random.default_rng([seed, 7])
    plant = Plant(rng, start_of(rng), asked.dead_band_m_s, asked.gyro)
    eyes = Eyes(rng, asked)
    estimator = Estimator(panel_alone(), BASE_FROM_CAMERA, OdometryNoise(base_m=BASE_M))
    motion, docked, moving_s, ends_s = (0.0, 0.0), False, 0.0, min(MOST_S, asked.cut_s + 1)
    path = [plant.pose]
    steers.begin(GOAL, -GOAL[0])
    line = Line(plant, estimator, steers)
    while plant.t_ns < ends_s * 1e9 and plant.pose[0] < WALL_M and not docked:
        plant.step(*motion)
        now_s = plant.t_ns * 1e-9
        if plant.k % FRAME_STEPS == 0:
            path.append(plant.pose)
            for look in eyes.see(now_s, plant.pose):
                line.put(PICTURE_LATE_NS, estimator.add_look, look)
        if plant.k % EACH_STEPS == 0:
            line.tell(is_cut=now_s >= asked.cut_s)
            motion, docked = steers.dock(plant.t_ns // 1000)
            moving_s = now_s if any(motion) else moving_s
    path.append(plant.pose)
    return Docked(np.array(path), plant.pose - GOAL, plant.t_ns * 1e-9, bool(plant.pose[0] >= WALL_M), moving_s)


def docking_row(asked: Docking, seed: int) -> dict[str, float]:
    """A line of the table."""
    done = dock(seed, asked)
    off_mm, off_deg = 1e3 * float(np.hypot(*done.error[:2])), math.degrees(abs(done.error[2]))
    return {"dock_mm": off_mm, "dock_deg": off_deg, "dock_s": done.seconds, "touched": float(done.touched)}
