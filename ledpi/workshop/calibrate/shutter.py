"""A camera's row time and real exposure, from a panel whose frequencies are known, as a crystal's are. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ledpi.core.codewords import Dictionary
from ledpi.core.errors import CalibrationError
from ledpi.core.records import PanelSpec
from ledpi.workshop.calibrate.bands import (
    CLOCK_SIGMA,
    STEPS_PER_CYCLE,
    ClassBands,
    PanelLight,
    Waves,
    measure_codeword,
    moved_share,
    search_step_hz,
)

ROW_TIMES_US = (8.0, 80.0)  # of any camera that this is for: 480 rows in 4 to 38 ms
CRYSTAL = 300e-6  # by how much a crystal and the camera's clock may disagree, as a share
AGREEMENT = (4.0, 0.003)  # deviations, and share: two values that are apart by less than the larger agree
STANDING = 0.3  # share of a class's power that moves from frame to frame, below which it need not be seen
EXPOSURE_SEARCH = 0.15  # of the reported exposure, to either side
EXPOSURE_STEPS = 200_001  # finer than the deviation of any
EXPOSURE_FITS = 3.0  # deviations that the classes' depths may be off; where their ratio turns, none may fit exactly


@dataclass(frozen=True, slots=True, kw_only=True)
class Reported:
    """The driver's words on the shutter."""

    row_time_us: float | None  # None where it cannot tell
    exposure_us: float
    frame_length_rows: int | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """A value and its standard deviation."""

    value: float
    sigma: float

    def agrees_with(self, other: float) -> bool:
        """Tells whether another value of the same thing is within the doubt, or too near to matter."""
        return abs(self.value - other) <= max(AGREEMENT[0] * self.sigma, AGREEMENT[1] * self.value)


@dataclass(frozen=True, slots=True, kw_only=True)
class ShutterCalibration:
    """Measurements of the shutter."""

    id: int  # of the panel
    row_time_us: Estimate  # the better of the next two
    by_bands_us: Estimate
    by_interval_us: Estimate | None  # None where the frames' rows are not known, or the bands do not bear it out
    exposure_us: Estimate | None  # None where bands of one frequency only are seen, or no exposure near leaves such


def measure_shutter(
    light: PanelLight, dictionary: Dictionary, crystal: PanelSpec, reported: Reported
) -> ShutterCalibration:
    """Row time and exposure. Raises CalibrationError where no panel with the crystal's frequencies is seen.

    Bands fix ν = f·t_row in cycles a row, so t_row = ν/f. The frames' interval over their number of rows says the same
    far more sharply, and is taken where the bands bear it out: a scaled picture has other rows than the sensor.
    """
    codewords = dictionary.rotated_codewords().reshape(4 * len(dictionary.codewords), -1)
    found = measure_codeword(light, codewords, [_waves(light, hz) for hz in crystal.waves_hz])
    classes = ((found.black, crystal.black_hz), (found.white, crystal.white_hz))
    sure = [bands for bands, hz in classes if bands.certain and _is_crystal(bands, hz)]
    # Bands that stand still from frame to frame are uncertain; those of the other class are enough for the row time.
    still = [hz for _, hz in classes if moved_share(light.seconds, np.array([hz]))[0] < STANDING]
    if not sure or len(sure) + len(still) < len(classes):
        announced = " and ".join(f"{hz:g}" for hz in crystal.waves_hz)
        raise CalibrationError(
            f"no panel of {dictionary.name} that blinks at {announced} Hz is seen; must be right to "
            f"{CRYSTAL * 1e6:.0f} ppm, as a crystal's is"
        )
    by_bands = _mean([_row_time_us(bands) for bands in sure])
    by_interval = _row_time_from_intervals(light, reported.frame_length_rows)
    if by_interval is not None and not by_bands.agrees_with(by_interval.value):
        by_interval = None
    row_time = by_interval or by_bands
    two_depths = len(sure) == 2 and crystal.phase == "free"
    return ShutterCalibration(
        id=found.codeword // 4,
        row_time_us=row_time,
        by_bands_us=by_bands,
        by_interval_us=by_interval,
        exposure_us=_exposure_us(found.black, found.white, reported, row_time.value) if two_depths else None,
    )


def _waves(light: PanelLight, frequency_hz: float) -> Waves:
    """The known frequency, within what a crystal leaves open, at any row time."""
    step = search_step_hz(light)
    reach = math.ceil(CRYSTAL * frequency_hz / step)
    frequencies = frequency_hz + step * np.arange(-reach, reach + 1)
    low, high = (frequency_hz * us * 1e-6 for us in ROW_TIMES_US)
    spatial = np.arange(low, min(high, 0.5), 1.0 / (STEPS_PER_CYCLE * light.light.shape[2]))
    both = np.meshgrid(frequencies, spatial)
    return Waves(frequency_hz=both[0].ravel(), cycles_per_row=both[1].ravel())


def _is_crystal(bands: ClassBands, frequency_hz: float) -> bool:
    steady = bands.wander_hz <= CRYSTAL * frequency_hz
    return steady and abs(bands.frequency_hz - frequency_hz) <= (
        CRYSTAL * frequency_hz + AGREEMENT[0] * bands.frequency_sigma_hz
    )


def _row_time_us(bands: ClassBands) -> Estimate:
    scale = 1e6 / bands.frequency_hz
    return Estimate(value=bands.cycles_per_row * scale, sigma=bands.cycles_per_row_sigma * scale)


def _mean(estimates: Sequence[Estimate]) -> Estimate:
    weights = [e.sigma**-2 for e in estimates]
    mean = sum(w * e.value for w, e in zip(weights, estimates, strict=True)) / sum(weights)
    return Estimate(value=mean, sigma=sum(weights) ** -0.5)


def _row_time_from_intervals(light: PanelLight, frame_length_rows: int | None) -> Estimate | None:
    if frame_length_rows is None:
        return None
    row_time_us = light.frame_interval_us / frame_length_rows
    return Estimate(value=row_time_us, sigma=CLOCK_SIGMA * row_time_us)


def _exposure_us(black: ClassBands, white: ClassBands, reported: Reported, row_time_us: float) -> Estimate | None:
    """The exposure that leaves both classes' depths in the ratio that is seen; None where none within 15 % does.

    A class's amplitude is 2·sinc(d)·|sinc(f·T)| times the share of light that blinks; the ratio of two classes of one
    panel depends on T alone. Several spans of T fit it: it is the one nearest to what the driver says, or to as many
    rows of the true length as the driver believes to expose for.
    """
    seen = math.log(white.amplitude / black.amplitude)
    sigma = math.hypot(white.amplitude_sigma / white.amplitude, black.amplitude_sigma / black.amplitude)
    times = reported.exposure_us * np.linspace(1 - EXPOSURE_SEARCH, 1 + EXPOSURE_SEARCH, EXPOSURE_STEPS)
    with np.errstate(divide="ignore"):
        ratio = np.log(np.abs(np.sinc(white.frequency_hz * times * 1e-6) / np.sinc(black.frequency_hz * times * 1e-6)))
    off = np.abs(ratio - seen) / sigma
    fits = np.nonzero(off <= EXPOSURE_FITS)[0]
    if not len(fits):
        return None
    expected = [reported.exposure_us]
    if reported.row_time_us is not None:
        expected.append(round(reported.exposure_us / reported.row_time_us) * row_time_us)
    away = np.min([np.abs(times[fits] - t) for t in expected], axis=0)
    nearest = int(away.argmin())
    spans = np.cumsum(np.diff(fits, prepend=fits[0]) > 1)
    span = fits[spans == spans[nearest]]
    step = float(times[1] - times[0])
    return Estimate(value=float(times[span[off[span].argmin()]]), sigma=len(span) * step / (2 * EXPOSURE_FITS))
