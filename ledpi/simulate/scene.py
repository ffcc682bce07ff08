"""Things to photograph, and what with: panels, other lights, a room, a sensor. Frozen records.

Everything stands in the `scene` frame: x right, y down, z ahead, metres; the camera's optical frame while
the camera has not moved. Levels are linear light in shares of the sensor's full scale, so 1.0 saturates. A
scene states the level at which a thing is pictured, whatever the exposure and the gain: these decide bands
and noise, not brightness.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

import numpy as np

from ledpi.core.records import Floats, Intrinsics, PanelSpec, Transfer
from ledpi.markers.codewords import Bits
from ledpi.simulate.trajectory import Still, Trajectory

OV5647_ROW_TIME_US = 1852 / 55.0  # 1852 pixel clocks a row at 55 MHz: the sensor's 640×480 mode, 33.67 µs
OV5647_FRAME_LENGTH_ROWS = 504
FIRST_READOUT_NS = 1_000_000_000  # frame 0; oscillators run from t = 0, so no exposure begins before they do


@dataclass(frozen=True, slots=True, kw_only=True)
class PanelAppearance:
    """The light over a panel's face. Lengths are shares of a cell's pitch."""

    gap: float = 0.06  # dark wall between neighbouring cells; the lit grid's outer edge has none
    equal_cells: bool = False  # all of one size; else they meet on a lattice, and those at the rim are larger
    bezel: float = 0.15  # unlit frame around the lit grid
    falloff: float = 0.2  # how much darker a cell's corner is than its middle, smoothly
    hot_spot: float = 0.2  # share of the peak that comes from the LED shining through the diffuser
    hot_spot_sigma: float = 0.2
    leds: int = 1  # a cell has so many along either side, each with its hot spot
    depth: float = 0.0  # by which walls stand out before the diffuser, around the panel too
    wall_glow: float = 0.5  # a wall's face, over the edge of the diffuser that it stands on
    albedo: float = 0.3  # what the unlit face returns of the room's uniform level

    def __post_init__(self) -> None:
        if self.leds < 1 or self.depth < 0:
            raise ValueError(f"leds must be at least 1, depth not negative; are {self.leds} and {self.depth}")


@dataclass(frozen=True, slots=True, kw_only=True)
class SquareWave:
    """A light that is switched: on for `duty` of each period."""

    frequency_hz: float
    duty: float = 0.5


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TracedWave:
    """A light that is switched at recorded moments, as a driver's pin was traced.

    Kept as its integral: for how long it has been on until each moment, linear in between.
    """

    moments_s: Floats  # (N,) rising, of the camera's clock: start of the trace, each edge, its end
    lit_s: Floats  # (N,)

    @classmethod
    def from_edges(cls, edges_s: Floats, *, begin_s: float, end_s: float) -> TracedWave:
        """Off at `begin_s`, on from the first of `edges_s` (N,) to the second, and so on. Raises ValueError."""
        moments = np.concatenate([[begin_s], edges_s, [end_s]])
        lengths = np.diff(moments)
        if np.any(lengths < 0):
            raise ValueError("edges_s must rise, and lie between begin_s and end_s")
        lengths[0::2] = 0.0  # it is off from the start to the first edge, from the second to the third …
        return cls(moments_s=moments, lit_s=np.concatenate([[0.0], np.cumsum(lengths)]))

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

    def row_levels(self, rows: Floats, *, phase_cycles: float, exposure_us: float, row_time_us: float) -> Floats:
        """Mean over each row's exposure, over the mean of all time; `phase_cycles` as row 0's exposure begins.

        The exposure is a box filter: it leaves sinc(f·T) of the ripple, in the phase of its middle.
        """
        middle = phase_cycles + self.frequency_hz * 1e-6 * (rows * row_time_us + exposure_us / 2.0)
        left = self.depth * np.sinc(self.frequency_hz * exposure_us * 1e-6)
        return np.asarray(1.0 + left * np.cos(2.0 * np.pi * middle))


Wave = SquareWave | TracedWave | Ripple


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Panel:
    """A panel, `motion` being scene_from_marker."""

    codeword: Bits  # (n, n), row 0 at the top of the marker; True blinks at white_hz
    spec: PanelSpec
    motion: Trajectory
    marker_id: int | None  # None for a panel that is no marker, a decoy: it has no truth
    brightness: float = 0.45  # level at the brightest point of a cell of gain 1, averaged over its blinking
    cell_gains: Floats | None = None  # (n, n); None: all 1
    cell_waves: tuple[TracedWave, ...] | None = None  # row by row; None: the codeword's classes, ideal square waves
    appearance: PanelAppearance = field(default_factory=PanelAppearance)

    def __post_init__(self) -> None:
        n = len(self.codeword)
        if self.codeword.shape != (n, n):
            raise ValueError(f"a panel's codeword must be square, not {self.codeword.shape}")
        if self.cell_gains is not None and self.cell_gains.shape != (n, n):
            raise ValueError(f"cell_gains must be ({n}, {n}), not {self.cell_gains.shape}")
        if self.cell_waves is not None and len(self.cell_waves) != n * n:
            raise ValueError(f"cell_waves must be {n * n}, not {len(self.cell_waves)}")
        if not self.brightness >= 0:
            raise ValueError(f"brightness must not be negative, is {self.brightness}")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Light:
    """A flat lamp or window, or with `level` 0 a flat thing in the way.

    `motion` is scene_from_light; its z comes out of its front, as a panel's does, and its back is never seen.
    """

    shape: Literal["rectangle", "disc", "lattice"]
    width_m: float
    height_m: float
    motion: Trajectory
    level: float  # averaged over its blinking
    panes: tuple[int, int] = (3, 2)  # of a lattice: across, down
    bar: float = 0.12  # of a lattice: width of the bars, share of a pane's pitch
    wave: SquareWave | Ripple | None = None  # None: constant


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Print:
    """Black on white paper: a marker to compare panels with, a calibration board. `motion` is scene_from_print."""

    modules: Bits  # (rows, columns), row 0 at the top, a marker's black border included; True is white
    width_m: float  # of the modules
    motion: Trajectory
    white: float = 0.45  # level of the paper
    black: float = 0.03  # level of the ink
    quiet_modules: int = 1  # white paper around, in widths of a module


@dataclass(frozen=True, slots=True, kw_only=True)
class Room:
    """Ambient light: a textured wall across the view, square to the scene's z axis."""

    level: float = 0.08  # the wall's mean; panels' unlit faces return their albedo of it
    contrast: float = 0.6  # the texture's darkest and brightest are level × (1 ∓ contrast)
    distance_m: float = 4.0
    texture: int = 0  # which of the procedural pictures
    ripple: Ripple | None = None  # of the lamps that light it; None: daylight


@dataclass(frozen=True, slots=True, kw_only=True)
class Floor:
    """Something level and glossy below panels and prints: it shows them upside down, a little blurred."""

    y_m: float  # in the scene, whose y points down; the camera must be above
    reflectance: float
    blur: float = 0.01  # deviation, as a share of what is mirrored


@dataclass(frozen=True, slots=True, kw_only=True)
class SimulatedSensor:
    """Lens and sensor. Full well and read noise are assumptions of the OV5647's order, not measurements.

    Its data sheet's signal-to-noise ratio of at most 36 dB is 4000 electrons a pixel, and the 640×480 mode
    bins.
    """

    intrinsics: Intrinsics
    exposure_us: float
    row_time_us: float = OV5647_ROW_TIME_US
    frame_length_rows: int = OV5647_FRAME_LENGTH_ROWS
    transfer: Transfer = "srgb"
    psf_sigma_px: float = 0.7  # the lens's blur, Gaussian
    defocus_px: float = 0.0  # radius of the disc that a point out of focus becomes
    full_well_e: float = 8000.0
    read_noise_e: float = 8.0
    gain: float = 1.0  # full scale is full_well_e / gain electrons
    tone_contrast: float = 0.0  # 0…1: how much of a curve with a toe and a shoulder follows on the transfer
    sharpening: float = 0.0  # how much of what a blur by a pixel takes off the picture is added to it

    def __post_init__(self) -> None:
        if not (self.exposure_us > 0 and self.row_time_us > 0 and self.gain > 0 and self.full_well_e > 0):
            raise ValueError("exposure_us, row_time_us, gain and full_well_e must be positive")
        if not min(self.psf_sigma_px, self.defocus_px, self.read_noise_e, self.sharpening) >= 0:
            raise ValueError("psf_sigma_px, defocus_px, read_noise_e and sharpening must not be negative")
        if not 0 <= self.tone_contrast <= 1:
            raise ValueError(f"tone_contrast must be between 0 and 1, is {self.tone_contrast}")
        if self.frame_length_rows < self.intrinsics.height:
            rows = self.intrinsics.height
            raise ValueError(f"frame_length_rows must be at least {rows}, is {self.frame_length_rows}")
        if self.exposure_us * 1e3 > FIRST_READOUT_NS:
            raise ValueError(f"exposure_us must be at most {FIRST_READOUT_NS / 1e3:.0f}")

    def row0_readout_ns(self, seq: int) -> int:
        """Start of row 0's read-out of frame `seq`, on the camera's clock."""
        return FIRST_READOUT_NS + round(seq * self.frame_length_rows * self.row_time_us * 1e3)

    def readout_end_ns(self, seq: int) -> int:
        """When the last row of frame `seq` has been read: the frame exists from then on."""
        return self.row0_readout_ns(seq) + round(self.intrinsics.height * self.row_time_us * 1e3)

    def exposure_start_s(self, seq: int, row: float = 0.0) -> float:
        """When `row` of frame `seq` began its exposure, in seconds of the camera's clock."""
        return self.row0_readout_ns(seq) * 1e-9 + (row * self.row_time_us - self.exposure_us) * 1e-6

    def mid_exposure_s(self, seq: int, row: float) -> float:
        """When `row` of frame `seq` was half-way through its exposure."""
        return self.exposure_start_s(seq, row) + self.exposure_us * 0.5e-6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene:
    """All that the renderer needs but the seed."""

    sensor: SimulatedSensor
    panels: tuple[Panel, ...] = ()
    lights: tuple[Light, ...] = ()
    prints: tuple[Print, ...] = ()
    room: Room = field(default_factory=Room)
    floor: Floor | None = None
    camera_motion: Trajectory = field(default_factory=Still)  # scene_from_camera


def uneven_gains(rng: np.random.Generator, cells_per_side: int, deviation: float) -> Floats:
    """(n, n) gains around 1 with the given standard deviation, as LEDs of one batch have, at least 0.05."""
    gains = 1.0 + deviation * rng.standard_normal((cells_per_side, cells_per_side))
    return np.maximum(gains, 0.05)
