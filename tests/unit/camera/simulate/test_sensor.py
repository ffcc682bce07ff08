"""From linear light to 8-bit values: noise, full scale, tone."""

from __future__ import annotations

import numpy as np
import pytest

from ledpi.camera.simulate.scene import SimulatedSensor
from ledpi.camera.simulate.sensor import SensorReadout
from ledpi.core.records import Floats, Pixels
from tests.builders.simulate import LENS

NOISELESS = {"full_well_e": 1e12, "read_noise_e": 0.0}


def read(level: Floats | float, seed: int = 0, **values: object) -> Pixels:
    sensor = SimulatedSensor(intrinsics=LENS, exposure_us=9967.0, **values)  # type: ignore[arg-type]
    light = np.broadcast_to(np.float32(level), (480, 640)).copy()
    pixels = np.empty((480, 640), np.uint8)
    SensorReadout(sensor).read(light, np.random.default_rng(seed), pixels)
    return pixels


@pytest.mark.parametrize(
    ("transfer", "contrast", "codes"),
    [
        # Code = 255 × light, to the nearest, clipped at full scale.
        ("linear", 0.0, {0.0: 0, 0.501: 128, 0.2: 51, 0.25: 64, 0.998: 254, 1.0: 255, 3.0: 255}),
        # IEC 61966-2-1: 18 % grey is 118, half light 188, and below 0.0031 the curve is a line of slope 12.92.
        ("srgb", 0.0, {0.0: 0, 0.002: 7, 0.05: 63, 0.18: 118, 0.5: 188, 0.9: 243, 1.0: 255, 9.0: 255}),
        # 3v² − 2v³ of the transfer's value v, or half-way there: a toe and a shoulder; black, middle and white stay.
        ("linear", 1.0, {0.25: 40, 0.501: 128, 0.75: 215}),
        ("linear", 0.5, {0.25: 52, 1.0: 255}),
    ],
)
def test_pixels_follow_their_curve(transfer: str, contrast: float, codes: dict[float, int]) -> None:
    """The code of each level of light, by hand."""
    seen = {level: read(level, transfer=transfer, tone_contrast=contrast, **NOISELESS) for level in codes}
    assert {level: set(pixels.ravel().tolist()) for level, pixels in seen.items()} == {
        level: {code} for level, code in codes.items()
    }


def test_sharpening_overshoots_at_an_edge_and_nowhere_else() -> None:
    """Beside a step of 64 codes a blur by one pixel takes 0.3005 of it, which is added."""
    light = np.full((480, 640), 0.25)
    light[:, 320:] = 0.501
    row = read(light, transfer="linear", sharpening=1.0, **NOISELESS)[240]
    assert (row[319], row[320]) == (45, 147)
    assert (row[300], row[340]) == (64, 128)


@pytest.mark.parametrize("gain", [1.0, 4.0])
@pytest.mark.parametrize("level", [0.02, 0.1, 0.5])
def test_noise_is_that_of_counted_electrons(level: float, gain: float) -> None:
    """Level × full well / gain electrons vary with the root of their number, and by the read noise."""
    pixels = read(level, transfer="linear", full_well_e=8000.0, read_noise_e=8.0, gain=gain)
    electrons = level * 8000.0 / gain
    variance = (electrons + 8.0**2) * (gain / 8000.0) ** 2
    quantisation = (1 / 255) ** 2 / 12
    assert (pixels / 255).mean() == pytest.approx(level, abs=2e-4)
    assert (pixels / 255).var() == pytest.approx(variance + quantisation, rel=0.03)


def test_noise_of_pixels_and_frames_is_independent() -> None:
    """Neither neighbours nor frames share any noise."""
    values = {"transfer": "linear", "full_well_e": 800.0}
    first, second = (read(0.5, seed=seed, **values).astype(float) - 127.5 for seed in (1, 2))
    for a, b in ((first, second), (first[:, 1:], first[:, :-1]), (first[1:], first[:-1])):
        assert abs(np.corrcoef(a.ravel(), b.ravel())[0, 1]) < 0.01  # 5 σ of 300,000 pixels


def test_impossible_sensors_are_refused() -> None:
    """Takes what cannot be built for no sensor."""
    for values in ({"exposure_us": 0.0}, {"gain": 0.0}, {"read_noise_e": -1.0}, {"frame_length_rows": 400}):
        with pytest.raises(ValueError, match="must"):
            SimulatedSensor(intrinsics=LENS, **({"exposure_us": 9967.0} | values))  # type: ignore[arg-type]
