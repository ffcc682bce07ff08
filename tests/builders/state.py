"""A robot among panels, as the state hears of it: no noise, all by hand."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ledpi.core.geometry import matrix_from_rpy_deg
from ledpi.core.records import Floats, MapPanel
from ledpi.state.estimator import Estimator, State
from ledpi.state.inputs import Look, Measured, Odometry, wrapped
from tests.builders.map import panel

FACES = {1: (4.0, 0.0, 180.0), 2: (0.0, 3.0, -90.0), 3: (-4.0, 0.0, 0.0), 4: (0.0, -3.0, 90.0)}  # x, y, yaw
SECOND_NS = 1_000_000_000
RATE = 0.5  # rad/s of a circle of 1 m
SEAT = np.eye(4)  # camera and base_link in one place, as far as the plane matters


def room(place_m: float = 0.01, angle_rad: float = 0.01) -> dict[int, MapPanel]:
    """Four panels about the origin, on a cross."""
    return {
        i: MapPanel(map_from_marker=panel((x, y, 1.0), yaw), position_sigma_m=place_m, angle_sigma_rad=angle_rad)
        for i, (x, y, yaw) in FACES.items()
    }


def look(
    panel_id: int, pose: tuple[float, float, float], t_s: float, aside_m: float = 0.0, mirror_rad: float | None = None
) -> Look:
    """A look from x, y, yaw, at a panel that hangs so far to the left of where the map has it, seen from its front."""
    x, y, yaw = pose
    px, py, face = FACES[panel_id]
    px, py = px - aside_m * math.sin(math.radians(face)), py + aside_m * math.cos(math.radians(face))
    c, s = math.cos(yaw), math.sin(yaw)
    at = np.array([c * (px - x) + s * (py - y), c * (py - y) - s * (px - x)])
    return Look(
        t_ns=round(t_s * SECOND_NS),
        panel=panel_id,
        pose=_measured(at, yaw),
        alternate=None if mirror_rad is None else _measured(at, wrapped(yaw + mirror_rad)),
        range_share=0.01,
        heading_rad=0.01,
        above_m=1.0,
    )


def _measured(at: Floats, yaw: float) -> Measured:
    return Measured(value=np.array([*at, yaw]), covariance=np.diag([1e-4, 1e-5, 1e-4]))


def by_turned_camera(seen: Look, roll_rad: float, pitch_rad: float, yaw_rad: float) -> Look:
    """The same look through a camera, at base_link's origin, that is turned from where it is believed to be."""
    believed = matrix_from_rpy_deg(*np.degrees([roll_rad, pitch_rad, yaw_rad])).T
    x, y, heading = seen.pose.value
    x, y, above_m = (believed @ [x, y, seen.above_m]).tolist()
    value = np.array([x, y, wrapped(heading + yaw_rad)])
    return replace(seen, pose=replace(seen.pose, value=value), above_m=above_m)


def odometry(t_s: float, way_m: float = 0.0, yaw_rad: float = 0.0) -> Odometry:
    """Totals of a robot with a gyro."""
    return Odometry(t_ns=round(t_s * SECOND_NS), left_m=way_m, right_m=way_m, yaw_rad=yaw_rad)


def heard(estimator: Estimator, *inputs: Look | Odometry) -> list[str]:
    """Hands inputs over as if they arrived at once; returns why some were rejected."""
    rejected = []
    for each in inputs:
        add = estimator.add_look(each, each.t_ns) if isinstance(each, Look) else estimator.add_odometry(each, each.t_ns)
        rejected += [] if add is None else [add.key]
    return rejected


def still(
    estimator: Estimator, panels: Mapping[int, float], pose: tuple[float, float, float], from_s: float, seconds: float
) -> None:
    """A robot that stands, hears its odometry at 20 Hz and sees panels, each hanging so far aside."""
    for t_s in np.arange(from_s, from_s + seconds, 0.05).tolist():
        heard(estimator, odometry(t_s), *(look(i, pose, t_s, aside) for i, aside in panels.items()))


def state_at(estimator: Estimator, t_s: float) -> State:
    state = estimator.at(round(t_s * SECOND_NS))
    assert isinstance(state, State), state
    return state


def on_circle(t_s: float) -> tuple[float, float, float]:
    """The pose of a robot that drives a circle of 1 m about the origin."""
    return math.cos(RATE * t_s), math.sin(RATE * t_s), RATE * t_s + math.pi / 2


def drive(seconds: float = 1.5) -> list[Look | Odometry]:
    """Odometry at 100 Hz, and a look at a panel or two 30 times a second."""
    times = np.arange(1, round(seconds * 100)) * 0.01
    totals = [odometry(t, way_m=RATE * t, yaw_rad=RATE * t) for t in times.tolist()]
    looks = [look(i, on_circle(t), t) for t in (times[::3] + 0.004).tolist() for i in (2, 3)[: 1 + (t > 0.5)]]
    return sorted([*totals, *looks], key=lambda each: each.t_ns)
