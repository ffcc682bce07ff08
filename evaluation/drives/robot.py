"""A differential drive between way-points, and what its wheels and its gyro say of that."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from evaluation.drives.room import MIDDLE
from ledpi.core.records import Floats
from ledpi.state.inputs import Odometry, wrapped

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
