"""Puts things before the camera so that they are wholly in view, and do not hide each other."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import TypeVar

import numpy as np

from ledpi.camera.simulate.optics import project
from ledpi.camera.simulate.render import panel_corners_m
from ledpi.camera.simulate.scene import SimulatedSensor
from ledpi.camera.simulate.trajectory import facing_camera
from ledpi.core.lens import undistort
from ledpi.core.records import Floats

MARGIN_PX = 16.0  # between a panel's corner and the picture's edge
_TRIES = 30
Thing = TypeVar("Thing")


class NoRoomError(Exception):
    """No free place was found."""


def as_room_is(count: int, make: Callable[[], Thing]) -> tuple[Thing, ...]:
    """So many things, but for those that find no room."""
    made = []
    for _ in range(count):
        with suppress(NoRoomError):
            made.append(make())
    return tuple(made)


def turned_from_sight(position_m: Floats, angle_deg: float, roll_deg: float) -> Floats:
    """Pose of a panel, rolled, whose normal makes `angle_deg` with the line of sight; positive: it faces the left."""
    x, y, z = position_m.tolist()
    yaw_deg, pitch_deg = math.degrees(math.atan2(x, z)), -math.degrees(math.atan2(y, math.hypot(x, z)))
    sight = facing_camera(position_m, yaw_deg=yaw_deg, pitch_deg=pitch_deg) @ np.diag([1.0, -1.0, -1.0, 1.0])
    return np.asarray(sight @ facing_camera(np.zeros(3), yaw_deg=angle_deg, roll_deg=roll_deg))


def place_in_view(
    panels: Sequence[tuple[float, float, float]],
    distance_m: float,
    angle_deg: float,
    offset_px: Floats,
    sensor: SimulatedSensor,
) -> list[Floats]:
    """Poses of panels (shift to the right in metres, side in metres, roll in degrees), `offset_px` off the middle.

    The offset is cut down until all are in view; without one they stand in the middle, in view or not.
    """
    lens = sensor.intrinsics
    middle = np.array([(lens.width - 1) / 2.0, (lens.height - 1) / 2.0])
    poses: list[Floats] = []
    for share in (1.0, 0.75, 0.5, 0.25, 0.0):
        ray = np.append(undistort((middle + share * offset_px)[None], lens)[0], 1.0)
        centre_m = distance_m * ray / np.linalg.norm(ray)
        centres_m = [centre_m + np.array([shift_m, 0.0, 0.0]) for shift_m, _, _ in panels]
        poses = [turned_from_sight(at, angle_deg, roll) for at, (_, _, roll) in zip(centres_m, panels, strict=True)]
        if all(_is_in_view(pose, side, sensor) for pose, (_, side, _) in zip(poses, panels, strict=True)):
            break
    return poses


def _is_in_view(pose: Floats, side_m: float, sensor: SimulatedSensor) -> bool:
    pixels = project(panel_corners_m(side_m), pose, sensor.intrinsics)
    far = np.array([sensor.intrinsics.width, sensor.intrinsics.height]) - 1.0 - MARGIN_PX
    return bool(np.all(pixels >= MARGIN_PX) and np.all(pixels <= far))


class Placer:
    """Finds free places in one picture. What has a place is taken as a disc around its centre."""

    def __init__(self, sensor: SimulatedSensor, rng: np.random.Generator) -> None:
        self._sensor = sensor
        self._rng = rng
        self._taken: list[tuple[Floats, float]] = []  # centre and radius in pixels

    def keep_free(self, position_m: Floats, size_m: float) -> None:
        """Nothing is put where this is."""
        lens = self._sensor.intrinsics
        centre = project(position_m[None], np.eye(4), lens)[0]
        self._taken.append((centre, _radius_px(size_m * lens.fx / float(position_m[2]))))

    def place(self, size_m: float, size_px: float) -> Floats:
        """(3,) m where a thing of that size has room, and is so large in the picture. Raises NoRoomError."""
        lens = self._sensor.intrinsics
        radius = _radius_px(size_px)
        inset = 0.8 * min(radius, lens.height / 2.5)  # a few are cut by the picture's edge
        for _ in range(_TRIES):
            centre = self._rng.uniform((inset, inset), (lens.width - inset, lens.height - inset))
            if all(np.hypot(*(centre - other)) > radius + taken for other, taken in self._taken):
                self._taken.append((centre, radius))
                return np.asarray(size_m * lens.fx / size_px * np.append(undistort(centre[None], lens)[0], 1.0))
        raise NoRoomError


def _radius_px(size_px: float) -> float:
    """Returns that of the disc that a square of that size turns in, its bezel included, and a little more."""
    return 0.8 * size_px + 4.0
