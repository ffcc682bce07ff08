"""Things to photograph, and what with: panels, other lights, a room, a sensor. Frozen records.

Everything stands in the `scene` frame: x right, y down, z ahead, metres; the camera's optical frame while
the camera has not moved. Levels are linear light in shares of the sensor's full scale, so 1.0 saturates. A
scene states the level at which a thing is pictured, whatever the exposure and the gain: these decide bands
and noise, not brightness.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING, ClassVar, Literal, Protocol

import numpy as np

from ledpi.camera.simulate.trajectory import Still, Trajectory
from ledpi.core.codewords import Bits
from ledpi.core.records import Floats, Intrinsics, PanelSpec, Transfer
from ledpi.core.shutter import row_weights

if TYPE_CHECKING:
    from ledpi.camera.simulate.surface import Surface

OV5647_ROW_TIME_US = 1852 / 55.0  # 1852 pixel clocks a row at 55 MHz: the sensor's 640×480 mode, 33.67 µs
OV5647_FRAME_LENGTH_ROWS = 504
FIRST_READOUT_NS = 1_000_000_000  # frame 0; oscillators run from t = 0, so no exposure begins before they do


@dataclass(frozen=True, slots=True, kw_only=True)
class PanelAppearance:
    """The light over a panel's face. Lengths are shares of a cell's pitch."""

    gap: float = 0.06  # dark wall between neighbouring cells; the lit grid's outer edge has none
    bezel: float = 0.15  # unlit frame around the lit grid
    falloff: float = 0.2  # how much darker a cell's corner is than its middle, smoothly
    hot_spot: float = 0.2  # share of the peak that comes from the LED shining through the diffuser
    hot_spot_sigma: float = 0.2
    albedo: float = 0.3  # what the unlit face returns of the room's uniform level

    def lights(self, cells: int, texels: int, eye: Floats | None = None) -> Floats:
        """(n·texels, n·texels) light of cells of peak 1, row 0 at the top; half of it at a wall's edge, as its face.

        `eye` (3,): the camera in the panel's frame (x right, y up, z out of its front), in pitches of a cell, for
        faces that look different from aside; None: far ahead.
        """
        place = (np.arange(cells * texels) + 0.5) / texels
        cell = np.floor(place)
        low = np.where(cell == 0, 0.0, cell + self.gap / 2.0)
        high = np.where(cell == cells - 1, cells, cell + 1.0 - self.gap / 2.0)
        along = np.clip(place, low, high) - cell - 0.5
        diffuse = 1.0 - self.falloff * (along[:, None] ** 2 + along**2) / 0.5
        spot = np.exp(-(along**2) / (2.0 * self.hot_spot_sigma**2))
        light = (1.0 - self.hot_spot) * diffuse + self.hot_spot * np.outer(spot, spot)
        clear = np.clip(np.minimum(place - low, high - place) * texels + 0.5, 0.0, 1.0)
        shown = np.outer(clear, clear)
        return np.asarray(light * (0.5 + 0.5 * shown) * shown)


class Wave(Protocol):
    """A light that goes on and off."""

    @property
    def on_mains(self) -> bool:
        """Tells whether its phase is that of all lamps in the room."""
        ...

    def shares(
        self, rows: Floats, *, phase_cycles: float, start_s: float, exposure_us: float, row_time_us: float
    ) -> Floats:
        """Share of each row's exposure in which it is on; `start_s`: when row 0's begins, `phase_cycles`: at 0 s."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class SquareWave:
    """A light that is switched: on for `duty` of each period."""

    frequency_hz: float
    duty: float = 0.5
    on_mains: ClassVar[bool] = False

    def shares(
        self, rows: Floats, *, phase_cycles: float, start_s: float, exposure_us: float, row_time_us: float
    ) -> Floats:
        """As `Wave.shares`."""
        return row_weights(
            rows,
            frequency_hz=self.frequency_hz,
            phase_cycles=(phase_cycles + self.frequency_hz * start_s) % 1.0,
            duty=self.duty,
            exposure_us=exposure_us,
            row_time_us=row_time_us,
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Panel:
    """A panel, `motion` being scene_from_marker."""

    codeword: Bits  # (n, n), row 0 at the top of the marker; True blinks at white_hz
    spec: PanelSpec
    motion: Trajectory
    marker_id: int | None  # None for a panel that is no marker, a decoy: it has no truth
    brightness: float = 0.45  # level at the brightest point of a cell of gain 1, averaged over its blinking
    cell_gains: Floats | None = None  # (n, n); None: all 1
    cell_waves: tuple[Wave, ...] | None = None  # row by row; None: the codeword's classes, ideal square waves
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
    wave: Wave | None = None  # None: constant


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
    ripple: Wave | None = None  # of the lamps that light it; None: daylight


class Floor(Protocol):
    """Something level and glossy below panels and prints."""

    def mirrored(self, surface: Surface) -> Surface:
        """Returns what it shows of one, in the same waves."""
        ...


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
