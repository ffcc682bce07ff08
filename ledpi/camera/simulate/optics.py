"""From flat things in space to light on pixels: perspective, lens, pixel area, blur.

Coordinate maps (homography and lens distortion, in either direction) are smooth: they are computed exactly
on a Chebyshev grid over a region, and its interpolating polynomial gives every pixel by two small matrix
products. That is within 1e-3 px of the exact map, and far quicker. The products go through einsum, not
BLAS: its threads make small products slow as soon as another process has the other cores.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np

from ledpi.camera.simulate.scene import SimulatedSensor
from ledpi.camera.simulate.surface import Image, Surface
from ledpi.core.lens import distort, undistort, widest_ray
from ledpi.core.records import Floats, Intrinsics

PoseAt = Callable[[float], Floats]  # seconds of the camera's clock → camera_from_body, (4, 4)

SUPERSAMPLING = 3  # a pixel's side; odd, so that its centre is a sample
_NODES = 12
_EDGE_ON = 0.03  # cosine between the view and a surface's normal, below which it shows no area


@dataclass(frozen=True, slots=True)
class Region:
    """Pixels x0 ≤ x < x1, y0 ≤ y < y1; may reach beyond the picture."""

    x0: int
    y0: int
    x1: int
    y1: int

    @property
    def width(self) -> int:
        """In pixels."""
        return self.x1 - self.x0

    @property
    def height(self) -> int:
        """In pixels."""
        return self.y1 - self.y0

    @property
    def slices(self) -> tuple[slice, slice]:
        """Returns those of a picture's rows and columns."""
        return slice(self.y0, self.y1), slice(self.x0, self.x1)

    def grown(self, by: int) -> Region:
        """With `by` pixels more on each side."""
        return Region(self.x0 - by, self.y0 - by, self.x1 + by, self.y1 + by)

    def intersection(self, other: Region) -> Region | None:
        """Returns what both share, if it is at least 2 × 2 pixels."""
        x0, y0 = max(self.x0, other.x0), max(self.y0, other.y0)
        x1, y1 = min(self.x1, other.x1), min(self.y1, other.y1)
        return Region(x0, y0, x1, y1) if x1 - x0 > 1 and y1 - y0 > 1 else None


def whole_picture(intrinsics: Intrinsics) -> Region:
    """All pixels."""
    return Region(0, 0, intrinsics.width, intrinsics.height)


def project(points_m: Floats, camera_from_body: Floats, intrinsics: Intrinsics) -> Floats:
    """Pixels (N, 2) of points (N, 3) of a body, which must lie in front of the camera."""
    in_camera = points_m @ camera_from_body[:3, :3].T + camera_from_body[:3, 3]
    return distort(in_camera[:, :2] / in_camera[:, 2:], intrinsics)


def seen_at(point_m: Floats, pose_at: PoseAt, sensor: SimulatedSensor, seq: int) -> tuple[Floats, float]:
    """Returns where a body's point (3,) is in the picture, (2,) px, and when, in s: at its row's mid-exposure.

    Rows beyond the picture's edges are counted on, so that a point out of view has a place too.
    """
    height = sensor.intrinsics.height
    row = (height - 1) / 2.0
    for _ in range(4):  # within a row's time a point moves by far less than a row: a round gains two digits
        t_s = sensor.mid_exposure_s(seq, row)
        pixel = project(point_m[None, :], pose_at(t_s), sensor.intrinsics)[0]
        row = min(max(float(pixel[1]), -height), 2.0 * height)
    return pixel, t_s


def shows_front(camera_from_body: Floats) -> bool:
    """Tells whether the camera sees the front of a flat body: its z axis comes towards the camera."""
    position = camera_from_body[:3, 3]
    return bool(camera_from_body[:3, 2] @ position < -_EDGE_ON * np.linalg.norm(position))


def region_of(surface: Surface, camera_from_surface: Floats, intrinsics: Intrinsics, margin: int) -> Region | None:
    """Pixels that a surface covers, with a margin, wherever they lie; None where its front does not show.

    Rays far out of view are first cut to a little out of view: there the distortion polynomial means
    nothing.
    """
    outline = surface.outline_m()
    halfway = (outline + outline[[1, 2, 3, 0]]) / 2.0  # a lens bends the sides
    points = np.concatenate([outline, halfway])
    in_camera = points @ camera_from_surface[:3, :3].T + camera_from_surface[:3, 3]
    if not shows_front(camera_from_surface) or np.any(in_camera[:, 2] <= 0.01):
        return None
    rays = in_camera[:, :2] / in_camera[:, 2:]
    limit = _view_limit(intrinsics)
    lengths = np.maximum(np.linalg.norm(rays, axis=1, keepdims=True), 1e-12)
    pixels = distort(rays * np.minimum(1.0, limit / lengths), intrinsics)
    low, high = np.floor(pixels.min(axis=0)), np.ceil(pixels.max(axis=0))
    return Region(int(low[0]), int(low[1]), int(high[0]) + 1, int(high[1]) + 1).grown(margin)


@lru_cache(maxsize=16)
def _view_limit(intrinsics: Intrinsics) -> float:
    """A little more than the longest ray (x/z, y/z) in view, but none without a pixel."""
    right, bottom = intrinsics.width - 1.0, intrinsics.height - 1.0
    edge = [(x, y) for x in (0.0, right / 2, right) for y in (0.0, bottom / 2, bottom)]
    return min(1.3 * float(np.linalg.norm(rays_of(np.array(edge), intrinsics), axis=1).max()), widest_ray(intrinsics))


def rays_of(pixels: Floats, intrinsics: Intrinsics) -> Floats:
    """Rays (N, 2) of pixels (N, 2); of those that the lens shows nothing at, the widest one in that direction."""
    rays = undistort(pixels, intrinsics)
    away = (pixels - (intrinsics.cx, intrinsics.cy)) / (intrinsics.fx, intrinsics.fy)
    widest = away * (widest_ray(intrinsics) / np.maximum(np.linalg.norm(away, axis=1, keepdims=True), 1e-12))
    return np.where(np.isfinite(rays), rays, widest)


def _chebyshev_nodes() -> Floats:
    return np.asarray(-np.cos(np.pi * np.arange(_NODES) / (_NODES - 1)))


@lru_cache(maxsize=1024)
def _basis(samples: int) -> Image:
    """(samples, nodes): what each node adds at equally spaced samples from the first node to the last."""
    weights = np.where(np.arange(_NODES) % 2, -1.0, 1.0)
    weights[[0, -1]] *= 0.5
    away = np.linspace(-1.0, 1.0, samples)[:, None] - _chebyshev_nodes()
    hit = np.abs(away) < 1e-12
    share = weights / np.where(hit, 1.0, away)  # the barycentric formula
    share = np.where(hit.any(axis=1, keepdims=True), hit, share)  # and its limit at a node
    return np.asarray(share / share.sum(axis=1, keepdims=True), np.float32)


def node_pixels(region: Region, per_pixel: int = 1) -> Floats:
    """(nodes², 2) pixel positions: a grid up to the region's outermost samples, `per_pixel`² a pixel."""
    beyond = (1.0 - 1.0 / per_pixel) / 2.0  # those samples, past the outermost pixels' centres
    nodes = _chebyshev_nodes()
    x = (region.x0 + region.x1 - 1 + nodes * (region.width - 1 + 2.0 * beyond)) / 2.0
    y = (region.y0 + region.y1 - 1 + nodes * (region.height - 1 + 2.0 * beyond)) / 2.0
    return np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)


def spread(values: Floats, region: Region, per_pixel: int = 1) -> tuple[Image, Image]:
    """Two coordinates known at `node_pixels`, (nodes², 2), at every sample of the region, for cv2.remap."""
    rows, columns = _basis(region.height * per_pixel), _basis(region.width * per_pixel)
    grid = values.astype(np.float32).reshape(_NODES, _NODES, 2)
    x, y = (np.einsum("rk,kc->rc", rows, np.einsum("kj,cj->kc", grid[..., axis], columns)) for axis in (0, 1))
    return x, y


def plane_homography(camera_from_surface: Floats) -> Floats:
    """(3, 3): (X, Y, 1) on the surface's plane → its ray in the camera, up to length."""
    return np.asarray(camera_from_surface[:3, [0, 1, 3]])


def apply_homography(homography: Floats, points: Floats) -> Floats:
    """(N, 2) → (N, 2)."""
    mapped = points @ homography[:, :2].T + homography[:, 2]
    return np.asarray(mapped[:, :2] / mapped[:, 2:])


@dataclass(frozen=True, slots=True)
class Blur:
    """The lens's image of a point: a disc, and that smoothed."""

    psf_sigma_px: float
    defocus_px: float = 0.0

    @classmethod
    def from_sensor(cls, sensor: SimulatedSensor) -> Blur:
        """A sensor's lens."""
        return cls(sensor.psf_sigma_px, sensor.defocus_px)

    @property
    def margin_px(self) -> int:
        """Returns how far beyond its outline a surface's light reaches."""
        return math.ceil(4 * self.psf_sigma_px + self.defocus_px) + 2

    @property
    def rms_px(self) -> float:
        """Along one axis; a disc's is half its radius."""
        return math.hypot(self.psf_sigma_px, self.defocus_px / 2.0)

    def apply(self, sharp: Image) -> Image:
        """The supersampled picture, blurred, and averaged over each sample's pixel."""
        kernel = _blur_kernel(self.psf_sigma_px)
        blurred = cv2.sepFilter2D(sharp, cv2.CV_32F, kernel, kernel, borderType=cv2.BORDER_REPLICATE)
        if self.defocus_px > 0:
            blurred = cv2.filter2D(blurred, cv2.CV_32F, _disc(self.defocus_px), borderType=cv2.BORDER_REPLICATE)
        return np.asarray(blurred, np.float32)


@lru_cache(maxsize=16)
def _disc(radius_px: float) -> Image:
    """An even disc on supersampled pixels, its rim in shares, of sum 1."""
    radius = radius_px * SUPERSAMPLING
    at = np.arange(-math.ceil(radius), math.ceil(radius) + 1)
    disc = np.clip(radius + 0.5 - np.hypot(at[:, None], at[None, :]), 0.0, 1.0)
    return np.asarray(disc / disc.sum(), np.float32)


@lru_cache(maxsize=16)
def _blur_kernel(psf_sigma_px: float) -> Image:
    """The pixel's area and the lens's blur for the supersampled picture: a box and a Gaussian, convolved."""
    kernel = np.full(SUPERSAMPLING, 1.0 / SUPERSAMPLING)
    if psf_sigma_px > 0:
        sigma = psf_sigma_px * SUPERSAMPLING
        at = np.arange(-math.ceil(4 * sigma), math.ceil(4 * sigma) + 1)
        gauss = np.exp(-0.5 * (at / sigma) ** 2)
        kernel = np.convolve(kernel, gauss / gauss.sum())
    return kernel.astype(np.float32)


def irradiance(
    surface: Surface, camera_from_surface: Floats, region: Region, intrinsics: Intrinsics, blur: Blur
) -> tuple[Image, ...]:
    """Returns what a pixel centred at each sample would collect of each plane: (3·height, 3·width) each.

    Sample i of a row is at pixel x0 + (i − 1)/3. Samples nearer than the blur's margin to the region's
    border are right only where the surface does not change beyond it.
    """
    # Of the size alone, so without the lens's bending: a floor reaches further than a lens shows.
    in_camera = surface.outline_m() @ camera_from_surface[:3, :3].T + camera_from_surface[:3, 3]
    corners = in_camera[:, :2] / in_camera[:, 2:] * (intrinsics.fx, intrinsics.fy)
    left, top, right, bottom = np.linalg.norm(corners - corners[[3, 0, 1, 2]], axis=1) * SUPERSAMPLING
    planes = surface.shrunk(max(top, bottom), max(left, right))
    rows, columns = planes[0].shape
    per_metre = np.array([columns / surface.size_m[0], -rows / surface.size_m[1]])
    to_plane = np.asarray(np.linalg.inv(plane_homography(camera_from_surface)), np.float64)
    on_plane_m = apply_homography(to_plane, rays_of(node_pixels(region, SUPERSAMPLING), intrinsics))
    texels = on_plane_m * per_metre + np.array([(columns - 1) / 2.0, (rows - 1) / 2.0])
    maps = spread(texels, region, SUPERSAMPLING)
    return tuple(blur.apply(look_up(plane, *maps)) for plane in planes)


def look_up(plane: Image, map_x: Image, map_y: Image) -> Image:
    """cv2.remap, bilinear, 0 outside."""
    found = cv2.remap(plane, map_x, map_y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=0)
    return np.asarray(found, np.float32)
