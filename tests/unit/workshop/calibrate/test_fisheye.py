"""A fisheye before a board is asked back, to its rim; and a usual lens is not taken for one."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from ledpi.core.lens import undistort
from ledpi.core.records import Floats, Intrinsics
from ledpi.workshop.calibrate.boards import BoardView
from ledpi.workshop.calibrate.camera import calibrate_camera
from tests.builders.lenses import BOARD, opencv_pixels, views_of

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
