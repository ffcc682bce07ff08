"""A single lamp's frequency, from one photograph of it: a first look at an LED and its driver. Pure.

The light of the lamp's rows is fitted by

    light(y) ≈ (a + b·y + c·y²) + (d + e·y + g·y²) · (w(y; f, φ) − ½),    w: shutter.row_weights, duty ½

a slowly varying picture, part of which blinks. One photograph holds few periods, and nothing tells aliases apart but
the shape, so this is good to a tenth of a percent, where a series of a whole panel (`bands`) is good to the crystal.
"""

from __future__ import annotations

import cv2
import numpy as np

from ledpi.core.records import Floats, Frame, Pixels
from ledpi.core.shutter import linear_light, row_weights
from ledpi.workshop.calibrate.shutter import Estimate

MIN_HZ, MAX_HZ = 300.0, 8000.0
MIN_PERIODS = 2.5  # with fewer, a slope of the lamp's own picture passes for a part of a band
STEPS_PER_PERIOD = 20  # of the search: steps of the frequency shift the bands by a 20th of a period at most
PHASES = np.arange(0.0, 1.0, 1 / 16)  # to start from
ROUNDS = 12  # of Gauss-Newton
LIT = 0.3  # of the lamp's brightest
MIDDLE = 0.2  # of the lamp's columns: in there a round lamp is within 2 % of its full height
RIM = 0.03  # of its height, left out above and below
MIN_EXPLAINED = 0.9  # share of the rows' variation about a smooth picture


def lamp_rows(frame: Frame) -> Floats:
    """(rows,) mean linear light of the brightest lamp's middle columns, NaN where saturated; (0,) without a lamp.

    Its bands may be black: what is lit is closed over half of the longest period that is looked for.
    """
    part = middle_of_lamp(frame.pixels, 0.5e6 / MIN_HZ / frame.row_time_us)
    if part is None:
        return np.empty(0)
    light = linear_light(frame.transfer)[part].astype(np.float64)
    clear = np.isfinite(light)
    sums = np.where(clear, light, 0.0).sum(axis=1)
    return np.where(clear.mean(axis=1) > 0.5, sums / np.maximum(clear.sum(axis=1), 1), np.nan)


def middle_of_lamp(picture: Pixels, gap_rows: float) -> Pixels | None:
    """The middle columns of the largest bright thing, once dark bands of so many rows are closed; None without any."""
    bright = float(np.sort(picture.ravel())[-100:].mean())
    lit = (picture > LIT * bright).astype(np.uint8)
    kernel = np.ones((round(gap_rows) | 1, 3))
    count, _, boxes, _ = cv2.connectedComponentsWithStats(cv2.morphologyEx(lit, cv2.MORPH_CLOSE, kernel))
    if count < 2:
        return None
    x, y, width, height, _ = boxes[1 + int(np.argmax(boxes[1:, cv2.CC_STAT_AREA]))]
    rim, aside = 2 + round(RIM * height), 0.5 - MIDDLE / 2
    part = picture[y + rim : y + height - rim, round(x + aside * width) : round(x + (1 - aside) * width)]
    return part if part.size else None


def lamp_frequency(light: Floats, *, exposure_us: float, row_time_us: float) -> Estimate | None:
    """The frequency of (rows,) of light, in Hz; None where no bands of at least 2.5 periods explain them."""
    rows, shown = np.arange(len(light), dtype=np.float64), np.isfinite(light)
    rows, light = rows[shown], light[shown]
    if len(rows) < 8:
        return None
    seen_s = float(np.ptp(rows)) * row_time_us * 1e-6
    # Lower ones too, so that too few of their periods are not taken for enough of a higher one's.
    lowest = max(MIN_HZ, 0.75 / seen_s)
    grid = np.arange(lowest, min(MAX_HZ, 0.4e6 / row_time_us), 1.0 / (STEPS_PER_PERIOD * seen_s))
    left = [_sines_left(rows * hz * row_time_us * 1e-6, light) for hz in grid]
    start = float(grid[int(np.argmin(left))])
    fits = [_fitted(rows, light, start, phase, exposure_us, row_time_us) for phase in PHASES]
    frequency, sigma, squares = min(fits, key=lambda fit: fit[2])
    smooth = light - _smooth(rows) @ np.linalg.lstsq(_smooth(rows), light, rcond=None)[0]
    if squares > (1 - MIN_EXPLAINED) * float(smooth @ smooth):
        return None
    if not MIN_PERIODS <= frequency * seen_s < len(rows) / 2:
        return None
    return Estimate(value=frequency, sigma=sigma)


def _smooth(rows: Floats) -> Floats:
    y = 2 * (rows - rows[0]) / max(float(np.ptp(rows)), 1.0) - 1
    return np.stack([np.ones_like(y), y, y * y], axis=1)


def _sines_left(cycles: Floats, light: Floats) -> float:
    """Sum of squares that a sine of slowly varying depth leaves."""
    still, turn = _smooth(cycles), 2 * np.pi * cycles
    columns = np.hstack([still, still[:, :2] * np.cos(turn)[:, None], still[:, :2] * np.sin(turn)[:, None]])
    rest = light - columns @ np.linalg.lstsq(columns, light, rcond=None)[0]
    return float(rest @ rest)


def _fitted(
    rows: Floats, light: Floats, frequency_hz: float, phase: float, exposure_us: float, row_time_us: float
) -> tuple[float, float, float]:
    """Frequency, its deviation, and the sum of squares left: Gauss-Newton on frequency and phase at the middle row."""
    still, middle = _smooth(rows), float(rows.mean())

    def rest(wave: Floats) -> Floats:
        weights = row_weights(
            rows - middle,
            frequency_hz=float(wave[0]),
            phase_cycles=float(wave[1]),
            duty=0.5,
            exposure_us=exposure_us,
            row_time_us=row_time_us,
        )
        columns = np.hstack([still, still * (weights[:, None] - 0.5)])
        return np.asarray(light - columns @ np.linalg.lstsq(columns, light, rcond=None)[0], np.float64)

    wave, small = np.array([frequency_hz, phase]), np.array([1e-4 * frequency_hz, 1e-3])
    now = rest(wave)
    normal = np.eye(2)
    for _ in range(ROUNDS):
        slopes = np.stack([(rest(wave + d) - rest(wave - d)) / 2 for d in np.diag(small)])  # of a small step each
        normal = slopes @ slopes.T + 1e-12 * np.eye(2)
        step = -np.linalg.solve(normal, slopes @ now) * small
        after = rest(wave + step)
        if float(after @ after) >= float(now @ now):
            break
        wave, now = wave + step, after
    squares = float(now @ now)
    variance = squares / max(1, len(rows) - 8)
    sigma = float(np.sqrt(np.linalg.inv(normal)[0, 0] * variance)) * small[0]
    return float(wave[0]), float(sigma), squares
