"""Frequencies, row time, exposure and duty are asked back of light that was counted moment by moment."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ledpi.camera.recording.picture import read_picture
from ledpi.camera.recording.reader import load_recording
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.errors import CalibrationError
from ledpi.core.records import Frame, PanelSpec
from ledpi.workshop.calibrate.bands import PanelLight
from ledpi.workshop.calibrate.panel import PanelCalibration, advice, measure_panel
from ledpi.workshop.calibrate.shutter import Reported, ShutterCalibration, measure_shutter
from ledpi.workshop.calibrate.still_panels import panel_light, steady_seconds

DICTIONARY = load_dictionary("DICT_4X4_50")
ANNOUNCED = PanelSpec(side_m=0.16, black_hz=1250.0, white_hz=2450.0)
WORD_7 = np.array([[1, 1, 0, 0], [0, 1, 0, 0], [1, 1, 1, 1], [0, 0, 1, 0]], bool)
FRAME_ROWS = 504  # over which both classes' bands move; at 31.75 µs a row those of 1250 Hz do not, but do over 509


@cache
def counted_light(
    black_hz: float = 1250.0,
    white_hz: float = 2450.0,
    *,
    duty: float = 0.5,
    exposure_us: float = 9967.0,
    row_time_us: float = 33.67,
    frames: int = 40,
    frame_rows: int = FRAME_ROWS,
    cell_rows: int = 24,
    noise: float = 3e-3,
    blinking: float = 1.0,
    jitter_us: float = 0.0,
    drift: float = 0.0,
    seed: int = 0,
    white_phase: float = 0.63,
) -> PanelLight:
    """ID 7 upright, its cells 24 rows high and 24 pixels wide; each row's share of light is counted at 2,000 moments.

    `noise` is that of one row of a cell, over its light; `jitter_us` that of the times which frames are told to have.
    `drift` is by what share the frequencies rise in a second.
    """
    rng = np.random.default_rng(seed)
    rows = 4 * cell_rows
    moments_us = exposure_us * (np.arange(2000) + 0.5) / 2000
    start_us = frame_rows * row_time_us * np.arange(frames)
    at_us = start_us[:, None] + row_time_us * np.arange(rows)
    light = np.zeros((frames, 16, rows))
    waves = (black_hz * 1e-6, 0.1), (white_hz * 1e-6, white_phase)

    def share_on(f: float, phase: float, t_us: np.ndarray) -> np.ndarray:
        moments = t_us[:, None] + moments_us
        return np.asarray(((phase + f * moments * (1 + drift * moments * 0.5e-6)) % 1.0 < duty).mean(axis=1))

    on = [np.stack([share_on(f, p, t) for t in at_us]) for f, p in waves]
    profile = 24 * 0.4 * (1 + 0.2 * np.cos(np.linspace(-1, 1, cell_rows - 2)))
    for cell, white in enumerate(WORD_7.ravel()):
        own = slice(cell // 4 * cell_rows + 1, (cell // 4 + 1) * cell_rows - 1)
        seen = 1 - blinking + blinking * on[int(white)][:, own] / duty
        light[:, cell, own] = (1 + 0.05 * (cell % 3)) * profile * seen * (1 + noise * rng.standard_normal(seen.shape))
    seconds = (start_us + jitter_us * rng.standard_normal(frames)) * 1e-6
    return PanelLight(light=light, seconds=seconds, frame_interval_us=frame_rows * row_time_us)


ONE = replace(ANNOUNCED, black_hz=1254.0, white_hz=1254.0, phase="antiphase")


def measured_panel(light: PanelLight, spec: PanelSpec = ANNOUNCED, exposure_us: float = 9967.0) -> PanelCalibration:
    return measure_panel(light, DICTIONARY, spec, exposure_us=exposure_us, row_time_us=33.67)


def measured_shutter(
    light: PanelLight, spec: PanelSpec = ANNOUNCED, *, exposure_rows: int = 296, rows: int | None = None
) -> ShutterCalibration:
    reported = Reported(row_time_us=33.67, exposure_us=exposure_rows * 33.67, frame_length_rows=rows)
    return measure_shutter(light, DICTIONARY, spec, reported)


def test_frequencies_that_are_off_are_found() -> None:
    """1262 and 2431 Hz, announced as 1250 and 2450, to 0.01 %; ID 7 is not told beforehand."""
    result = measured_panel(counted_light(1262.0, 2431.0))
    assert result.id == 7
    assert result.black.frequency_hz == pytest.approx(1262.0, rel=1e-4)
    assert result.white.frequency_hz == pytest.approx(2431.0, rel=1e-4)
    assert result.differs_from(ANNOUNCED)
    assert not result.differs_from(PanelSpec(side_m=1.0, black_hz=1262.0, white_hz=2431.0))


@pytest.mark.slow
def test_deviations_are_those_of_the_errors() -> None:
    """Over 20 draws the errors of f and ν, over their reported deviations, have a root mean square near 1."""
    clean, rng, pulls = counted_light(frames=25, noise=0.0), np.random.default_rng(0), []
    for _ in range(20):
        noisy = clean.light * (1 + 0.01 * rng.standard_normal(clean.light.shape))
        result = measured_panel(replace(clean, light=noisy))
        for bands, hz in ((result.black, 1250.0), (result.white, 2450.0)):
            pulls.append((bands.frequency_hz - hz) / bands.frequency_sigma_hz)
            pulls.append((bands.cycles_per_row - hz * 33.67e-6) / bands.cycles_per_row_sigma)
    assert 0.75 < np.sqrt(np.mean(np.square(pulls))) < 1.25


def test_late_interrupts_cost_little() -> None:
    """Frames that are dated wrong by 30 µs: frequencies still to 0.01 %, as the frames' period is constant."""
    jittered = counted_light(1262.0, 2431.0, jitter_us=30.0)
    frames = [
        Frame(
            pixels=np.zeros((2, 2), np.uint8),
            seq=10 + i,
            row0_readout_ns=round(t * 1e9) + 10**9,
            exposure_us=9967.0,
            row_time_us=33.67,
            transfer="linear",
        )
        for i, t in enumerate(jittered.seconds)
    ]
    seconds, interval_us = steady_seconds(frames)
    result = measured_panel(PanelLight(light=jittered.light, seconds=seconds, frame_interval_us=interval_us))
    assert result.black.frequency_hz == pytest.approx(1262.0, rel=1e-4)
    assert interval_us == pytest.approx(FRAME_ROWS * 33.67, rel=1e-4)


@pytest.mark.slow
def test_an_oscillator_that_wanders_is_measured_in_parts() -> None:
    """One that rises by 0.2 % a second never adds up over all frames; its mean is found, and how far it wanders."""
    result = measured_panel(counted_light(1262.0, 2431.0, frames=60, drift=2e-3))
    middle_s = 60 * FRAME_ROWS * 33.67e-6 / 2
    for bands, hz in ((result.black, 1262.0), (result.white, 2431.0)):
        assert bands.frequency_hz == pytest.approx(hz * (1 + 2e-3 * middle_s), rel=2e-4)
        assert bands.wander_hz == pytest.approx(hz * 2e-3 * middle_s / np.sqrt(2), rel=0.1)
    assert result.blinking_share == pytest.approx((1.0, 1.0), abs=0.06)


@pytest.mark.slow
@pytest.mark.parametrize("duty", [0.3, 0.6])
def test_duty_shows_in_the_second_harmonic(duty: float) -> None:
    """Which side of one half it lies on too, and the share of light that blinks."""
    result = measured_panel(counted_light(duty=duty, blinking=0.8))
    assert result.duty == pytest.approx(duty, abs=0.02)
    assert result.blinking_share == pytest.approx((0.8, 0.8), abs=0.02)


@pytest.mark.slow
def test_duty_is_not_guessed_where_the_exposure_hides_it() -> None:
    """Finds no second harmonic where exposure times frequency is a whole number and a half, at any duty."""
    result = measured_panel(counted_light(1250.0, 2450.0, duty=0.4, exposure_us=10000.0), exposure_us=10000.0)
    assert result.duty is None
    assert "duty" not in result.overrides(PanelSpec(side_m=0.16, black_hz=1250.0, white_hz=2450.0))


@pytest.mark.slow
@pytest.mark.parametrize(
    "light",
    [
        {"blinking": 0.0},
        {"black_hz": 1300.0, "white_hz": 2500.0, "exposure_us": 10000.0},  # nulls of the exposure
        {"black_hz": 1e6 / 33.67 / 504 * 21},  # black's bands stand still from frame to frame
    ],
    ids=["steady", "nulls", "frozen"],
)
def test_no_bands_are_no_result(light: dict[str, float]) -> None:
    """A steady lamp, bands that the exposure blots out, bands that never move: refused, nothing made up."""
    with pytest.raises(CalibrationError, match="no bands of a DICT_4X4_50 panel between 1062 and 1438 Hz"):
        measured_panel(counted_light(**light))


@pytest.mark.parametrize(
    ("light", "says"),
    [
        ({"row_time_us": 31.75, "frame_rows": 509}, r"do not fit a row time of 33\.67 µs"),
        ({"cell_rows": 6, "noise": 0.01}, "too little of its bands"),
    ],
)
def test_what_leaves_an_alias_open_is_reported(light: dict[str, Any], says: str) -> None:
    """A row time that is off by 6 % would give another one; a small panel shows too few rows to tell them apart."""
    with pytest.raises(CalibrationError, match=says):
        measured_panel(counted_light(**light))


@pytest.mark.slow
@pytest.mark.parametrize("row_time_us", [21.17, 31.75, 33.67])
def test_the_row_time_is_found_whatever_the_driver_says(row_time_us: float) -> None:
    """To 0.1 % by the bands alone, and to the last digit with the frames' rows; the driver said 33.67 µs.

    At 31.75 µs black's bands stand still from frame to frame: white's are enough.
    """
    light = counted_light(row_time_us=row_time_us, exposure_us=9967.0)
    by_bands, with_rows = measured_shutter(light), measured_shutter(light, rows=FRAME_ROWS)
    assert by_bands.row_time_us.value == pytest.approx(row_time_us, rel=1e-3)
    assert with_rows.row_time_us.value == pytest.approx(row_time_us, rel=1e-9)
    assert by_bands.row_time_us.agrees_with(33.67) == (row_time_us == 33.67)
    scaled = measured_shutter(light, rows=FRAME_ROWS * 2)  # the frames' interval over these is not what bands show
    assert scaled.by_interval_us is None
    assert scaled.row_time_us.value == pytest.approx(row_time_us, rel=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("exposure_us", [9394.0, 10000.0])
def test_the_exposure_shows_in_the_classes_depths(exposure_us: float) -> None:
    """Within its deviations of the truth, also at 10 ms, where the ratio of depths turns."""
    result = measured_shutter(counted_light(exposure_us=exposure_us), exposure_rows=round(exposure_us / 33.67))
    assert result.exposure_us is not None
    assert abs(result.exposure_us.value - exposure_us) < 4 * result.exposure_us.sigma + 1
    assert result.exposure_us.sigma < 50


def test_a_panel_that_is_no_crystal_is_refused() -> None:
    """A row time is not measured with a panel that is 1 % off."""
    with pytest.raises(CalibrationError, match="right to 300 ppm"):
        measured_shutter(counted_light(1262.0, 2431.0))


def test_the_one_frequency_of_an_antiphase_panel() -> None:
    """0.8 % off what is announced: both classes have it, and no duty is written, which is a half."""
    found = measured_panel(counted_light(1264.0, 1264.0, white_phase=0.6), ONE)
    assert found.id == 7
    assert found.black.frequency_hz == found.white.frequency_hz == pytest.approx(1264.0, rel=1e-5)
    values = found.overrides(ONE)
    assert values == {"black_hz": pytest.approx(1264.0, abs=0.02), "white_hz": values["black_hz"]}
    assert found.differs_from(ONE)


def test_two_oscillators_are_no_antiphase_panel() -> None:
    """Near enough for one frame; but their frequencies are not the same."""
    with pytest.raises(CalibrationError, match=r"1254\.00 and 1255\.50 Hz are not in antiphase|no bands of"):
        measured_panel(counted_light(1254.0, 1255.5), ONE)


def test_a_crystal_in_antiphase_measures_the_row_time() -> None:
    """But not the exposure: that takes the depths of two frequencies."""
    light = counted_light(1254.0, 1254.0, white_phase=0.6, row_time_us=32.9, exposure_us=9960.0)
    found = measured_shutter(light, ONE)
    assert (found.id, found.exposure_us) == (7, None)
    assert found.row_time_us.value == pytest.approx(32.9, rel=2e-3)


def test_advice_names_what_would_be_better() -> None:
    """A null of the exposure and standing bands are named with values that have neither; a good setting has no line."""
    bad = advice([1300.0, 2500.0], exposure_us=10000.0, row_time_us=33.67, frame_interval_us=20_000.0)
    assert [line[:27] for line in bad] == [
        "1300.0 Hz is near a null: a",
        "2500.0 Hz is near a null: a",
        "camera.exposure_us: 10203 w",
        "the bands of 1300.0 Hz move",
        "the bands of 2500.0 Hz move",
        "camera.frame_duration_us: 2",
    ]
    assert bad[1].endswith("holds 25.00 periods, and leaves 0% of the depth that 25.5 would")
    exposure_us, interval_us = (float(bad[i].split("_us: ")[1].split()[0]) for i in (2, 5))
    again = advice([1300.0, 2500.0], exposure_us=exposure_us, row_time_us=33.67, frame_interval_us=interval_us)
    assert again == []
    assert advice([1250.0, 2450.0], exposure_us=9967.0, row_time_us=33.67, frame_interval_us=504 * 33.67) == []


@pytest.mark.parametrize("name", ["static/d2", "oblique/d0.6_yaw-70"])
def test_frames_that_others_rendered(shared: Callable[[str], Path], name: str) -> None:
    """Five or six frames of another simulator: 1250 and 2450 Hz to 0.02 %, 33.67 µs to 0.5 %, 10 ms to 1 %."""
    folder = shared(f"recordings/{name}")
    recording = load_recording(folder)
    truth = json.loads((folder / "truth.jsonl").read_text().splitlines()[0])["markers"][0]
    assert recording.truth is not None
    frames = []
    for entry in recording.frames:
        if entry.row0_readout_ns - recording.frames[0].row0_readout_ns < 200_000_000:
            pixels = np.empty((480, 640), np.uint8)
            assert read_picture(entry.picture, pixels) is None
            frames.append(recording.frame(entry, pixels))
    light = panel_light(frames, np.array(truth["corners_px"]), 4, recording.camera.intrinsics)
    panel = measured_panel(light, exposure_us=10000.0)
    shutter = measured_shutter(light)
    assert panel.id == shutter.id == truth["id"]
    assert panel.black.frequency_hz == pytest.approx(1250.0, rel=2e-4)
    assert panel.white.frequency_hz == pytest.approx(2450.0, rel=2e-4)
    assert shutter.row_time_us.value == pytest.approx(33.67, rel=5e-3)
    assert shutter.exposure_us is not None
    assert shutter.exposure_us.value == pytest.approx(10000.0, rel=1e-2)
