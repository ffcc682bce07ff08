"""The camera as a map between rays and pixels, for every model of a lens (lens.c)."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from ledpi.core.library import doubles, lib, pointer
from ledpi.core.records import COEFFICIENTS, Floats, Intrinsics

_NAMES = ("k1", "k2", "p1", "p2", "k3", "k4", "k5", "k6", "s1", "s2", "s3", "s4")  # as `Lens` of pose.h has them
# Of rays x/z: further aside they grow beyond bounds.
WIDEST_DEG = 89.0
_STEPS, _AROUND = 1780, 16  # in which a fold is looked for: of the angle from the axis, and around it


@lru_cache(maxsize=32)
def lens_of(intrinsics: Intrinsics) -> Floats:
    """`Lens` of pose.h."""
    numbers = _numbers_of(intrinsics, math.inf)
    numbers[-1] = _one_to_one(numbers)
    return numbers


def bending_lens_of(intrinsics: Intrinsics | None) -> Floats | None:
    """The same, where there is a lens and it bends."""
    if intrinsics is None or not (any(intrinsics.distortion) or intrinsics.distortion_model == "equidistant"):
        return None
    return lens_of(intrinsics)


def _numbers_of(intrinsics: Intrinsics, most_r2: float) -> Floats:
    values = dict(zip(COEFFICIENTS[intrinsics.distortion_model], intrinsics.distortion, strict=True))
    camera = (intrinsics.fx, intrinsics.fy, intrinsics.cx, intrinsics.cy)
    bent = (values.get(name, 0.0) for name in _NAMES)
    return np.array([*camera, *bent, float(intrinsics.distortion_model == "equidistant"), most_r2])


def _one_to_one(numbers: Floats) -> float:
    """r² of the widest circle of rays inside which no two are seen at one pixel, WIDEST_DEG at most.

    There the map turns nowhere: its derivative's determinant and its slope along the radius stay above 0, and pixels
    go outward without a break (which a quotient of polynomials may have).
    """
    radii = np.tan(np.radians(np.arange(1, _STEPS + 1) * WIDEST_DEG / _STEPS))
    around = np.arange(_AROUND) * 2.0 * math.pi / _AROUND
    ways = np.stack([np.cos(around), np.sin(around)], axis=1)
    points = np.ones((_STEPS, _AROUND, 3))
    points[..., :2] = radii[:, None, None] * ways
    pixels, slopes = _projected(points.reshape(-1, 3), numbers)
    away = ((pixels - numbers[2:4]) / numbers[:2]).reshape(_STEPS, _AROUND, 2)
    slopes = slopes.reshape(_STEPS, _AROUND, 2, 3)[..., :2] / numbers[:2, None]
    determinant = slopes[..., 0, 0] * slopes[..., 1, 1] - slopes[..., 0, 1] * slopes[..., 1, 0]
    outward = np.einsum("ai,raij,aj->ra", ways, slopes, ways)
    goes_on = np.diff((away * ways).sum(axis=2), axis=0, prepend=0.0) > 0
    turns = ~((determinant > 0) & (outward > 0) & goes_on).all(axis=1)
    first = int(np.argmax(turns)) if turns.any() else _STEPS
    return float(radii[first - 1]) ** 2 if first else 0.0


def _projected(points: Floats, numbers: Floats) -> tuple[Floats, Floats]:
    pixels, slopes = np.empty((len(points), 2)), np.empty((len(points), 2, 3))
    given = pointer(numbers), len(points), pointer(doubles(points))
    lib.ledpi_project_points(*given, pointer(pixels), pointer(slopes))
    return pixels, slopes


def projected(points: Floats, intrinsics: Intrinsics) -> tuple[Floats, Floats]:
    """Pixels (…, 2) of points (…, 3) in the camera's frame, and their derivative (…, 2, 3) by the point."""
    shape = points.shape[:-1]
    pixels, slopes = _projected(points.reshape(-1, 3), lens_of(intrinsics))
    return pixels.reshape(*shape, 2), slopes.reshape(*shape, 2, 3)


def distort(rays_xy: Floats, intrinsics: Intrinsics) -> Floats:
    """Pixels (…, 2) of rays given as (x/z, y/z) (…, 2); not a number beyond `widest_ray`."""
    pixels = np.empty(rays_xy.shape)
    count = rays_xy.size // 2
    lib.ledpi_distort_rays(pointer(lens_of(intrinsics)), count, pointer(doubles(rays_xy)), pointer(pixels))
    return pixels


def undistort(pixels: Floats, intrinsics: Intrinsics) -> Floats:
    """Rays (x/z, y/z) (…, 2) that pixels (…, 2) look along: the inverse of `distort`; not a number where none does."""
    rays = np.empty(pixels.shape)
    count = pixels.size // 2
    lib.ledpi_undistort_pixels(pointer(lens_of(intrinsics)), count, pointer(doubles(pixels)), pointer(rays))
    return rays


def widest_ray(intrinsics: Intrinsics) -> float:
    """The length of the longest ray (x/z, y/z) that is seen at a pixel of its own."""
    return math.sqrt(float(lens_of(intrinsics)[-1]))


def is_widest(intrinsics: Intrinsics) -> bool:
    """Tells whether no two rays within WIDEST_DEG share a pixel."""
    return widest_ray(intrinsics) > math.tan(math.radians(WIDEST_DEG)) * 0.999


def blind_part(intrinsics: Intrinsics) -> tuple[float, float]:
    """The share of the picture's pixels that have no ray, and how far from the lens's middle the nearest one is, px."""
    across, down = (np.linspace(0.0, side - 1.0, 65) for side in (intrinsics.width, intrinsics.height))
    pixels = np.stack(np.meshgrid(across, down), axis=-1).reshape(-1, 2)
    blind = np.isnan(undistort(pixels, intrinsics)).any(axis=1)
    if not blind.any():
        return 0.0, math.inf
    away = np.linalg.norm(pixels[blind] - (intrinsics.cx, intrinsics.cy), axis=1)
    return float(blind.mean()), float(away.min())
