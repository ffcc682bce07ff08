"""Calibration boards before a known camera: as pictures, ray by ray, and as corners alone."""

from __future__ import annotations

from functools import cache

import cv2
import numpy as np

from ledpi.core.lens import undistort
from ledpi.core.records import Floats, Intrinsics, Pixels
from ledpi.workshop.calibrate.boards import TEXELS, Board, BoardView

BOARD = Board(columns=6, rows=5)
LENS = Intrinsics(width=640, height=480, fx=600, fy=604, cx=326, cy=234, distortion=(-0.25, 0.09, 0.001, -0.0005, 0))

Pose = tuple[tuple[int, int, int], tuple[float, float], float]

# Tilt of the board about the picture's x and y axis and within its plane (degrees); its centre (picture
# widths from the middle, across and down); its distance (squares).
POSES: list[Pose] = [
    ((30, 0, 0), (0.0, 0.0), 11),
    ((-30, 0, 5), (-0.2, 0.1), 13),
    ((0, 30, 10), (0.2, 0.1), 14),
    ((0, -30, 0), (-0.2, -0.1), 13),
    ((25, 25, 0), (0.2, -0.1), 14),
    ((-25, -25, 20), (0.0, 0.05), 13),
    ((-25, 25, 0), (-0.2, 0.0), 12),
    ((10, -35, 90), (0.2, 0.0), 13),
    ((35, 10, 45), (0.0, -0.05), 14),
    ((0, 0, 0), (0.05, 0.0), 10),
]


def board_from_pose(pose: Pose) -> tuple[Floats, Floats]:
    """Rotation (3, 3) and translation (3,), in squares, of camera_from_board."""
    (about_x, about_y, about_z), (across, down), distance = pose
    turns = [np.radians([about_x, 0, 0]), np.radians([0, about_y, 0]), np.radians([0, 0, about_z])]
    x, y, z = (np.asarray(cv2.Rodrigues(turn)[0], dtype=np.float64) for turn in turns)
    rotation: Floats = x @ y @ z
    centre = np.array([across * 640 / 600, down * 640 / 600, 1.0]) * distance
    return rotation, centre - rotation @ BOARD.corners().mean(axis=0)


@cache
def rays_of_half_pixels() -> Floats:
    """(960, 1280, 3): the rays that LENS sends through the middles of half pixels."""
    x, y = np.meshgrid((np.arange(1280) - 0.5) / 2, (np.arange(960) - 0.5) / 2)
    rays = undistort(np.stack([x, y], axis=-1), LENS)
    return np.concatenate([rays, np.ones((960, 1280, 1))], axis=-1)


def rendered(pose: Pose, noise: np.random.Generator, board: Board = BOARD) -> Pixels:
    """A picture of the board through LENS: every ray is followed to the board; a little blur and noise."""
    rotation, translation = board_from_pose(pose)
    board_from_ray = np.linalg.inv(np.column_stack([rotation[:, :2], translation]))
    hit = rays_of_half_pixels() @ board_from_ray.T
    x, y = hit[..., 0] / hit[..., 2], hit[..., 1] / hit[..., 2]
    column, row = np.floor(x), np.floor(y)
    on_squares = (abs(column - 2) <= 3) & (abs(row - 1.5) <= 2.5)
    on_paper = (abs(column - 2) <= 4) & (abs(row - 1.5) <= 3.5)
    texels = np.clip(np.stack([y + 1, x + 1]) * TEXELS, 0, [[[6 * TEXELS - 1]], [[7 * TEXELS - 1]]]).astype(int)
    black = board.black()[tuple(texels)]  # as it is printed
    light = np.where(on_squares & black, 30.0, np.where(on_paper, 210.0, 90.0))
    sharp = light.reshape(480, 2, 640, 2).mean(axis=(1, 3))
    picture = cv2.GaussianBlur(sharp, (0, 0), 0.8) + noise.normal(0, 2, (480, 640))
    return np.asarray(np.clip(np.rint(picture), 0, 255), dtype=np.uint8)


def projected(name: str, pose: Pose, seed: int, lens: Intrinsics = LENS) -> BoardView:
    """The corners that the board of a pose has, with 0.05 px of noise, without a picture."""
    rotation, translation = board_from_pose(pose)
    vector, _ = cv2.Rodrigues(rotation)
    exact, _ = cv2.projectPoints(BOARD.corners(), vector, translation, lens.matrix(), np.array(lens.distortion))
    noise = np.random.default_rng(seed).normal(0, 0.05, (30, 2))
    places = np.asarray(exact, dtype=np.float64).reshape(-1, 2) + noise
    return BoardView(name=name, corner_ids=np.arange(30), corners_px=places)


CHARUCO = Board(columns=6, rows=5, kind="charuco")


@cache
def charuco_pictures() -> tuple[Pixels, ...]:
    """The ChArUco board in each of POSES, a little nearer and farther aside, so that rims are cut off."""
    noise = np.random.default_rng(5)
    return tuple(
        rendered((turn, (1.4 * across, 1.4 * down), distance - 2), noise, CHARUCO)
        for turn, (across, down), distance in POSES
    )
