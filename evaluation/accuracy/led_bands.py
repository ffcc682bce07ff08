"""The shutter equations against real photographs of a blinking LED lamp, by frequency.

For each photograph of a square-wave lamp, the light of its rows is compared with what ledpi.core.shutter predicts:

    light(y) ≈ (a + b·y + c·y²) · w(y; φ),    w averaged over the two rows that the shrinking mixed

with the lamp's frequency, the exposure (161.6 µs) and the row time (33.67 µs) as given, and only the phase φ and the
lamp's level and slowly varying profile (a, b, c) fitted. The figure is the correlation of both sides over its rows.
Beside it stands that of the same fit at a frequency that is wrong by 10 %.

The camera's tone curve is not known. It is taken to be sRGB, with nothing fitted; and, as a second answer, measured on
the 500 Hz photographs alone, and held for all others. The last column is a doubt: with sRGB, edges are about as steep
as an exposure of 80 µs would make them. A steeper tone curve explains that as well as a shorter exposure does.

A second table says how well `ledpi calibrate panel PICTURE…` tells the frequency of such a lamp, knowing nothing of it
but exposure and row time: of photographs that show 2.5 periods or more, by how much it is off.

    python -m evaluation.accuracy.led_bands [../shared/real/led_bands]
"""

from __future__ import annotations

import argparse
import csv
import sys
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from evaluation import ROOT
from ledpi.core.records import Frame
from ledpi.core.shutter import linear_light, row_weights
from ledpi.workshop.calibrate.lamp import lamp_frequency, lamp_rows, middle_of_lamp

Floats = NDArray[np.float64]
Tone = Callable[[Floats], Floats]  # picture values 0..255 → linear light

EXPOSURE_US = 161.6
ROW_TIME_US = 33.67
MIXED_ROWS = 2.0  # that the shrinking averaged into one
SATURATED = 250
MIN_PERIODS = 1.5  # of the bands on the lamp, for a photograph to say something about them
PHASES = np.arange(0.0, 1.0, 1 / 100)


@dataclass(frozen=True)
class Photograph:
    name: str
    frequency_hz: float
    values: Floats  # (rows, columns) of the lamp's middle columns


def part_with_bands(picture: NDArray[np.uint8], period_rows: float) -> NDArray[np.uint8] | None:
    """The lamp's middle; None where no lamp is in view, or one that shows too few periods."""
    part = middle_of_lamp(picture, period_rows)
    return part if part is not None and part.shape[0] >= MIN_PERIODS * period_rows and part.shape[1] >= 5 else None


def squares(folder: Path, every: int = 1) -> Iterator[tuple[str, float, NDArray[np.uint8]]]:
    """Name, frequency (Hz) and picture of each photograph of a square wave at this exposure."""
    if not (folder / "index.csv").is_file():
        sys.exit(f"{folder}: holds no photographs with an index.csv; they are not part of the project")
    with (folder / "index.csv").open(newline="") as file:
        for number, entry in enumerate(csv.DictReader(file)):
            if entry["code"] == "square" and float(entry["exposure_us"]) == EXPOSURE_US and number % every == 0:
                picture = cv2.imread(str(folder / entry["png"]), cv2.IMREAD_GRAYSCALE)
                yield entry["png"], float(entry["freq_hz"]), np.asarray(picture, np.uint8)


def photographs(folder: Path) -> tuple[list[Photograph], list[str]]:
    """The square-wave lamps that can be measured, and the names of the others.

    Left out are pictures that show the room that the lamp lights, not the lamp (NLOS in the name), and lamps so far
    away that they show too few periods.
    """
    found, others = [], []
    for name, frequency_hz, picture in squares(folder):
        part = part_with_bands(picture, 1e6 / frequency_hz / ROW_TIME_US)
        if part is None or "NLOS" in name:
            others.append(name)
        else:
            found.append(Photograph(name, frequency_hz, part.astype(np.float64)))
    return found, others


def row_profile(photograph: Photograph, tone: Tone) -> Floats:
    """Mean linear light of each row; saturated pixels carry no bands and are left out, as are rows full of them."""
    saturated = photograph.values >= SATURATED
    light = np.where(saturated, np.nan, tone(photograph.values))
    light[saturated.mean(axis=1) > 0.5] = np.nan
    return np.asarray(np.ma.masked_invalid(light).mean(axis=1).filled(np.nan))


def predicted_weights(rows: int, frequency_hz: float, phase: float, exposure_us: float = EXPOSURE_US) -> Floats:
    """w of each row, averaged over the rows that were mixed."""
    within = MIXED_ROWS * ((np.arange(8) + 0.5) / 8 - 0.5)
    weights = row_weights(
        np.arange(rows) + within[:, None],
        frequency_hz=frequency_hz,
        phase_cycles=phase,
        duty=0.5,
        exposure_us=exposure_us,
        row_time_us=ROW_TIME_US,
    )
    return np.asarray(weights.mean(axis=0))


def fitted(profile: Floats, frequency_hz: float, exposure_us: float = EXPOSURE_US) -> tuple[float, Floats]:
    """The best correlation over the phases, and the prediction that has it."""
    rows = len(profile)
    y = np.linspace(-1.0, 1.0, rows)
    known = np.isfinite(profile)
    best, best_prediction = -1.0, np.zeros(rows)
    for phase in PHASES:
        weights = predicted_weights(rows, frequency_hz, float(phase), exposure_us)
        terms = weights[:, None] * np.stack([np.ones(rows), y, y * y], axis=1)
        parts = np.linalg.lstsq(terms[known], profile[known], rcond=None)[0]
        prediction = terms @ parts
        correlation = float(np.corrcoef(prediction[known], profile[known])[0, 1])
        if correlation > best:
            best, best_prediction = correlation, prediction
    return best, best_prediction


def srgb_tone(values: Floats) -> Floats:
    """IEC 61966-2-1."""
    return linear_light("srgb", mark_saturated=False)[values.astype(np.uint8)].astype(np.float64)


KNOTS = np.linspace(0.0, 204.0, 18)


def measured_tone(training: Iterable[Photograph], rounds: int = 6) -> Tone:
    """The tone curve under which the predictions fit best: rising, piecewise linear, from sRGB in a few rounds."""
    training = list(training)
    curve = srgb_tone(KNOTS)
    second_difference = np.diff(np.eye(len(KNOTS)), 2, axis=0)
    for _ in range(rounds):
        values, light = [], []
        for photograph in training:
            rows = photograph.values.mean(axis=1)
            values.append(rows)
            light.append(fitted(np.interp(rows, KNOTS, curve), photograph.frequency_hz)[1])
        hats = np.maximum(0.0, 1.0 - np.abs(np.concatenate(values)[:, None] - KNOTS) / (KNOTS[1] - KNOTS[0]))
        wanted = np.concatenate([*light, np.zeros(len(second_difference))])
        curve = np.maximum.accumulate(np.linalg.lstsq(np.vstack([hats, second_difference]), wanted, rcond=None)[0])
        curve = curve / np.interp(160.0, KNOTS, curve)
    return lambda v: np.interp(v, KNOTS, curve)


def correlations(
    found: Iterable[Photograph], tone: Tone, *, scale: float = 1.0, exposure_us: float = EXPOSURE_US
) -> dict[float, list[float]]:
    """By frequency, each photograph's correlation; predicted for a scaled frequency or another exposure, if asked."""
    by_frequency: dict[float, list[float]] = {}
    for photograph in found:
        value, _ = fitted(row_profile(photograph, tone), photograph.frequency_hz * scale, exposure_us)
        by_frequency.setdefault(photograph.frequency_hz, []).append(value)
    return dict(sorted(by_frequency.items()))


def frequency_errors(folder: Path, every: int = 1) -> tuple[dict[float, list[float]], int]:
    """By frequency, how far off the measured one is, as a share; and how many photographs gave none.

    Of all photographs of square waves at this exposure, those of the room that the lamp lights included.
    """
    errors: dict[float, list[float]] = {}
    none = 0
    for _, frequency_hz, picture in squares(folder, every):
        found = lamp_frequency(lamp_rows(frame_of(picture)), exposure_us=EXPOSURE_US, row_time_us=ROW_TIME_US)
        if found is None:
            none += 1
        else:
            errors.setdefault(frequency_hz, []).append(found.value / frequency_hz - 1)
    return dict(sorted(errors.items())), none


def frame_of(picture: NDArray[np.uint8]) -> Frame:
    """The picture as that camera takes it."""
    return Frame(
        pixels=picture,
        seq=0,
        row0_readout_ns=10**9,
        exposure_us=EXPOSURE_US,
        row_time_us=ROW_TIME_US,
        transfer="srgb",
    )


def measure(folder: Path) -> None:
    found, others = photographs(folder)
    print(f"{len(found)} photographs; {len(others)} left out: no lamp in view, or under {MIN_PERIODS} periods of it")
    tone = measured_tone([p for p in found if p.frequency_hz == 500])
    held = [p for p in found if p.frequency_hz != 500]
    srgb, wrong = correlations(found, srgb_tone), correlations(found, srgb_tone, scale=1.1)
    measured = correlations(held, tone)
    exposures = (40.0, 60.0, 80.0, 100.0, 120.0, 140.0, EXPOSURE_US, 190.0)
    scan = {t: correlations(found, srgb_tone, exposure_us=t) for t in exposures}
    print("         number    sRGB tone      tone from 500 Hz   wrong frequency   exposure that")
    print("    Hz           median  worst     median  worst      (+10 %) median    fits best, µs")
    for frequency, values in srgb.items():
        other = measured.get(frequency)
        text = f"{np.median(other):.4f} {min(other):.4f}" if other else "   (fitted)  "
        best = max(exposures, key=lambda t: float(np.median(scan[t][frequency])))
        print(
            f"{frequency:6.0f} {len(values):7d}   {np.median(values):.4f} {min(values):.4f}    {text}"
            f"       {np.median(wrong[frequency]):.4f}           {best:.0f}"
        )
    errors, none = frequency_errors(folder)
    every = np.abs(np.concatenate(list(errors.values())))
    middle, worst = np.median(every), every.max()
    print(f"\nfrequency measured: {len(every)} photographs, off by {middle:.3%} (median), {worst:.2%} (worst)")
    print(f"no frequency from {none}: fewer than 2.5 periods, or no lamp in view")
    for frequency, off in errors.items():
        worst = max(map(abs, off))
        print(f"{frequency:6.0f} {len(off):7d}   median {np.median(off):+.3%}, worst {worst:.2%}")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", nargs="?", type=Path, default=ROOT.parent / "shared/real/led_bands")
    measure(parser.parse_args().folder)


if __name__ == "__main__":
    main()
