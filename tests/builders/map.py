"""Robots before mapped panels: what a camera would see, projected here, with errors of sides as they are fitted."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import cv2
import numpy as np

from ledpi.core.records import Detection, Floats, Frame, MapPanel, MarkerPose, PlanarSolution, RobotFix
from ledpi.pose.fix import Robot
from ledpi.pose.place import Placer
from tests.builders.decode import LENS

SIDE_M = 0.16
SIGMA_PX = 0.05
FLOOR_PX = 0.0424  # of a corner's coordinate, beside that
PERIOD_NS = 16_966_000
CAMERA_LINK_FROM_OPTICAL = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # REP-103


def pose(position_m: tuple[float, float, float], yaw_deg: float = 0.0, pitch_deg: float = 0.0) -> Floats:
    """(4, 4): yaw about z, after pitch about y."""
    y, p = math.radians(yaw_deg), math.radians(pitch_deg)
    turn = np.array([[math.cos(y), -math.sin(y), 0], [math.sin(y), math.cos(y), 0], [0, 0, 1]])
    tilt = np.array([[math.cos(p), 0, math.sin(p)], [0, 1, 0], [-math.sin(p), 0, math.cos(p)]])
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn @ tilt, position_m
    return matrix


def panel(position_m: tuple[float, float, float], yaw_deg: float, pitch_deg: float = 0.0) -> Floats:
    """map_from_marker of a panel that faces along x at yaw 0: its z is x then, its x is y, its y is z."""
    matrix = pose(position_m, yaw_deg, pitch_deg)
    matrix[:3, :3] = matrix[:3, :3] @ np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    return matrix


# A wall 3 m ahead of the map's origin with three panels, turned towards the middle.
WALL = {7: panel((3.0, 0.7, 1.2), 200), 8: panel((3.2, 0.0, 1.7), 180, 15), 9: panel((2.9, -0.8, 1.0), 155)}
MOUNT = pose((0.2, 0.05, 0.4), 5.0, -10.0)  # base_link_from_camera_link: looks up a little


def optical(base_link_from_camera_link: Floats) -> Floats:
    matrix = base_link_from_camera_link.copy()
    matrix[:3, :3] = matrix[:3, :3] @ CAMERA_LINK_FROM_OPTICAL
    return matrix


def seen_corners(map_from_base: Floats, map_from_marker: Floats, mount: Floats = MOUNT) -> Floats:
    """(4, 2), through OpenCV's projection."""
    h = SIDE_M / 2
    square = np.array([[-h, h, 0, 1], [h, h, 0, 1], [h, -h, 0, 1], [-h, -h, 0, 1]])
    camera_from_map = np.linalg.inv(map_from_base @ optical(mount))
    points = np.ascontiguousarray((square @ (camera_from_map @ map_from_marker).T)[:, :3])
    still = np.zeros(3)
    pixels = cv2.projectPoints(points, still, still, LENS.matrix(), np.array(LENS.distortion))[0]
    return np.asarray(pixels.reshape(4, 2), np.float64)


def covariance_px2(corners: Floats, sigma_px: float = SIGMA_PX) -> Floats:
    """(8, 8) of corners where sides cross that were fitted to edges, each side for itself.

    Of a line through n edges of spread s the middle errs by s/√n = σ/2, its ends about the middle by √3 times that. A
    corner moves by d where the lines' normals n have n·d = the shifts that they have there.
    """
    following = np.roll(corners, -1, axis=0)
    along = following - corners
    normals = np.column_stack([-along[:, 1], along[:, 0]]) / np.hypot(*along.T)[:, None]
    moved = np.zeros((8, 8))  # corners' x and y by each side's shift and turn
    for k in range(4):
        back = (k - 1) % 4
        by_shift = np.linalg.inv(np.stack([normals[k], normals[back]]))
        moved[2 * k : 2 * k + 2, [k, 4 + k]] = np.outer(by_shift[:, 0], [1, -1])
        moved[2 * k : 2 * k + 2, [back, 4 + back]] = np.outer(by_shift[:, 1], [1, 1])
    moved *= np.repeat([sigma_px / 2, math.sqrt(3) * sigma_px / 2], 4)
    return np.asarray(moved @ moved.T)


def with_errors(corners: Floats, rng: np.random.Generator, sigma_px: float = SIGMA_PX) -> Floats:
    """Corners with errors of `covariance_px2`, and of what the fit does not show."""
    spread = np.linalg.cholesky(covariance_px2(corners, sigma_px) + FLOOR_PX**2 * np.eye(8))
    return corners + (spread @ rng.standard_normal(8)).reshape(4, 2)


def frame(seq: int = 0) -> Frame:
    return Frame(
        pixels=np.zeros((480, 640), np.uint8),
        seq=seq,
        row0_readout_ns=1_000_000_000 + seq * PERIOD_NS,
        exposure_us=9966.32,
        row_time_us=33.67,
        transfer="srgb",
    )


def detection(marker_id: int, corners: Floats) -> Detection:
    """Makes that of a panel that has been followed, before a camera that stands still."""
    return Detection(
        id=marker_id,
        corners_px=corners,
        covariance_px2=covariance_px2(corners),
        margin=40.0,
        frames_used=4,
        velocity_px_s=np.zeros((4, 2)),
    )


@dataclass
class Driver:
    """A path's last two stages over frames, fed with corners."""

    panels: Mapping[int, Floats] = field(default_factory=lambda: WALL)
    sigma_m: float = 0.0  # of the map
    sigma_rad: float = 0.0
    upright: bool = False
    stream: bool = True
    seq: int = 0

    def __post_init__(self) -> None:
        known = {
            i: MapPanel(map_from_marker=place, position_sigma_m=self.sigma_m, angle_sigma_rad=self.sigma_rad)
            for i, place in self.panels.items()
        }
        robot = Robot(base_link_from_camera=optical(MOUNT), panels=known, panels_upright=self.upright)
        self._placer = Placer(LENS, dict.fromkeys(range(50), SIDE_M), stream=self.stream, robot=robot)

    def see(self, corners: Mapping[int, Floats]) -> tuple[list[MarkerPose], RobotFix | str | None]:
        """The next frame: markers, and the fix or the reason that there is none."""
        self.seq += 1
        answers = self._placer.place(frame(self.seq), [detection(i, c) for i, c in corners.items()])
        markers = [answer for answer in answers if isinstance(answer, MarkerPose)]
        assert len(markers) == len(answers)
        fix = self._placer.fix(frame(self.seq), markers)
        return markers, fix if fix is None or isinstance(fix, RobotFix) else fix.key

    def fix_with(self, marker: MarkerPose, solution: PlanarSolution) -> tuple[None, RobotFix | str | None]:
        """The fix of a single panel of the last frame, were this its pose."""
        fix = self._placer.fix(frame(self.seq), [replace(marker, solution=solution, alternate=None)])
        return None, fix if fix is None or isinstance(fix, RobotFix) else fix.key


def errors(fix: RobotFix, map_from_base: Floats) -> Floats:
    """(6,) position, and rotation about the map's axes."""
    w, *xyz = fix.map_from_base_link.quaternion_wxyz
    axis = np.array(xyz)
    length = float(np.linalg.norm(axis))
    rotation = cv2.Rodrigues(axis / max(length, 1e-12) * 2 * math.atan2(length, w))[0]
    turn = cv2.Rodrigues(rotation @ map_from_base[:3, :3].T)[0][:, 0]
    return np.concatenate([fix.map_from_base_link.position_m - map_from_base[:3, 3], turn])
