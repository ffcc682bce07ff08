"""A panel's frequencies, duty and depth, from its light over many frames; and what would make its bands easier to read.

Pure. The row time must be known; the panel's announced frequencies only roughly.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ledpi.camera.timing import MIN_PHASE_ADVANCE_CYCLES, choose_frame_length_rows, frame_duration_us
from ledpi.core import shutter
from ledpi.core.codewords import Dictionary
from ledpi.core.errors import CalibrationError
from ledpi.core.records import PanelSpec, Phase
from ledpi.workshop.calibrate.bands import CLOCK_SIGMA, ClassBands, PanelLight, Waves, measure_codeword, search_step_hz
from ledpi.workshop.panel.frequencies import null_share

SEARCH = 0.15  # of the announced frequency, to either side: more than an RC oscillator is off
MIN_ALIAS_DEVIATIONS = 6.0  # between a frequency and the next that looks alike from frame to frame
ROW_TIME_DOUBT = (5.0, 0.003)  # deviations, and share: more than both, and bands and row time contradict each other
MAX_APART = 5.0  # deviations between what either class of a panel in antiphase says of their one frequency
MAX_DUTY_SIGMA = 0.02
MAX_LIGHT_SHARE = 1.1  # of the depth that all of the light would give: above it, the reported exposure is wrong
# A panel that is within these of what is announced needs no entry of its own: each other pair of frequencies costs the
# decoder a look of its own at every square. Over its memory of half a second 1e-4 of 2450 Hz is an eighth of a cycle.
SAME_FREQUENCY, SAME_DUTY = 1e-4, 0.03
# Of the deepest bands that an exposure of this length leaves (`null_share`). Below the first, as in a third of a lobe,
# it is worth a warning; and an exposure is proposed for which all frequencies reach the second, as in half of a lobe.
WEAK, STRONG = 1 / 3, 0.5


@dataclass(frozen=True, slots=True, kw_only=True)
class PanelCalibration:
    """Measurements of one panel."""

    id: int
    black: ClassBands
    white: ClassBands  # in antiphase at the same frequency
    phase: Phase  # as announced
    duty: float | None  # None where this exposure hides it
    duty_sigma: float
    blinking_share: tuple[float, float]  # of each class's light: the rest is steady, as a reflection is

    def overrides(self, announced: PanelSpec) -> dict[str, float]:
        """Returns what belongs into `panels.overrides`: no duty that is off the announced one by noise only."""
        values = {"black_hz": round(self.black.frequency_hz, 2), "white_hz": round(self.white.frequency_hz, 2)}
        if self.duty is not None and self._other_duty(announced):
            values["duty"] = round(self.duty, 3)
        return values

    def _other_duty(self, announced: PanelSpec) -> bool:
        # In antiphase it is a half by its nature.
        return self.duty is not None and self.phase == "free" and abs(self.duty - announced.duty) > SAME_DUTY

    def differs_from(self, announced: PanelSpec) -> bool:
        """Tells whether the decoder should know of it."""
        pairs = ((self.black, announced.black_hz), (self.white, announced.white_hz))
        if any(abs(bands.frequency_hz / hz - 1) > SAME_FREQUENCY for bands, hz in pairs):
            return True
        return self._other_duty(announced)


def measure_panel(
    light: PanelLight, dictionary: Dictionary, announced: PanelSpec, *, exposure_us: float, row_time_us: float
) -> PanelCalibration:
    """Searches ±15 % around the announced frequencies. Raises CalibrationError where nothing sure is found."""
    row_time_s = row_time_us * 1e-6
    spans = search_ranges(announced)
    waves = [_waves(light, span, row_time_s) for span in spans]
    codewords = dictionary.rotated_codewords().reshape(4 * len(dictionary.codewords), -1)
    found = measure_codeword(light, codewords, waves)
    if not (found.black.certain and found.white.certain):
        names = ("black", "white") if announced.phase == "free" else ("both classes",)
        sought = [f"{low:.0f} and {high:.0f} Hz ({name})" for name, (low, high) in zip(names, spans, strict=True)]
        raise CalibrationError(f"no bands of a {dictionary.name} panel between {' and '.join(sought)}")
    measured = (found.black, found.white)
    if announced.phase == "antiphase":
        measured = _share_oscillator(measured)
    for bands in measured:
        _check_aliases(bands, light, row_time_s)
    for bands in measured:
        _check_row_time(bands, row_time_s)
    duty, duty_sigma = _duty(measured, exposure_us)
    return PanelCalibration(
        id=found.codeword // 4,
        black=measured[0],
        white=measured[1],
        phase=announced.phase,
        duty=duty,
        duty_sigma=duty_sigma,
        blinking_share=(
            _blinking_share(measured[0], exposure_us, duty or announced.duty),
            _blinking_share(measured[1], exposure_us, duty or announced.duty),
        ),
    )


def frequency_sigma_hz(bands: ClassBands) -> float:
    """Deviation of a frequency in true time: that of the fit, and of the camera's clock."""
    return math.hypot(bands.frequency_sigma_hz, CLOCK_SIGMA * bands.frequency_hz)


def search_ranges(announced: PanelSpec) -> list[tuple[float, float]]:
    """Returns where the frequency of each of the panel's waves is sought; the ranges do not overlap."""
    middle = math.sqrt(announced.black_hz * announced.white_hz)
    spans = []
    for hz in announced.waves_hz:
        low, high = hz * (1 - SEARCH), hz * (1 + SEARCH)
        if hz != middle:
            low, high = (low, min(high, middle)) if hz < middle else (max(low, middle), high)
        spans.append((low, high))
    return spans


def advice(
    frequencies_hz: Sequence[float], *, exposure_us: float, row_time_us: float, frame_interval_us: float
) -> list[str]:
    """Says what keeps bands of these frequencies from being deep and moving, and what would be better; a line each."""
    lines = []
    weak = [hz for hz in frequencies_hz if null_share(hz, exposure_us) < WEAK]
    for hz in weak:
        periods = hz * exposure_us * 1e-6
        lines.append(
            f"{hz:.1f} Hz is near a null: an exposure of {exposure_us:.0f} µs holds {periods:.2f} periods, and leaves "
            f"{null_share(hz, exposure_us):.0%} of the depth that {math.floor(periods) + 0.5:g} would"
        )
    better = better_exposure_us(exposure_us, row_time_us, frequencies_hz) if weak else None
    if better is not None:
        lines.append(f"camera.exposure_us: {math.ceil(better)} would be better")
    standing = [
        (hz, moved)
        for hz in frequencies_hz
        if abs(moved := shutter.phase_advance_cycles(hz, frame_interval_us)) < MIN_PHASE_ADVANCE_CYCLES
    ]
    for hz, moved in standing:
        lines.append(f"the bands of {hz:.1f} Hz move by only {moved:+.2f} periods from frame to frame")
    rows = round(frame_interval_us / row_time_us)
    better = better_interval_us(rows, row_time_us, frequencies_hz) if standing else None
    if better is not None:
        lines.append(f"camera.frame_duration_us: {better:.0f} would be better")
    return lines


def better_exposure_us(exposure_us: float, row_time_us: float, frequencies_hz: Sequence[float]) -> float | None:
    """The exposure of whole rows nearest to this one in which no class's bands are weak, if there is one."""
    candidates = (np.arange(4, 2 * round(exposure_us / row_time_us) + 8) * row_time_us).tolist()
    good = [t for t in candidates if min(null_share(hz, t) for hz in frequencies_hz) >= STRONG]
    return min(good, key=lambda t: abs(t - exposure_us), default=None)


def better_interval_us(frame_rows: int, row_time_us: float, frequencies_hz: Sequence[float]) -> float | None:
    """The next longer frame interval of whole rows that keeps all phases moving, if there is one."""
    try:
        rows = choose_frame_length_rows(
            shortest_rows=frame_rows, row_time_us=row_time_us, frequencies_hz=frequencies_hz
        )
    except ValueError:
        return None
    return frame_duration_us(rows, row_time_us)


def _waves(light: PanelLight, span_hz: tuple[float, float], row_time_s: float) -> Waves:
    step = search_step_hz(light)
    grid = np.arange(span_hz[0], span_hz[1] + step, step)
    return Waves(frequency_hz=grid, cycles_per_row=grid * row_time_s)


def _share_oscillator(measured: tuple[ClassBands, ClassBands]) -> tuple[ClassBands, ClassBands]:
    """Both classes at the mean of their frequencies. Raises CalibrationError where these are not one."""
    black, white = measured
    weights = [bands.frequency_sigma_hz**-2 for bands in measured]
    mean = sum(w * b.frequency_hz for w, b in zip(weights, measured, strict=True)) / sum(weights)
    apart = abs(black.frequency_hz - white.frequency_hz)
    if apart > max(MAX_APART * math.hypot(black.frequency_sigma_hz, white.frequency_sigma_hz), SAME_FREQUENCY * mean):
        raise CalibrationError(
            f"classes that blink at {black.frequency_hz:.2f} and {white.frequency_hz:.2f} Hz are not in antiphase: see "
            "panels.phase"
        )
    sigma = sum(weights) ** -0.5
    common = [replace(bands, frequency_hz=mean, frequency_sigma_hz=sigma) for bands in measured]
    return common[0], common[1]


def _check_aliases(bands: ClassBands, light: PanelLight, row_time_s: float) -> None:
    frame_hz = 1e6 / light.frame_interval_us
    if frame_hz * row_time_s < MIN_ALIAS_DEVIATIONS * bands.cycles_per_row_sigma:
        raise CalibrationError(
            f"the panel shows too little of its bands ({bands.periods:.1f} periods) to tell {bands.frequency_hz:.1f} "
            f"from {bands.frequency_hz + frame_hz:.1f} Hz: go nearer, or take more frames"
        )


def _check_row_time(bands: ClassBands, row_time_s: float) -> None:
    off = bands.cycles_per_row / (bands.frequency_hz * row_time_s) - 1
    sigma = bands.cycles_per_row_sigma / bands.cycles_per_row
    if abs(off) > max(ROW_TIME_DOUBT[0] * sigma, ROW_TIME_DOUBT[1]):
        raise CalibrationError(
            f"the bands do not fit a row time of {row_time_s * 1e6:.2f} µs: measure that first, with a panel whose "
            "frequencies are known and `ledpi calibrate shutter`"
        )


def _duty(measured: Sequence[ClassBands], exposure_us: float) -> tuple[float | None, float]:
    """From the second harmonic over the first, which is cos πd · cos πfT (as sinc 2x = sinc x · cos πx)."""
    values, weights = [], []
    for bands in measured:
        cycles = bands.frequency_hz * exposure_us * 1e-6
        seen = math.cos(math.pi * cycles) * math.copysign(1.0, float(np.sinc(cycles)))
        values.append(math.acos(min(1.0, max(-1.0, bands.second / seen))) / math.pi)
        sigma = bands.second_sigma / (abs(seen) * math.pi * max(math.sin(math.pi * values[-1]), 0.1))
        weights.append(sigma**-2)
    sigma = sum(weights) ** -0.5
    duty = sum(w * v for w, v in zip(weights, values, strict=True)) / sum(weights)
    return (duty if sigma <= MAX_DUTY_SIGMA else None), sigma


def _blinking_share(bands: ClassBands, exposure_us: float, duty: float) -> float:
    return bands.amplitude / shutter.harmonic_amplitude(1, bands.frequency_hz, exposure_us, duty)
