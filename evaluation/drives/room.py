"""The room, its panels, and the camera on the robot: 8 × 6 m, a panel of 16 cm each 3 to 4 m of wall."""

from __future__ import annotations

import math

import numpy as np

from ledpi.core.geometry import CAMERA_LINK_FROM_CAMERA, FACING_FROM_MARKER, matrix_from_rpy_deg, transform
from ledpi.core.records import Floats
from ledpi.pose.panel_map import MapPanel
from ledpi.pose.planar import square_corners

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
