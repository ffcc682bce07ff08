"""The frequency of one lamp from one photograph: asked back of pictures whose light was counted, and of real ones."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from evaluation.accuracy import led_bands as bench
from ledpi.core.records import Frame
from ledpi.workshop.calibrate.lamp import lamp_frequency, lamp_rows
from ledpi.workshop.calibrate.shutter import Estimate
from tests.builders.command import Run
from tests.builders.lamp import photographed_lamp


def measured(picture: np.ndarray) -> Estimate | None:
    frame = Frame(pixels=picture, seq=0, row0_readout_ns=0, exposure_us=161.6, row_time_us=33.67, transfer="srgb")
    return lamp_frequency(lamp_rows(frame), exposure_us=161.6, row_time_us=33.67)


@pytest.mark.parametrize("hz", [700.0, 1262.0, 2431.0, 5000.0])
@pytest.mark.parametrize("depth", [1.0, 0.3])
def test_the_frequency_is_asked_back(hz: float, depth: float) -> None:
    """To 0.3 %, nothing known beforehand, also where most of the light is steady."""
    found = measured(photographed_lamp(hz, depth))
    assert found is not None
    assert found.value == pytest.approx(hz, rel=3e-3)
    assert abs(found.value - hz) < 5 * found.sigma + 1e-3 * hz


@pytest.mark.slow
def test_what_shows_no_bands_has_no_frequency() -> None:
    """A steady lamp, bands of which hardly two are on the lamp, noise, and darkness."""
    noise = np.random.default_rng(0).integers(0, 40, (373, 662)).astype(np.uint8)
    for picture in (photographed_lamp(1000.0, 0.0), photographed_lamp(400.0, 1.0), noise, np.zeros_like(noise)):
        assert measured(picture) is None


@pytest.mark.slow
def test_real_lamps(shared: Callable[[str], Path]) -> None:
    """Takes every twentieth photograph: off by 0.1 % in the median, 0.5 % at worst."""
    errors, _ = bench.frequency_errors(shared("real/led_bands"), every=20)
    off = np.abs(np.concatenate(list(errors.values())))
    assert len(off) >= 4
    assert np.median(off) < 1e-3
    assert off.max() < 5e-3


def test_the_command_names_picture_and_frequency(ledpi: Run) -> None:
    """One line a picture; where none shows a lamp with bands, that is an error."""
    cv2.imwrite("lamp.png", photographed_lamp(1262.0, 1.0))
    cv2.imwrite("dark.png", np.zeros((373, 662), np.uint8))
    shutter = ("--set", "camera.row_time_us=33.67", "--set", "camera.exposure_us=161.6")
    status, output, _ = ledpi("calibrate", "panel", "lamp.png", "dark.png", *shutter)
    assert status == 0
    lamp, dark = output.splitlines()
    assert lamp.startswith("lamp.png  126")
    assert dark == "dark.png  no lamp with bands"
    status, _, errors = ledpi("calibrate", "panel", "dark.png", *shutter)
    assert (status, "no lamp with bands in any picture" in errors) == (2, True)
