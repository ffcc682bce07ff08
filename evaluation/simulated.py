"""More for the simulator to show: deep walls, LEDs in numbers, traced edges, lamps on the mains, a glossy floor."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar, NamedTuple

import cv2
import numpy as np

from ledpi.camera.simulate.scene import PanelAppearance
from ledpi.camera.simulate.surface import Image, Surface
from ledpi.camera.simulate.trajectory import Trajectory
from ledpi.core.records import Floats


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TracedWave:
    """A light that is switched at recorded moments, as a driver's pin was traced.

    Kept as its integral: for how long it has been on until each moment, linear in between.
    """

    moments_s: Floats  # (N,) rising, of the camera's clock: start of the trace, each edge, its end
    lit_s: Floats  # (N,)
    on_mains: ClassVar[bool] = False

    @classmethod
    def from_edges(cls, edges_s: Floats, *, begin_s: float, end_s: float) -> TracedWave:
        """Off at `begin_s`, on from the first of `edges_s` (N,) to the second, and so on. Raises ValueError."""
        moments = np.concatenate([[begin_s], edges_s, [end_s]])
        lengths = np.diff(moments)
        if np.any(lengths < 0):
            raise ValueError("edges_s must rise, and lie between begin_s and end_s")
        lengths[0::2] = 0.0  # it is off from the start to the first edge, from the second to the third …
        return cls(moments_s=moments, lit_s=np.concatenate([[0.0], np.cumsum(lengths)]))

    def shares(
        self, rows: Floats, *, phase_cycles: float, start_s: float, exposure_us: float, row_time_us: float
    ) -> Floats:
        """As `Wave.shares`; the trace has its own phase."""
        return self.share_on(start_s + rows * (row_time_us * 1e-6), exposure_us * 1e-6)

    def share_on(self, starts_s: Floats, exposure_s: float) -> Floats:
        """Share of each exposure in which it was on, exact. Raises ValueError where the trace does not cover them."""
        first, last = self.moments_s[[0, -1]]
        if starts_s.min() < first or starts_s.max() + exposure_s > last:
            raise ValueError(
                f"an exposure from {starts_s.min():.6f} to {starts_s.max() + exposure_s:.6f} s is not within "
                f"the trace, {first:.6f} to {last:.6f} s"
            )
        until, since = (np.interp(t, self.moments_s, self.lit_s) for t in (starts_s + exposure_s, starts_s))
        return np.asarray((until - since) / exposure_s)


@dataclass(frozen=True, slots=True, kw_only=True)
class Ripple:
    """A lamp on the mains, whose light follows the power: 1 + depth·cos(2πft), at twice the mains' frequency."""

    frequency_hz: float  # 100 or 120
    depth: float  # a filament's 0.1 to 0.2, a poor LED driver's up to 1
    on_mains: ClassVar[bool] = True

    def shares(
        self, rows: Floats, *, phase_cycles: float, start_s: float, exposure_us: float, row_time_us: float
    ) -> Floats:
        """As `Wave.shares`: over the mean of all time.

        The exposure is a box filter: it leaves sinc(f·T) of the ripple, in the phase of its middle.
        """
        since_s = start_s + 1e-6 * (rows * row_time_us + exposure_us / 2.0)
        left = self.depth * np.sinc(self.frequency_hz * exposure_us * 1e-6)
        return np.asarray(1.0 + left * np.cos(2.0 * np.pi * (phase_cycles + self.frequency_hz * since_s)))


@dataclass(frozen=True, slots=True, kw_only=True)
class BuiltAppearance(PanelAppearance):
    """A face as other people build it.

    Walls may stand out before the diffuser, by `depth`. What is seen through a cell's opening then depends on where the
    camera is: the line of sight through the point p of the opening ends on the diffuser, at p + depth · (p − eye) /
    eye_z, or before that on a wall's face.
    """

    equal_cells: bool = False  # all of one size; else they meet on a lattice, and those at the rim are larger
    leds: int = 1  # a cell has so many along either side, each with its hot spot
    depth: float = 0.0  # by which walls stand out before the diffuser, around the panel too
    wall_glow: float = 0.5  # a wall's face, over the edge of the diffuser that it stands on

    def __post_init__(self) -> None:
        if self.leds < 1 or self.depth < 0:
            raise ValueError(f"leds must be at least 1, depth not negative; are {self.leds} and {self.depth}")

    def lights(self, cells: int, texels: int, eye: Floats | None = None) -> Floats:
        """As `PanelAppearance.lights`. A wall's face is lit by the diffuser's edge that it stands on."""
        x, y, z = (0.0, 0.0, np.inf) if eye is None else eye.tolist()
        across = _axis(cells, texels, self, cells / 2.0 + x, z)
        down = _axis(cells, texels, self, cells / 2.0 - y, z)
        light = _diffused(across.offset, down.offset, self)
        seen = np.outer(down.seen_share, across.seen_share)
        light *= self.wall_glow + (1.0 - self.wall_glow) * seen
        return np.asarray(light * np.outer(down.open_share, across.open_share))


class _Axis(NamedTuple):
    """The lines of sight through the texels of one axis, (n·texels,) each; places in cells of the lattice of walls."""

    open_share: Floats  # of each texel: 0 on a wall's front
    seen_share: Floats  # of what is seen through it: 1 on the diffuser, 0 on a wall's face
    offset: Floats  # of where it ends, from the middle of its cell


def _axis(cells: int, texels: int, appearance: BuiltAppearance, eye_at: float, eye_z: float) -> _Axis:
    front = (np.arange(cells * texels) + 0.5) / texels
    behind = front + appearance.depth / eye_z * (front - eye_at)
    if appearance.equal_cells:  # of a lattice with half a wall more at either end
        front, behind = (appearance.gap / 2.0 + place * (cells - appearance.gap) / cells for place in (front, behind))
    cell = np.floor(front)
    rim = appearance.gap / 2.0 if appearance.equal_cells else 0.0  # the outermost walls stand around the panel's side
    low = np.where(cell == 0, rim, cell + appearance.gap / 2.0)
    high = np.where(cell == cells - 1, cells - rim, cell + 1.0 - appearance.gap / 2.0)
    open_share, seen_share = (
        np.clip(np.minimum(at - low, high - at) * texels + 0.5, 0.0, 1.0) for at in (front, behind)
    )
    return _Axis(open_share, seen_share, np.clip(behind, low, high) - cell - 0.5)


def _diffused(across: Floats, down: Floats, appearance: BuiltAppearance) -> Floats:
    """(rows, columns) light of the diffuser at these offsets from the middles of cells."""
    diffuse = 1.0 - appearance.falloff * (down[:, None] ** 2 + across[None, :] ** 2) / 0.5
    led = (np.arange(appearance.leds) + 0.5) / appearance.leds - 0.5  # along either axis
    spots = [
        np.exp(-((at[:, None] - led) ** 2) / (2.0 * appearance.hot_spot_sigma**2)).sum(axis=1) for at in (down, across)
    ]
    brightest = np.exp(-((led[:, None] - led) ** 2) / (2.0 * appearance.hot_spot_sigma**2)).sum(axis=1).max()
    spot = np.outer(*spots) / brightest**2
    return np.asarray((1.0 - appearance.hot_spot) * diffuse + appearance.hot_spot * spot)


@dataclass(frozen=True, slots=True)
class _Mirrored:
    """The motion of a mirror image below the level y = `y_m`.

    A mirror image is no turned body, but that of the body with left and right swapped is: its x axis is negated.
    """

    body: Trajectory
    y_m: float

    @property
    def moves(self) -> bool:
        return self.body.moves

    def scene_from_body(self, t_s: float) -> Floats:
        up_is_down = np.diag([1.0, -1.0, 1.0, 1.0])
        up_is_down[1, 3] = 2.0 * self.y_m
        return np.asarray(up_is_down @ self.body.scene_from_body(t_s) @ np.diag([-1.0, 1.0, 1.0, 1.0]))


@dataclass(frozen=True, slots=True, kw_only=True)
class GlossyFloor:
    """Something level and glossy below panels and prints: it shows them upside down, a little blurred."""

    y_m: float  # in the scene, whose y points down; the camera must be above
    reflectance: float
    blur: float = 0.01  # deviation, as a share of what is mirrored

    def mirrored(self, surface: Surface) -> Surface:
        """As `Floor.mirrored` of a scene: light on top of the floor's own."""
        *lights, opacity = surface.planes
        sigma = max(self.blur * lights[0].shape[1], 0.1)
        pad = int(np.ceil(3.0 * sigma))
        shown = [_blurred(np.pad(light[:, ::-1], pad) * np.float32(self.reflectance), sigma) for light in lights]
        height, width = opacity.shape
        size_m = (surface.size_m[0] * (1 + 2 * pad / width), surface.size_m[1] * (1 + 2 * pad / height))
        motion = _Mirrored(surface.motion, self.y_m)
        return replace(surface, planes=(*shown, np.zeros_like(shown[0])), size_m=size_m, motion=motion, _levels={})


def _blurred(light: Image, sigma: float) -> Image:
    return np.asarray(cv2.GaussianBlur(light, (0, 0), sigma), np.float32)
