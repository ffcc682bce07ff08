"""Pictures for the decoder's tests, painted here: their truth owes nothing to the code under test.

A panel is painted point by point (25 in each pixel) in linear light, blurred, and multiplied row by row with the share
of the exposure in which its class is on, which is found by counting moments. Then noise and codes.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from ledpi.config.panels import PanelSettings
from ledpi.config.settings import load_config
from ledpi.core.geometry import quad_side
from ledpi.core.records import (
    CameraInfo,
    Floats,
    Frame,
    Intrinsics,
    PanelSpec,
    Pixels,
    Quad,
    Rejected,
    Singles,
    Transfer,
)
from ledpi.decode.proposals import Candidate

Bits = NDArray[np.bool_]
Profile = Callable[[Floats, Floats], Floats]  # light at (u, v), 0..1 across and down the panel

WORDS = {  # of DICT_4X4_50, upright, from the top
    0: "1011/0101/0011/0010",
    7: "1100/0100/1111/0010",
    12: "0000/1110/1011/0111",
    17: "0110/0110/0000/0000",
    23: "1101/1101/1000/0010",
    39: "0001/1100/0101/1010",
    42: "0011/0010/1000/1100",
}
WIDTH, HEIGHT = 640, 480
ROW_TIME_US = 33.67
FRAME_ROWS = 504
TRUE_10_MS_US = 9966.32  # 296 rows: what the sensor makes of 10 ms
SHORT_US = 151.5  # 4.5 rows
SPEC = PanelSpec(side_m=0.16, black_hz=1250.0, white_hz=2450.0)
PHASES = (0.1, 0.63)  # cycles of the black and the white class when row 0's exposure of frame 0 begins
PINHOLE = Intrinsics(width=WIDTH, height=HEIGHT, fx=640.0, fy=640.0, cx=319.5, cy=239.5)
LENS = Intrinsics(
    width=WIDTH, height=HEIGHT, fx=643.0, fy=641.0, cx=322.0, cy=238.0, distortion=(0.09, -0.19, 0.0006, -0.0005, 0.05)
)

_SUB = 5  # points along a pixel's side
_MOMENTS = 2000  # of an exposure at which it is asked whether the light is on
_FULL_WELL_E, _READ_NOISE_E = 8000.0, 8.0


def drawn(text: str) -> Bits:
    """A word written as `1100/0100/…`, from the top."""
    return np.array([[c == "1" for c in row] for row in text.split("/")])


def word(marker_id: int, quarter_turns: int = 0) -> Bits:
    """Returns what a panel shows once it is turned clockwise: its left column, read upward, becomes the top row."""
    bits = drawn(WORDS[marker_id])
    for _ in range(quarter_turns):
        bits = bits[::-1].T
    return bits


def candidate(corners_px: Floats, dark_rows: int = 0) -> Candidate:
    """A candidate with these corners (4, 2), as likely as can be."""
    return Candidate(corners_px, quad_side(corners_px.tolist()), dark_rows)


def square(x: float, y: float, side: float, turn_deg: float = 0.0) -> Floats:
    """(4, 2) corners clockwise in the picture, from the top left, turned clockwise about (x, y)."""
    c, s = math.cos(math.radians(turn_deg)), math.sin(math.radians(turn_deg))
    half = side / 2 * np.array([[-1.0, -1], [1, -1], [1, 1], [-1, 1]])
    return np.asarray(half @ np.array([[c, s], [-s, c]]) + (x, y))


def seen_through(lens: Intrinsics, straight: Floats) -> Floats:
    """Returns where OpenCV's projection puts points (N, 2) that a lens without distortion would show at `straight`."""
    rays = (straight - (lens.cx, lens.cy)) / (lens.fx, lens.fy)
    points = np.column_stack([rays, np.ones(len(rays))])
    still = np.zeros(3)
    return np.asarray(cv2.projectPoints(points, still, still, lens.matrix(), np.array(lens.distortion))[0][:, 0])


def share_on(
    rows: NDArray[np.int64], hz: float, phase_cycles: float, *, exposure_us: float, duty: float, start_us: float
) -> Floats:
    """(N,) share of each row's exposure in which a square wave is on; row 0's exposure begins at `start_us`."""
    moments = exposure_us * (np.arange(_MOMENTS) + 0.5) / _MOMENTS
    cycles = phase_cycles + hz * 1e-6 * (start_us + rows[:, None] * ROW_TIME_US + moments)
    return np.asarray((cycles - np.floor(cycles) < duty).mean(axis=1))  # much quicker than % 1.0


def encode(light: Floats, transfer: Transfer) -> Pixels:
    """8-bit codes of linear light; sRGB as IEC 61966-2-1 defines it."""
    light = np.clip(light, 0.0, 1.0, dtype=np.float32)
    if transfer == "srgb":
        light = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** np.float32(1 / 2.4) - 0.055)
    return np.round(255 * light).astype(np.uint8)


def flat(u: Floats, v: Floats) -> Floats:
    """A panel that is evenly lit to its edge."""
    return np.ones_like(u)


def diffuser(u: Floats, v: Floats) -> Floats:
    """Each cell brightest in its middle, with dark walls between neighbours, as panels are built."""
    (x, across), (y, down) = (_place_in_cell(4 * w) for w in (u, v))
    return np.asarray((1.0 - 0.6 * (x * x + y * y)) * (np.minimum(across, down) > 0.03))


def bare(u: Floats, v: Floats) -> Floats:
    """LEDs behind thin paper: three quarters of a cell's light is in a spot a sixth of it wide; walls as `diffuser`."""
    (x, across), (y, down) = (_place_in_cell(4 * w) for w in (u, v))
    spot = np.exp(-0.5 * (x * x + y * y) / 0.16**2)
    return np.asarray((0.25 + 0.75 * spot) * (np.minimum(across, down) > 0.03))


def _place_in_cell(w: Floats) -> tuple[Floats, Floats]:
    """From the middle of the cell, and from the nearest border that two cells share; in cells."""
    return w - np.floor(w) - 0.5, np.abs(w - np.minimum(np.maximum(np.rint(w), 1), 3))


def one_size(u: Floats, v: Floats) -> Floats:
    """Even cells of one size, with walls of 7 % between them and none at the rim."""
    return np.where(np.maximum((4 - 0.07) * u % 1, (4 - 0.07) * v % 1) < 1 - 0.07, 1.0, 0.03)


class Canvas:
    """One picture in the making: linear light, full scale 1."""

    def __init__(
        self, *, background: float = 0.03, exposure_us: float = TRUE_10_MS_US, transfer: Transfer = "srgb"
    ) -> None:
        self.exposure_us = exposure_us
        self.transfer: Transfer = transfer
        self.light = np.full((HEIGHT, WIDTH), background)

    def panel(
        self,
        corners: Floats,
        cells: Bits,
        *,
        light: float = 0.4,
        profile: Profile = diffuser,
        gains: Floats | None = None,
        spec: PanelSpec = SPEC,
        phases: tuple[float, float] = PHASES,
        start_us: float = 0.0,
        blur_px: float = 0.7,
        lens: Intrinsics | None = None,
    ) -> None:
        """A panel whose `cells` (n, n) fill `corners`; with a `lens`, `corners` are before it bends them.

        `light` is the mean over blinking of a cell of gain 1, `start_us` when row 0's exposure begins.
        """
        level = light * (np.ones(cells.shape) if gains is None else gains)
        area, opacity, (black, white) = _painted(corners, [~cells * level, cells * level], profile, blur_px, lens)
        rows = np.arange(area[0].start, area[0].stop)
        self.light[area] *= 1.0 - opacity
        for picture, hz, phase in ((black, spec.black_hz, phases[0]), (white, spec.white_hz, phases[1])):
            on = share_on(rows, hz, phase, exposure_us=self.exposure_us, duty=spec.duty, start_us=start_us)
            self.light[area] += picture * on[:, None] / spec.duty

    def lamp(
        self,
        corners: Floats,
        light: float = 0.4,
        *,
        profile: Profile = flat,
        blur_px: float = 0.7,
        lens: Intrinsics | None = None,
    ) -> None:
        """A four-sided light that does not blink."""
        area, opacity, (picture,) = _painted(corners, [np.full((1, 1), light)], profile, blur_px, lens)
        self.light[area] = self.light[area] * (1.0 - opacity) + picture

    def disc(self, x: float, y: float, radius: float, light: float = 0.4, *, blur_px: float = 0.7) -> None:
        """A round light that does not blink."""
        down, across = np.mgrid[:HEIGHT, :WIDTH]
        inside = np.clip(radius + 0.5 - np.hypot(across - x, down - y), 0, 1)
        self.light = self.light * (1 - inside) + light * cv2.GaussianBlur(inside, (0, 0), blur_px)

    def frame(self, seed: int | None = 0, *, seq: int = 0) -> Frame:
        """The picture as a frame, with shot and read noise unless `seed` is None."""
        light = self.light
        if seed is not None:
            deviation = np.sqrt(np.maximum(light, 0) / _FULL_WELL_E + (_READ_NOISE_E / _FULL_WELL_E) ** 2)
            light = light + deviation * np.random.default_rng(seed).standard_normal(light.shape)
        return Frame(
            pixels=encode(light, self.transfer),
            seq=seq,
            row0_readout_ns=round(1e9 + seq * FRAME_ROWS * ROW_TIME_US * 1e3),
            exposure_us=self.exposure_us,
            row_time_us=ROW_TIME_US,
            transfer=self.transfer,
        )


Painted = tuple[tuple[slice, slice], Floats, list[Floats]]


def _painted(
    corners: Floats, levels: list[Floats], profile: Profile, blur_px: float, lens: Intrinsics | None
) -> Painted:
    """Returns where in the picture, how opaque there, and the blurred light of each of `levels`, (n, n) cells.

    Kept for the next frame, or the next exposure, of the same panel in the same place.
    """
    key = tuple(np.ascontiguousarray(level, dtype=np.float64).tobytes() for level in levels)
    exact = np.ascontiguousarray(corners, dtype=np.float64)
    return _painted_once(exact.tobytes(), key, len(levels[0]), profile, blur_px, lens)


@lru_cache(maxsize=96)
def _painted_once(
    places: bytes, lights: tuple[bytes, ...], cells: int, profile: Profile, blur_px: float, lens: Intrinsics | None
) -> Painted:
    corners = np.frombuffer(places).reshape(4, 2)
    levels = [np.frombuffer(light).reshape(cells, cells) for light in lights]
    outline = corners if lens is None else seen_through(lens, corners)
    margin = math.ceil(4 * blur_px) + 2
    low = np.maximum(np.floor(outline.min(axis=0)).astype(int) - margin, 0)
    high = np.minimum(np.ceil(outline.max(axis=0)).astype(int) + margin + 1, (WIDTH, HEIGHT))
    size = high - low
    steps = [low[i] - 0.5 + (np.arange(size[i] * _SUB) + 0.5) / _SUB for i in (0, 1)]
    x, y = steps[0][None, :], steps[1][:, None]
    if lens is not None:
        matrix, points = lens.matrix(), np.stack(np.broadcast_arrays(x, y), axis=-1).reshape(-1, 1, 2)
        straight = cv2.undistortPoints(points, matrix, np.array(lens.distortion), None, matrix)
        x, y = straight.reshape(*size[::-1] * _SUB, 2).transpose(2, 0, 1)
    unit = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
    # Relative to the first corner, so that float32 is fine enough for OpenCV's solver.
    to_unit = cv2.getPerspectiveTransform((corners - corners[0]).astype(np.float32), unit)
    across, down, scale = (a * (x - corners[0, 0]) + (b * (y - corners[0, 1]) + c) for a, b, c in to_unit)
    u, v = across / scale, down / scale
    inside = (u >= 0) & (u < 1) & (v >= 0) & (v < 1)
    row, column = (np.clip((cells * w).astype(np.int32), 0, cells - 1) for w in (v, u))
    cell = cells * row + column
    bright = (inside * profile(u.astype(np.float32), v.astype(np.float32))).astype(np.float32)

    def pixels(fine: Singles) -> Floats:
        smooth = cv2.GaussianBlur(fine, (0, 0), blur_px * _SUB) if blur_px > 0 else fine
        return cv2.resize(smooth, size, interpolation=cv2.INTER_AREA).astype(np.float64)  # the mean of each 5 × 5

    area = (slice(low[1], high[1]), slice(low[0], high[0]))
    shown = [bright * level.astype(np.float32).take(cell) for level in levels]
    return area, pixels(inside.astype(np.float32)), [pixels(fine) for fine in shown]


def quad(corners: Floats) -> Quad:
    """Corners that are known exactly."""
    return Quad(corners_px=corners)


def reason(result: object) -> str:
    """The counter's name of what was rejected; what it is where it was not."""
    return result.key if isinstance(result, Rejected) else f"not rejected: {type(result).__name__}"


def panel_settings(*overrides: str) -> PanelSettings:
    """The configuration's panels, as in SPEC unless overridden: `panels.white_hz=2000`."""
    return load_config(None, ("panels.side_m=0.16", *overrides)).panels


def camera_info(*, exposure_us: float = TRUE_10_MS_US, transfer: Transfer = "srgb") -> CameraInfo:
    return CameraInfo(width=WIDTH, height=HEIGHT, exposure_us=exposure_us, row_time_us=ROW_TIME_US, transfer=transfer)
