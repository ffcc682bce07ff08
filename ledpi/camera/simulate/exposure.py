"""A surface's light as the rows collect it: still, or moving while a row is exposed and from row to row.

Row y of frame `seq` is exposed from sensor.exposure_start_s(seq, y) for exposure_us. That time is cut into
K equal parts. In part k a pixel collects Σ over classes of the class's picture, where the surface is then,
times the share of part k in which the class is on. A surface that stands still needs one part.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ledpi.camera.simulate import optics
from ledpi.camera.simulate.scene import SimulatedSensor, Wave
from ledpi.camera.simulate.surface import Image, Surface
from ledpi.core.lens import distort
from ledpi.core.records import Floats, Intrinsics

_STEP_PX = 0.5  # largest motion between two parts of an exposure; it leaves out a box of 0.14 px rms


@dataclass(frozen=True, slots=True)
class Layer:
    """One part of the exposure: what a pixel would collect of each class, and how much is hidden behind."""

    classes: tuple[Image, ...]  # (height, width) each
    opacity: Image  # (height, width)


@dataclass(frozen=True, slots=True)
class Exposed:
    """A surface in one frame, before its classes' blinking is applied."""

    region: optics.Region
    parts: tuple[Layer, ...]


def expose_still(surface: Surface, camera_from_surface: Floats, sensor: SimulatedSensor) -> Exposed | None:
    """A surface that stands still for good; None where none of it is in view."""
    blur = optics.Blur.from_sensor(sensor)
    margin = blur.margin_px
    covered = optics.region_of(surface, camera_from_surface, sensor.intrinsics, margin)
    region = covered.intersection(optics.whole_picture(sensor.intrinsics)) if covered is not None else None
    if region is None:
        return None
    around = region.grown(margin)
    planes = optics.irradiance(surface, camera_from_surface, around, sensor.intrinsics, blur)
    step, first = (
        optics.SUPERSAMPLING,
        optics.SUPERSAMPLING * margin + optics.SUPERSAMPLING // 2,
    )  # at the first pixel's centre
    rows, columns = (slice(first, first + step * pixels, step) for pixels in (region.height, region.width))
    pixels = [np.ascontiguousarray(plane[rows, columns]) for plane in planes]
    return Exposed(region, (Layer(tuple(pixels[:-1]), pixels[-1]),))


@dataclass(frozen=True, slots=True)
class _Drift:
    """The way of what a pixel p sees, in the picture of t0: p + slope·s + bend·s² at time t, s = (t − t0)/h.

    Known at the region's node pixels; exact at t0 − h, t0 and t0 + h.
    """

    region: optics.Region
    t0_s: float
    half_span_s: float
    pixels: Floats  # (nodes, 2)
    slope: Floats
    bend: Floats

    def reach_px(self) -> int:
        return math.ceil(float((np.abs(self.slope) + np.abs(self.bend)).max()))

    def speed_px_s(self) -> float:
        return float(np.linalg.norm(self.slope, axis=1).max()) / self.half_span_s

    def place_at_t0(self, times_s: Floats) -> Floats:
        """(nodes, 2), each node pixel being looked at at its own time (nodes,)."""
        s = ((times_s - self.t0_s) / self.half_span_s)[:, None]
        return self.pixels + self.slope * s + self.bend * s * s


def expose_moving(surface: Surface, pose_at: optics.PoseAt, sensor: SimulatedSensor, seq: int) -> Exposed | None:
    """A surface in motion: rendered once, as it is at t0, then shifted to where each row's parts see it."""
    lens, blur = sensor.intrinsics, optics.Blur.from_sensor(sensor)
    margin = blur.margin_px
    drift = _drift(surface, pose_at, sensor, seq)
    if drift is None:
        return None
    pose = pose_at(drift.t0_s)
    covered = optics.region_of(surface, pose, lens, margin)
    reach = optics.whole_picture(lens).grown(drift.reach_px() + margin)
    around = covered.intersection(reach) if covered is not None else None
    if around is None:
        return None
    planes = optics.irradiance(surface, pose, around, lens, blur)
    exposure_s = sensor.exposure_us * 1e-6
    parts = max(1, math.ceil(drift.speed_px_s() * exposure_s / _STEP_PX))
    mid_exposure_s = sensor.mid_exposure_s(seq, 0) + drift.pixels[:, 1] * sensor.row_time_us * 1e-6
    layers = []
    for part in range(parts):
        times_s = mid_exposure_s + ((part + 0.5) / parts - 0.5) * exposure_s
        samples = (
            drift.place_at_t0(times_s) - (around.x0, around.y0)
        ) * optics.SUPERSAMPLING + optics.SUPERSAMPLING // 2
        maps = optics.spread(samples, drift.region)
        moved = [optics.look_up(plane, *maps) for plane in planes]
        layers.append(Layer(tuple(moved[:-1]), moved[-1]))
    return Exposed(drift.region, tuple(layers))


def _drift(surface: Surface, pose_at: optics.PoseAt, sensor: SimulatedSensor, seq: int) -> _Drift | None:
    lens = sensor.intrinsics
    at_middle = pose_at(sensor.mid_exposure_s(seq, (lens.height - 1) / 2.0))
    covered = optics.region_of(surface, at_middle, lens, 16)  # 16: as far as it may move till its own rows' time
    if covered is None:
        return None
    centre_px, t0_s = optics.seen_at(np.zeros(3), pose_at, sensor, seq)
    rows = max(abs(covered.y0 - centre_px[1]), abs(covered.y1 - centre_px[1]))
    half_span_s = (min(rows, 2.0 * lens.height) * sensor.row_time_us + sensor.exposure_us / 2.0) * 1e-6
    before, now, after = (pose_at(t0_s + s * half_span_s) for s in (-1.0, 0.0, 1.0))
    region = _swept(surface, (before, now, after), sensor)
    if region is None:
        return None
    pixels = optics.node_pixels(region)
    rays = optics.rays_of(pixels, lens)
    early, late = (_place_at_pose(rays, pose, now, lens) for pose in (before, after))
    return _Drift(
        region=region,
        t0_s=t0_s,
        half_span_s=half_span_s,
        pixels=pixels,
        slope=(late - early) / 2.0,
        bend=(late + early) / 2.0 - pixels,
    )


def _swept(surface: Surface, poses: tuple[Floats, ...], sensor: SimulatedSensor) -> optics.Region | None:
    """Pixels of the picture that the surface covers at any of the poses."""
    margin = optics.Blur.from_sensor(sensor).margin_px
    regions = [r for r in (optics.region_of(surface, p, sensor.intrinsics, margin) for p in poses) if r is not None]
    if not regions:
        return None
    low_x, low_y = min(r.x0 for r in regions), min(r.y0 for r in regions)
    swept = optics.Region(low_x, low_y, max(r.x1 for r in regions), max(r.y1 for r in regions))
    return swept.intersection(optics.whole_picture(sensor.intrinsics))


def _place_at_pose(rays: Floats, seen: Floats, there: Floats, lens: Intrinsics) -> Floats:
    """Returns where what `rays` (N, 2) see of a surface at pose `seen` is in the picture at pose `there`."""
    ray_to_ray = np.asarray(optics.plane_homography(there) @ np.linalg.inv(optics.plane_homography(seen)), np.float64)
    return distort(optics.apply_homography(ray_to_ray, rays), lens)


def add_to(
    level: Image,
    exposed: Exposed,
    surface: Surface,
    phases_cycles: tuple[float, ...],
    sensor: SimulatedSensor,
    seq: int,
    room_rows: Image | None,
) -> None:
    """Puts a surface before what is behind it, (H, W) linear light, in place.

    `phases_cycles` are the classes' phases at t = 0 of the camera's clock; a trace has its own. `room_rows` (H,) is
    the room's light in each row, over its mean, where it ripples.
    """
    region, parts = exposed.region, len(exposed.parts)
    weights = [
        _part_weights(wave, phase, region, parts, sensor, seq)
        for wave, phase in zip(surface.waves, phases_cycles, strict=True)
    ]
    hidden = np.add.reduce([part.opacity for part in exposed.parts]) / np.float32(parts)
    light = np.float32(surface.reflected) * hidden
    if room_rows is not None:
        light *= room_rows[region.y0 : region.y1, None]
    for k, part in enumerate(exposed.parts):
        for weight, picture in zip(weights, part.classes, strict=True):
            light += weight[k, :, None] * picture
    target = level[region.slices]
    target *= 1.0 - hidden
    target += light


def _part_weights(
    wave: Wave | None, phase_cycles: float, region: optics.Region, parts: int, sensor: SimulatedSensor, seq: int
) -> Image:
    """(parts, rows): the share of the whole exposure that is on and in that part; the parts sum to w(y)."""
    if wave is None:
        return np.full((parts, region.height), 1.0 / parts, np.float32)
    part_us = sensor.exposure_us / parts
    rows = np.arange(region.y0, region.y1) + np.arange(parts)[:, None] * (part_us / sensor.row_time_us)
    shares = wave.shares(
        rows,
        phase_cycles=phase_cycles,
        start_s=sensor.exposure_start_s(seq),
        exposure_us=part_us,
        row_time_us=sensor.row_time_us,
    )
    return np.asarray(shares / parts, np.float32)
