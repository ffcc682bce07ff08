"""libcamera's own tuning files, as its source package has them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from ledpi.camera.tuning import linear_tuning, white_gains
from tests.builders.virtual_picamera2 import TUNING

FILES = sorted(TUNING.glob("*/*.json"))


def algorithms(tuning: dict[str, Any]) -> dict[str, Any]:
    return {name: values for algorithm in tuning["algorithms"] for name, values in algorithm.items()}


def test_both_isps_and_both_sensors_are_here() -> None:
    """The forms for the Pi up to 4 and for the Pi 5."""
    names = [f"{path.parent.name}/{path.stem}" for path in FILES]
    assert names == ["pisp/imx219", "pisp/ov5647", "vc4/imx219", "vc4/ov5647"]


@pytest.mark.parametrize("path", FILES, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_the_file_becomes_linear(path: Path) -> None:
    """It had a curve and adapted it; now it has neither, and nothing else is changed but the colour matrix."""
    tuning = json.loads(path.read_text())
    before, after = algorithms(tuning), algorithms(linear_tuning(tuning))
    assert before["rpi.contrast"]["ce_enable"] == 1
    assert len(before["rpi.contrast"]["gamma_curve"]) > 4
    assert (after["rpi.contrast"]["ce_enable"], after["rpi.contrast"]["gamma_curve"]) == (0, [0, 0, 65535, 65535])
    changed = {name for name in before if before[name] != after[name]}
    assert changed == {"rpi.contrast", "rpi.ccm"}
    assert list(after) == list(before)


@pytest.mark.parametrize("path", FILES, ids=lambda path: f"{path.parent.name}-{path.stem}")
def test_a_white_led_s_channels_are_balanced(path: Path) -> None:
    """Green is a sensor's most sensitive channel: red and blue are raised, by up to twice."""
    assert all(1.0 < gain < 2.2 for gain in white_gains(json.loads(path.read_text())))
