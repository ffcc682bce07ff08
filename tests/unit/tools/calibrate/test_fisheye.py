"""A fisheye before a board is asked back, to its rim; and a usual lens is not taken for one."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from ledpi.core.records import Floats, Intrinsics
from ledpi.kernels.lens import undistort
from ledpi.tools.calibrate.boards import Board, BoardView
from ledpi.tools.calibrate.camera import calibrate_camera
from tests.builders.lenses import opencv_pixels

BOARD = Board(columns=8, rows=6)
FOCAL = 640 / math.radians(140)  # 140° across the picture
FISHEYE = Intrinsics(
    width=640,
    height=480,
    fx=FOCAL,
    fy=1.003 * FOCAL,
    cx=326.0,
    cy=234.0,
    distortion=(0.03, -0.012, 0.005, -0.002),
    distortion_model="equidistant",
)
WIDE = Intrinsics(
    width=640, height=480, fx=420, fy=421, cx=322, cy=238, distortion=(-0.28, 0.08, 0.001, -0.0005, -0.01)
)


def views_of(lens: Intrinsics, count: int, widest_deg: float, noise_px: float = 0.1) -> list[BoardView]:
    """A board held in all directions, tilted; its corners by OpenCV's projection, those in the picture."""
    rng, views = np.random.default_rng(8), []
    corners = BOARD.corners() - BOARD.corners().mean(axis=0)
    while len(views) < count:
        aside, around = math.radians(widest_deg) * math.sqrt(rng.uniform()), rng.uniform(0, 2 * math.pi)
        to = cv2.Rodrigues(np.array([-math.sin(around), math.cos(around), 0.0]) * aside)[0]
        tilt = cv2.Rodrigues(rng.uniform(-0.6, 0.6, 3))[0]
        points = (corners @ tilt.T + (0, 0, rng.uniform(8, 14))) @ to.T
        seen = opencv_pixels(points[:, :2] / points[:, 2:], lens)
        inside = (points[:, 2] > 0) & (seen > 2).all(axis=1) & (seen < (lens.width - 3, lens.height - 3)).all(axis=1)
        if inside.sum() >= 20:
            ids = np.flatnonzero(inside)
            places = seen[ids] + rng.normal(0, noise_px, (len(ids), 2))
            views.append(BoardView(name=f"{len(views):02}", corner_ids=ids, corners_px=places))
    return views


def error_px(found: Intrinsics, lens: Intrinsics) -> Floats:
    """(N,) how far apart OpenCV sees the rays of both, at a grid of pixels."""
    across, down = np.meshgrid(np.linspace(10, 629, 17), np.linspace(10, 469, 13))
    pixels = np.stack([across.ravel(), down.ravel()], axis=1)
    rays = undistort(pixels, found)
    return np.asarray(np.linalg.norm(opencv_pixels(rays, lens) - pixels, axis=1))


def test_a_fisheye_of_140_degrees_is_asked_back() -> None:
    """To 0.5 px at any pixel but the corners', with an rms of the corners' noise, and deviations that hold."""
    result = calibrate_camera(views_of(FISHEYE, 24, 65.0), BOARD, 640, 480)
    lens = result.intrinsics
    assert lens.distortion_model == "equidistant"
    assert result.rms_px < 0.2
    assert len(result.used) == 24
    assert np.quantile(error_px(lens, FISHEYE), 0.9) < 0.5
    values, truth = ([i.fx, i.fy, i.cx, i.cy, *i.distortion] for i in (lens, FISHEYE))
    off = (np.array(values) - truth) / result.deviations
    assert np.abs(off).max() < 4.0


def test_a_usual_lens_stays_one() -> None:
    """A lens of 75° with k1 = -0.28 is explained by plumb_bob."""
    result = calibrate_camera(views_of(WIDE, 16, 30.0), BOARD, 640, 480)
    assert result.intrinsics.distortion_model == "plumb_bob"
    assert result.intrinsics.fx == pytest.approx(WIDE.fx, rel=0.005)


def test_a_rational_lens_is_asked_back() -> None:
    """To 0.5 px over the picture's inner nine tenths, where its model is asked for; so is one with a thin prism."""
    rational = replace(
        WIDE, distortion=(0.26, 0.11, -0.001, 0.0, 0.02, 0.5, 0.2, 0.02), distortion_model="rational_polynomial"
    )
    prism = (*WIDE.distortion, 0.0, 0.0, 0.0, 0.004, -0.001, -0.003, 0.001)
    for lens in (rational, replace(WIDE, distortion=prism, distortion_model="thin_prism")):
        found = calibrate_camera(views_of(lens, 24, 32.0), BOARD, 640, 480, lens.distortion_model)
        assert found.intrinsics.distortion_model == lens.distortion_model
        assert found.rms_px < 0.2
        assert len(found.deviations) == 4 + len(lens.distortion)
        assert np.quantile(error_px(found.intrinsics, lens), 0.9) < 0.5


def test_a_bad_view_of_a_fisheye_is_left_out() -> None:
    """One whose corners are not where the others have them."""
    views = views_of(FISHEYE, 20, 65.0)
    bad = views[3]
    shaken = bad.corners_px + np.random.default_rng(2).normal(0, 4, bad.corners_px.shape)
    views[3] = BoardView(name="shaken", corner_ids=bad.corner_ids, corners_px=shaken)
    result = calibrate_camera(views, BOARD, 640, 480)
    assert [view.name for view in result.dropped] == ["shaken"]
    assert result.rms_px < 0.2
