"""The room of 8 × 6 m, with a panel of 16 cm each 3 to 4 m of wall, and a differential drive in it.

That goes between way-points, with what its wheels and gyro say; or it is steered by the example in C.
"""

from __future__ import annotations

import ctypes
import math
import subprocess
import tempfile
from collections import deque
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from evaluation import ROOT
from ledpi.core.geometry import CAMERA_LINK_FROM_CAMERA, FACING_FROM_MARKER, matrix_from_rpy_deg, transform
from ledpi.core.records import Floats, MapPanel
from ledpi.pose.planar import square_corners
from ledpi.state.inputs import Odometry, wrapped

SIDE_M, HEIGHT_M = 0.16, 0.9
PANELS = {  # x, y, and the yaw that it faces, degrees
    7: (8.0, 1.5, 180.0),
    23: (8.0, 4.5, 180.0),
    43: (0.0, 1.5, 0.0),
    11: (0.0, 4.5, 0.0),
    5: (2.0, 0.0, 90.0),
    12: (6.0, 0.0, 90.0),
    28: (2.0, 6.0, -90.0),
    41: (6.0, 6.0, -90.0),
}
MIDDLE = np.array([4.0, 3.0])
BASE_FROM_CAMERA = transform(matrix_from_rpy_deg(0, -6, 0) @ CAMERA_LINK_FROM_CAMERA, np.array([0.10, 0.0, 0.40]))
CAMERA_FROM_BASE = np.linalg.inv(BASE_FROM_CAMERA)
FOCAL_PX, WIDTH, HEIGHT, MARGIN_PX = 643.0, 640, 480, 3.0
MOST_INCIDENCE, MOST_RANGE_M = math.radians(75), 7.0


def place(x: float, y: float, yaw_rad: float, height_m: float = HEIGHT_M) -> Floats:
    """map_from_marker (4, 4) of a panel that faces along `yaw_rad`."""
    return transform(matrix_from_rpy_deg(0, 0, math.degrees(yaw_rad)) @ FACING_FROM_MARKER, np.array([x, y, height_m]))


def map_of(places: dict[int, Floats], position_m: float, angle_rad: float) -> dict[int, MapPanel]:
    """The map that says so of its panels, with its deviations."""
    return {
        panel: MapPanel(map_from_marker=place(*at), position_sigma_m=position_m, angle_sigma_rad=angle_rad)
        for panel, at in places.items()
    }


def is_in_view(base_from_marker: Floats) -> bool:
    """Tells whether the camera sees all of a panel, not too obliquely."""
    if base_from_marker[0, 3] < abs(base_from_marker[1, 3]):  # more than 45° aside
        return False
    camera_from_marker = CAMERA_FROM_BASE @ base_from_marker
    centre, normal = camera_from_marker[:3, 3], camera_from_marker[:3, 2]
    distance = float(np.linalg.norm(centre))
    if centre[2] < 0.2 or distance > MOST_RANGE_M or -normal @ centre < distance * math.cos(MOST_INCIDENCE):
        return False
    corners = square_corners(SIDE_M) @ camera_from_marker[:3, :3].T + centre
    px = FOCAL_PX * corners[:, :2] / corners[:, 2:] + (WIDTH / 2, HEIGHT / 2)
    return bool((px > MARGIN_PX).all() and (px < np.array([WIDTH, HEIGHT]) - MARGIN_PX).all())


DT_S = 0.01  # of the truth, and of odometry
BASE_M = 0.30
SPEED_M_S, TURN_RAD_S, ACCELERATION, TURN_ACCELERATION = 0.5, 1.0, 0.8, 3.0
ARRIVED_M = 0.3
SLIP, SLIP_FADES_S = 0.03, 0.5
WHEEL_STEP_M = 0.0005


@dataclass(frozen=True, slots=True)
class Way:
    """The robot's way: (N, 3) x, y, yaw, and (N, 2) speed and turn rate, each DT_S."""

    poses: Floats
    velocities: Floats

    def pose(self, t_s: float) -> Floats:
        """Between two of them."""
        k = min(int(t_s / DT_S), len(self.poses) - 2)
        one, two = self.poses[k], self.poses[k + 1]
        share = t_s / DT_S - k
        x, y = one[:2] + share * (two[:2] - one[:2])
        return np.array([x, y, wrapped(one[2] + share * wrapped(two[2] - one[2]))])


def drive(rng: np.random.Generator, seconds: float) -> Way:
    """Way-points at random in the middle of the room."""
    count = round(seconds / DT_S) + 1
    poses, velocities = np.zeros((count, 3)), np.zeros((count, 2))
    reach = np.array([2.4, 1.4])
    low, high = MIDDLE - reach, MIDDLE + reach
    (x, y), yaw = rng.uniform(low, high), rng.uniform(-math.pi, math.pi)
    goal, speed, rate = rng.uniform(low, high), 0.0, 0.0
    for k in range(count):
        poses[k], velocities[k] = (x, y, yaw), (speed, rate)
        if math.hypot(goal[0] - x, goal[1] - y) < ARRIVED_M:
            goal = rng.uniform(low, high)
        aside = wrapped(math.atan2(goal[1] - y, goal[0] - x) - yaw)
        want, turn = SPEED_M_S * max(0.0, math.cos(aside)), max(-TURN_RAD_S, min(TURN_RAD_S, 2 * aside))
        speed += max(-ACCELERATION * DT_S, min(ACCELERATION * DT_S, want - speed))
        rate += max(-TURN_ACCELERATION * DT_S, min(TURN_ACCELERATION * DT_S, turn - rate))
        x += speed * DT_S * math.cos(yaw + rate * DT_S / 2)
        y += speed * DT_S * math.sin(yaw + rate * DT_S / 2)
        yaw = wrapped(yaw + rate * DT_S)
    return Way(poses, velocities)


def odometry(rng: np.random.Generator, way: Way) -> list[Odometry]:
    """Each wheel slips by itself, for half a second; wheels 1 % too large, unlike by 0.3 %; a gyro with bias and scale.

    All is there; a case takes what it has.
    """
    speed, rate = way.velocities.T
    count = len(speed)
    slip = faded_noise(rng, (count, 2), SLIP, SLIP_FADES_S)
    scales = 1.0 + rng.normal(0, 0.01) + rng.normal(0, 0.003, 2)
    wheels = np.stack([speed - rate * BASE_M / 2, speed + rate * BASE_M / 2], axis=1)
    totals = np.floor(np.cumsum(wheels * (scales + slip) * DT_S, axis=0) / WHEEL_STEP_M) * WHEEL_STEP_M
    bias = math.radians(rng.normal(0, 0.5)) + np.cumsum(rng.normal(0, math.radians(0.01) * math.sqrt(DT_S), count))
    noise = rng.normal(0, math.radians(0.05) / math.sqrt(DT_S), count)
    yaw = np.cumsum((rate * (1 + rng.normal(0, 0.01)) + bias + noise) * DT_S)
    return [
        # velocities[k] leads from pose k - 1 to pose k, so the totals at k are of the way until then.
        Odometry(t_ns=round(k * DT_S * 1e9), left_m=left, right_m=right, yaw_rad=turned)
        for k, ((left, right), turned) in enumerate(zip(totals.tolist(), yaw.tolist(), strict=True))
    ]


def faded_noise(rng: np.random.Generator, shape: tuple[int, int], deviation: float, fades_s: float) -> Floats:
    """A Gauss-Markov process, each DT_S."""
    keeps = math.exp(-DT_S / fades_s)
    steps = rng.standard_normal(shape) * deviation * math.sqrt(1 - keeps**2)
    noise = np.zeros(shape)
    noise[0] = rng.standard_normal(shape[1]) * deviation
    for k in range(1, len(noise)):
        noise[k] = keeps * noise[k - 1] + steps[k]
    return noise


COMMAND_LATE_S, LAG_S = 0.06, 0.12
GYRO_BIAS, GYRO_SCALE, GYRO_NOISE = math.radians(0.5), 0.01, math.radians(0.05)
FLAGS = ("-std=c99", "-pedantic", "-O2", "-Wall", "-Wextra", "-Wconversion", "-Werror", "-fPIC", "-shared")
STEP_NS = round(DT_S * 1e9)


class Plant:
    """Two driven wheels, each with its motor's lag and dead band, that slip; what wheels and gyro say of it."""

    def __init__(
        self, rng: np.random.Generator, pose: Floats, dead_band_m_s: float = 0.015, has_gyro: bool = True
    ) -> None:
        self._rng, self.pose, self._dead_band, self._has_gyro = rng, pose.copy(), dead_band_m_s, has_gyro
        self.k = 0  # steps of DT_S
        self._wheels, self._slip, self._totals, self._yaw = np.zeros(2), rng.normal(0, SLIP, 2), np.zeros(2), 0.0
        self._scales = 1 + rng.normal(0, 0.01) + rng.normal(0, 0.003, 2)
        self._bias, self._gyro_scale = rng.normal(0, GYRO_BIAS), 1 + rng.normal(0, GYRO_SCALE)
        self._commands = deque([(0.0, 0.0)] * round(COMMAND_LATE_S / DT_S))

    @property
    def t_ns(self) -> int:
        return self.k * STEP_NS

    def step(self, speed_m_s: float, turn_rad_s: float) -> None:
        """Goes on by DT_S; the motors hear later what they are told now."""
        self._commands.append((speed_m_s, turn_rad_s))
        speed, turn = self._commands.popleft()
        told = np.array([speed - turn * BASE_M / 2, speed + turn * BASE_M / 2])
        told[abs(told) < self._dead_band] = 0.0
        self._wheels += (told - self._wheels) * DT_S / LAG_S
        keeps = math.exp(-DT_S / SLIP_FADES_S)
        self._slip = keeps * self._slip + math.sqrt(1 - keeps**2) * self._rng.normal(0, SLIP, 2)
        way, rate = float(self._wheels.mean()) * DT_S, float(np.diff(self._wheels)[0]) / BASE_M
        x, y, yaw = self.pose.tolist()
        heading = yaw + rate * DT_S / 2
        self.pose = np.array([x + way * math.cos(heading), y + way * math.sin(heading), wrapped(yaw + rate * DT_S)])
        self._totals += self._wheels * (self._scales + self._slip) * DT_S
        noise = self._rng.normal(0, GYRO_NOISE * math.sqrt(DT_S))
        self._yaw += (rate * self._gyro_scale + self._bias) * DT_S + noise
        self.k += 1

    def odometry(self) -> Odometry:
        left, right = (np.floor(self._totals / WHEEL_STEP_M) * WHEEL_STEP_M).tolist()
        return Odometry(t_ns=self.t_ns, left_m=left, right_m=right, yaw_rad=self._yaw if self._has_gyro else None)


class _Robot(ctypes.Structure):
    _fields_ = [(name, ctypes.c_float) for name in ("base_m", "fastest_m_s", "slowest_m_s", "settles_s")]


class _Pose(ctypes.Structure):
    _fields_ = [(name, ctypes.c_float) for name in ("x_m", "y_m", "yaw_rad")]


class _Motion(ctypes.Structure):
    _fields_ = [(name, ctypes.c_float) for name in ("speed_m_s", "turn_rad_s")]


class _Dock(ctypes.Structure):
    _fields_ = [
        ("goal", _Pose),
        *((name, ctypes.c_float) for name in ("panel_m", "within_m", "within_rad")),
        ("tries", ctypes.c_uint8),
        ("phase", ctypes.c_int),
        ("pulse", _Motion),
        *((name, ctypes.c_uint32) for name in ("pulse_ends_us", "looks_from_us")),
    ]


@dataclass(frozen=True, slots=True)
class Steered:
    """The compiled example: one robot at a time."""

    library: ctypes.CDLL

    def begin(self, goal: tuple[float, float, float], panel_m: float) -> None:
        """Forgets everything; `goal` is base_link's pose before the panel, which is so far ahead of it."""
        robot = _Robot(BASE_M, 0.35, 0.045, COMMAND_LATE_S + LAG_S)
        dock = _Dock(goal=_Pose(*goal), panel_m=panel_m, within_m=0.003, within_rad=math.radians(0.3), tries=5)
        self.library.begin(robot, dock)

    def hear(self, line: bytes, now_us: int) -> None:
        self.library.hear(line, len(line), ctypes.c_uint32(now_us))

    def say(self, now_us: int, left_m: float, right_m: float, yaw_rad: float) -> bytes:
        """Odometry, and an answer for the clock if one is due."""
        bytes_ = (ctypes.c_uint8 * 64)()
        totals = (ctypes.c_int32(round(1e4 * total)) for total in (left_m, right_m, yaw_rad))
        return bytes(bytes_[: self.library.say(bytes_, ctypes.c_uint32(now_us), *totals)])

    def dock(self, now_us: int) -> tuple[tuple[float, float], bool]:
        """Speed and turn rate, and whether it has docked."""
        phase = ctypes.c_uint8()
        motion = self.library.step_to_dock(ctypes.c_uint32(now_us), ctypes.byref(phase))
        return (motion.speed_m_s, motion.turn_rad_s), phase.value == 3

    def go_to(self, now_us: int, x_m: float, y_m: float) -> tuple[float, float]:
        motion = self.library.step_to(ctypes.c_uint32(now_us), ctypes.c_float(x_m), ctypes.c_float(y_m))
        return motion.speed_m_s, motion.turn_rad_s

    def is_there(self, now_us: int, x_m: float, y_m: float, within_m: float) -> bool:
        floats = (ctypes.c_float(value) for value in (x_m, y_m, within_m))
        return bool(self.library.is_there(ctypes.c_uint32(now_us), *floats))


@cache
def steered() -> Steered:
    """Compiles it for this machine, once."""
    with tempfile.TemporaryDirectory() as folder:
        built = Path(folder) / "steered.so"
        headers = [f"-I{ROOT / each}" for each in ("firmware/receiver", "firmware/drive")]
        source = ROOT / "evaluation/drives/steered.c"
        subprocess.run(["gcc", *FLAGS, *headers, "-o", str(built), str(source), "-lm"], check=True)
        library = ctypes.CDLL(str(built))
    library.step_to_dock.restype = library.step_to.restype = _Motion
    library.is_there.restype = ctypes.c_bool
    library.begin.argtypes = [_Robot, _Dock]
    return Steered(library)
