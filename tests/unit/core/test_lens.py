"""Rays and pixels through each model of a lens, against OpenCV's own projections."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ledpi.core.lens import distort, projected, undistort, widest_ray
from ledpi.core.records import Floats, Intrinsics
from tests.builders.lenses import PUBLIC, opencv_pixels

# Pi Camera v1, a wide lens with strong barrel, and every coefficient at once.
LENSES = [
    (0.13, -0.25, 0.0, 0.0, 0.0),
    (-0.30, 0.10, 0.0, 0.0, 0.0),
    (-0.25, 0.08, 0.003, -0.002, -0.01),
]
EVERY = (-0.25, 0.08, 0.003, -0.002, -0.01, 0.05, 0.02, 0.01, 0.004, -0.003, 0.002, 0.001)


def camera(distortion: tuple[float, ...], model: str = "plumb_bob", focal: float = 600) -> Intrinsics:
    return Intrinsics(
        width=640, height=480, fx=focal, fy=1.005 * focal, cx=317, cy=244, distortion=distortion, distortion_model=model
    )


MODELS = [
    *(camera(distortion) for distortion in [*LENSES, (0, 0, 0, 0, 0), (-0.2, 0, 0, 0, 0), (0.2, 0, 0, 0, 0)]),
    camera(EVERY[:8], "rational_polynomial"),
    camera(EVERY, "thin_prism"),
    camera((0.0, 0.0, 0.0, 0.0), "equidistant", 300),
    camera((0.18, -0.03, 0.0004, -0.0007), "equidistant", 300),
]


def grid_of_pixels(lens: Intrinsics, steps: int = 17) -> Floats:
    """(N, 2): a grid over the whole picture, its corners included."""
    columns, rows = np.meshgrid(np.linspace(0, lens.width - 1, steps), np.linspace(0, lens.height - 1, steps))
    return np.stack([columns.ravel(), rows.ravel()], axis=1)


@pytest.mark.parametrize("lens", MODELS)
def test_rays_land_where_opencv_puts_them_and_back(lens: Intrinsics) -> None:
    """By cv2.projectPoints, or cv2.fisheye's; a ray is found again to 1e-6 px."""
    rays = (grid_of_pixels(lens) - (lens.cx, lens.cy)) / (lens.fx, lens.fy)
    pixels = opencv_pixels(rays, lens)
    np.testing.assert_allclose(distort(rays, lens), pixels, rtol=0, atol=1e-9)
    np.testing.assert_allclose(undistort(pixels, lens), rays, rtol=0, atol=1e-6 / lens.fx)


@pytest.mark.parametrize("lens", MODELS)
def test_slopes_are_those_of_small_steps(lens: Intrinsics) -> None:
    """The derivative of a pixel by the point, against differences."""
    rng = np.random.default_rng(5)
    points = np.column_stack([rng.uniform(-0.5, 0.5, (50, 2)), np.ones(50)]) * rng.uniform(0.5, 4, (50, 1))
    points = np.concatenate([points, [[0.0, 0.0, 1.0], [1e-6, 0.0, 2.0]]])
    _, slopes = projected(points, lens)
    for axis, step in enumerate(1e-6 * np.eye(3)):
        ends = [projected(points + sign * step, lens)[0] for sign in (1, -1)]
        np.testing.assert_allclose(slopes[..., axis], (ends[0] - ends[1]) / 2e-6, rtol=1e-5, atol=1e-4)


@pytest.mark.parametrize("name", PUBLIC)
def test_directions_of_public_calibrations_are_opencvs(name: str) -> None:
    """Calibrations that people published: OpenCV sees each pixel's ray within 0.05 px of it, wherever it is seen once.

    Every pixel within the largest circle of which that holds has its ray, and beyond it none has.
    """
    lens = PUBLIC[name]
    pixels = grid_of_pixels(lens, 41)
    rays = undistort(pixels, lens)
    seen = np.isfinite(rays).all(axis=1)
    assert np.abs(opencv_pixels(rays[seen], lens) - pixels[seen]).max() < 0.05
    reach = widest_ray(lens)
    assert np.hypot(*rays[seen].T).max() <= reach * (1 + 1e-9)
    assert outward_slopes(lens, 0.999 * reach).min() > 0
    if not seen.all():  # the radius at which it turns back, or 89°
        assert reach > math.tan(math.radians(88.9)) or outward_slopes(lens, 1.01 * reach).min() < 1e-3


def outward_slopes(lens: Intrinsics, to: float) -> Floats:
    """Slopes of pixels outward, by OpenCV, in a thousand steps of rays up to the length `to`; in focal lengths."""
    ways = np.stack([np.cos(np.arange(16) * math.pi / 8), np.sin(np.arange(16) * math.pi / 8)], axis=1)
    lengths = np.tan(np.arctan(to) * np.arange(1, 1001) / 1000)
    seen = opencv_pixels((lengths[:, None, None] * ways).reshape(-1, 2), lens).reshape(1000, 16, 2)
    along = ((seen - (lens.cx, lens.cy)) / (lens.fx, lens.fy) * ways).sum(axis=2)
    return np.diff(along, axis=0) / np.diff(np.arctan(lengths))[:, None]


def test_a_lens_that_folds_has_no_ray_beyond_its_fold() -> None:
    """With k1 = -0.4 the radius r (1 - 0.4 r²) turns back at r = 1 / √1.2, 304 px from the middle at fx 500."""
    lens = camera((-0.4, 0.0, 0.0, 0.0, 0.0), focal=500)
    assert widest_ray(lens) == pytest.approx(1 / math.sqrt(1.2), rel=2e-3)
    rays = undistort(np.array([[317.0 + 300, 244.0], [317.0 + 310, 244.0], [317.0, 244.0 - 310]]), lens)
    assert rays[0] == pytest.approx([0.82, 0.0], abs=0.03)
    assert np.isnan(rays[1:]).all()
    further = np.array([[0.95, 0.0]])  # seen within the picture, at another ray's pixel
    assert np.isnan(distort(further, lens)).all()
    assert 0 < opencv_pixels(further, lens)[0, 0] < 640


def test_a_mirrored_lens_makes_mirrored_pictures() -> None:
    """Each model does so: a ray from the other side is seen at the mirrored pixel."""
    for lens in MODELS:
        rays = (grid_of_pixels(lens) - (lens.cx, lens.cy)) / (lens.fx, lens.fy)
        mirrored = distort(rays * (-1, 1), lens.mirrored())
        expected = distort(rays, lens)
        np.testing.assert_allclose(mirrored[:, 0], lens.width - 1 - expected[:, 0], rtol=0, atol=1e-9)
        np.testing.assert_allclose(mirrored[:, 1], expected[:, 1], rtol=0, atol=1e-9)
