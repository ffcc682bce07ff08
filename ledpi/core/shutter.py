"""The rolling shutter: what a blinking light leaves in the rows of a picture; and from its values to linear light.

Symbols: T exposure (s), t_row time between the starts of two rows (s), f blink frequency (Hz), d duty, φ phase of
the square wave in cycles at t = 0, y row. Row y collects light over [t0 + y·t_row, t0 + y·t_row + T]; a lamp whose
state is s(t) ∈ {0, 1} shows there as its static picture times w(y) = (1/T)·∫ s dt over that window.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import replace
from functools import cache, lru_cache
from statistics import median
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from ledpi.core.records import CameraInfo, Floats, Frame, Transfer

SATURATED = 255  # the only value of an 8-bit picture that may stand for any amount of light


def _square_wave_integral(cycles: Floats, duty: float) -> Floats:
    """∫ s from 0 to `cycles`, in cycles, for s = 1 on [n, n + duty) and 0 elsewhere."""
    whole = np.floor(cycles)
    return whole * duty + np.minimum(cycles - whole, duty)


def exposure_weight(start_cycles: Floats, exposure_cycles: float, duty: float = 0.5) -> Floats:
    """Share of an exposure in which the square wave is on: w = (S(c + fT) − S(c)) / fT, exact.

    `start_cycles` is the wave's phase (cycles, any shape) at the start of the exposure; the wave is on where the
    fractional part is below `duty`. `exposure_cycles` is f·T. Returns the same shape, in 0..1, mean `duty`.
    """
    if not exposure_cycles > 0:
        raise ValueError(f"exposure_cycles must be positive, not {exposure_cycles}")
    rise = _square_wave_integral(start_cycles + exposure_cycles, duty) - _square_wave_integral(start_cycles, duty)
    return rise / exposure_cycles


def row_weights(
    rows: Floats, *, frequency_hz: float, phase_cycles: float, duty: float, exposure_us: float, row_time_us: float
) -> Floats:
    """w(y) for each of `rows`; `phase_cycles` is the wave's phase when row 0's exposure begins."""
    start = phase_cycles + frequency_hz * row_time_us * 1e-6 * rows
    return exposure_weight(start, frequency_hz * exposure_us * 1e-6, duty)


def contrast(frequency_hz: float, exposure_us: float, duty: float = 0.5) -> float:
    """Peak-to-peak of w(y) over its mean.

    For duty 0.5 this is 2·min(r, 1 − r)/(f·T), r = frac(f·T), and at most 2. In general the whole cycles inside the
    exposure add a constant and the remaining part r sees between max(0, r + d − 1) and min(r, d) cycles of light.
    """
    cycles = frequency_hz * exposure_us * 1e-6
    remainder = cycles - math.floor(cycles)
    swing = min(remainder, duty) - max(0.0, remainder + duty - 1.0)
    return swing / (cycles * duty)


@lru_cache(maxsize=256)
def harmonic_amplitude(harmonic: int, frequency_hz: float, exposure_us: float, duty: float = 0.5) -> float:
    """Amplitude of the h-th harmonic of w(y), over w's mean: 2·|sinc(h·d)|·|sinc(h·f·T)|, sinc x = sin πx / πx.

    The Fourier series of the square wave, times the transfer function of the exposure, which is a box filter.
    """
    cycles = frequency_hz * exposure_us * 1e-6
    return float(2.0 * abs(np.sinc(harmonic * duty)) * abs(np.sinc(harmonic * cycles)))


def band_width_rows(frequency_hz: float, *, rows: int, scan_time_s: float) -> float:
    """Height of one bright or dark band: w = n/T · 1/(2f).

    The source paper's equation. Its text calls T the exposure time, but the band's height follows from the time in
    which the n rows are *scanned*, T = n·t_row; the exposure only decides how deep the band is.
    """
    return rows / scan_time_s / (2.0 * frequency_hz)


def phase_advance_cycles(frequency_hz: float, frame_period_us: float) -> float:
    """Returns how far the bands move from frame to frame, in cycles, nearest to zero: within [−0.5, 0.5].

    Near 0 two frames show the same bands, and their difference shows none.
    """
    cycles = frequency_hz * frame_period_us * 1e-6
    return cycles - round(cycles)


def row_mid_exposure_ns(frame: Frame, row: float) -> int:
    """When `row` of this frame was half-way through its exposure, on the camera's clock.

    Row 0 is read out at the end of its exposure, so its middle lies T/2 before `row0_readout_ns`.
    """
    return frame.row0_readout_ns + round((row * frame.row_time_us - frame.exposure_us / 2) * 1e3)


@cache
def linear_light(transfer: Transfer, *, mark_saturated: bool = True) -> NDArray[np.float32]:
    """Look-up table (256,) from picture value to linear light, 0..1; NaN where the value is saturated.

    `srgb` is IEC 61966-2-1's inverse. NaN passes through interpolation, so that whatever touched a saturated pixel
    is known to be worthless, at no further cost. Where only edges are sought, saturated light is 1.
    """
    value = np.arange(256) / 255.0
    if transfer == "srgb":
        value = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    table = value.astype(np.float32)
    if mark_saturated:
        table[SATURATED:] = np.nan
    table.flags.writeable = False
    return table


Exposed = TypeVar("Exposed", CameraInfo, Frame)

INTERVALS = 64  # the latest that are remembered
MIN_INTERVALS = 3
# Drivers have been off by 6 %. What is further off is a gap, or a period that does not follow from the rows.
MAX_RATIO = 1.1
# Within 1 % the report is believed: whole microseconds of rounding, and no band moves by a tenth of its cycle within
# a panel for less.
MIN_DEVIATION = 0.01
SIGNIFICANT_SIGMA = 5.0  # standard errors that a deviation must have, where times are taken by a busy computer
# Three intervals that are off by much may agree to a hair by chance: of fewer than so many, the one that is furthest
# from their middle says how well they are known.
MIN_FOR_MEDIAN = 8


class RowClock:
    """Takes in when frames were read out; says by how much their rows are slower than reported.

    A sensor's frame is a whole number of rows, blanking included, so row time = frame interval / rows of a frame. A
    driver that believes in another pixel clock misreports the row time, and with it the exposure, which is a whole
    number of rows too; the frames' intervals it cannot bend.
    """

    def __init__(self, camera: CameraInfo) -> None:
        self._reported_ns = None
        if camera.frame_length_rows is not None:
            self._reported_ns = camera.frame_length_rows * camera.row_time_us * 1e3
        self._ratios: deque[float] = deque(maxlen=INTERVALS)
        self._last: tuple[int, int] | None = None
        self.ratio = 1.0  # true row time over the reported one; 1 unless the frames surely say otherwise

    def add(self, seq: int, row0_readout_ns: int) -> None:
        """The next frame. Gaps in `seq` and jumps in time are legal, and left out."""
        if self._reported_ns is not None and self._last is not None and seq > self._last[0]:
            ratio = (row0_readout_ns - self._last[1]) / (seq - self._last[0]) / self._reported_ns
            if 1 / MAX_RATIO < ratio < MAX_RATIO:
                self._ratios.append(ratio)
                self.ratio = self._significant_ratio()
        self._last = seq, row0_readout_ns

    def _significant_ratio(self) -> float:
        if len(self._ratios) < MIN_INTERVALS:
            return 1.0
        middle = median(self._ratios)
        away = [abs(ratio - middle) for ratio in self._ratios]
        # Of a median of n normal values: 1.25·σ/√n, σ = 1.48 times the median distance from it.
        sigma = max(away) if len(away) < MIN_FOR_MEDIAN else 1.48 * median(away)
        error = 1.25 * sigma / math.sqrt(len(away))
        off = abs(middle - 1.0)
        return middle if off > max(MIN_DEVIATION, SIGNIFICANT_SIGMA * error) else 1.0

    def corrected(self, exposed: Exposed) -> Exposed:
        """A frame, or all of a camera's, with its true row time and exposure."""
        if self.ratio == 1.0:
            return exposed
        row_time_us, exposure_us = exposed.row_time_us * self.ratio, exposed.exposure_us * self.ratio
        return replace(exposed, row_time_us=row_time_us, exposure_us=exposure_us)


def row_time_note(row_time_us: float, ratio: float) -> str:
    """Says what to tell the user where `row_time_us` is `ratio` times the reported one."""
    return (
        f"the frames' times say that a row takes {row_time_us:.2f} µs, not {row_time_us / ratio:.2f} µs as reported; "
        "row time and exposure are corrected"
    )
