"""Motions of bodies: the pose scene_from_body as a function of time, as (4, 4) matrices."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import ClassVar, Protocol

import cv2
import numpy as np

from ledpi.core.geometry import transform
from ledpi.core.records import Floats


class Trajectory(Protocol):
    """A body's path through the scene."""

    @property
    def moves(self) -> bool:
        """Tells whether the pose ever changes: what stands still is rendered once."""
        ...

    def scene_from_body(self, t_s: float) -> Floats:
        """(4, 4) pose at `t_s` seconds of the camera's clock."""
        ...


def rotation(vector_rad: Floats) -> Floats:
    """(3, 3) rotation about `vector_rad` by its length (Rodrigues)."""
    return np.asarray(cv2.Rodrigues(np.asarray(vector_rad, np.float64))[0], np.float64)


def facing_camera(position_m: Floats, *, pitch_deg: float = 0.0, yaw_deg: float = 0.0, roll_deg: float = 0.0) -> Floats:
    """Pose of a panel at a position: square to the scene's z axis, then turned about the scene's axes.

    Unturned, the marker's x is the scene's, its y points up, and its z back at the camera. Roll (about z)
    comes first, then pitch (about x), then yaw (about y).
    """
    x, y, z = np.eye(3)
    turn = rotation(y * math.radians(yaw_deg)) @ rotation(x * math.radians(pitch_deg))
    turn = turn @ rotation(z * math.radians(roll_deg))
    return transform(turn @ np.diag([1.0, -1.0, -1.0]), position_m)


@dataclass(frozen=True, slots=True, eq=False)
class Still:
    """Stays where it is."""

    pose: Floats = field(default_factory=lambda: np.eye(4))  # (4, 4)
    moves: ClassVar[bool] = False

    def scene_from_body(self, t_s: float) -> Floats:
        """As `Trajectory.scene_from_body`."""
        return self.pose


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Gliding:
    """Constant linear and angular velocity, both along the scene's axes; `start` is the pose at `start_s`."""

    start: Floats  # (4, 4)
    velocity_m_s: Floats  # (3,)
    angular_velocity_rad_s: Floats = field(default_factory=lambda: np.zeros(3))  # (3,)
    start_s: float = 0.0
    moves: ClassVar[bool] = True

    def scene_from_body(self, t_s: float) -> Floats:
        """As `Trajectory.scene_from_body`."""
        elapsed = t_s - self.start_s
        turn = rotation(self.angular_velocity_rad_s * elapsed)
        return transform(turn @ self.start[:3, :3], self.start[:3, 3] + self.velocity_m_s * elapsed)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shown:
    """Held before the camera by hand: at one place after another for a while, for ever.

    Of each `each_s` the body rests for the first part and is carried on, evenly, in what is left.
    """

    places: tuple[tuple[Floats, Floats], ...]  # position (3,) in metres; pitch, yaw, roll (3,) as of `facing_camera`
    each_s: float
    rest_s: float
    start_s: float = 0.0
    moves: ClassVar[bool] = True

    def scene_from_body(self, t_s: float) -> Floats:
        """As `Trajectory.scene_from_body`."""
        turn, since_s = divmod(t_s - self.start_s, self.each_s)
        now, after = (self.places[int(turn + k) % len(self.places)] for k in (0, 1))
        share = max(0.0, since_s - self.rest_s) / (self.each_s - self.rest_s)
        position, angles_deg = (a + share * (b - a) for a, b in zip(now, after, strict=True))
        pitch_deg, yaw_deg, roll_deg = angles_deg.tolist()
        return facing_camera(position, pitch_deg=pitch_deg, yaw_deg=yaw_deg, roll_deg=roll_deg)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Patrol:
    """A camera that drives a figure of eight for ever, level, and keeps looking at a point.

    x swings twice while z goes out and back once, so the path closes smoothly after each period.
    """

    period_s: float
    centre_m: Floats  # (3,)
    swing_m: tuple[float, float]  # half the width in x and in z
    looks_at_m: Floats  # (3,)
    moves: ClassVar[bool] = True

    def scene_from_body(self, t_s: float) -> Floats:
        """As `Trajectory.scene_from_body`."""
        turn = 2.0 * math.pi * math.fmod(t_s, self.period_s) / self.period_s
        shift = np.array([self.swing_m[0] * math.sin(2.0 * turn), 0.0, -self.swing_m[1] * math.cos(turn)])
        position = self.centre_m + shift
        ahead = self.looks_at_m - position
        heading = math.atan2(ahead[0], ahead[2])
        c, s = math.cos(heading), math.sin(heading)
        return transform(np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]]), position)
