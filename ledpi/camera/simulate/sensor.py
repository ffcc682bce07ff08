"""From linear light to 8-bit pixels: photons, read noise, full scale, tone curve, sharpening, quantisation."""

from __future__ import annotations

from functools import cache
from statistics import NormalDist

import cv2
import numpy as np
from numpy.typing import NDArray

from ledpi.camera.simulate.scene import SimulatedSensor
from ledpi.camera.simulate.surface import Image
from ledpi.core.records import CameraInfo, Floats, Pixels, Transfer

_STEPS = 65536
SHARPENED_PX = 1.0  # deviation of the blur whose loss is made good


def srgb_oetf(level: Floats) -> Floats:
    """Linear light 0..1 → sRGB's encoded value 0..1 (IEC 61966-2-1)."""
    curve = 1.055 * np.power(np.maximum(level, 0.0031308), 1.0 / 2.4) - 0.055
    return np.asarray(np.where(level <= 0.0031308, 12.92 * level, curve))


def sensor_info(sensor: SimulatedSensor, reported_row_time: float = 1.0) -> CameraInfo:
    """Returns what the driver says of the camera; of the row time, as many times the true one."""
    return CameraInfo(
        width=sensor.intrinsics.width,
        height=sensor.intrinsics.height,
        exposure_us=sensor.exposure_us * reported_row_time,
        row_time_us=sensor.row_time_us * reported_row_time,
        transfer=sensor.transfer,
        frame_length_rows=sensor.frame_length_rows,
        intrinsics=sensor.intrinsics,
    )


@cache
def _values(transfer: Transfer, tone_contrast: float) -> Image:
    """0..255 of each of 65536 equal steps of linear light, at most 1/19 of a code wide; not rounded."""
    level = (np.arange(_STEPS) + 0.5) / _STEPS
    value = srgb_oetf(level) if transfer == "srgb" else level
    bent = value * value * (3.0 - 2.0 * value)
    return np.asarray(255.0 * (value + tone_contrast * (bent - value)), np.float32)


@cache
def _normal_quantiles() -> Image:
    """Standard normal deviates of 65536 equal shares of probability, to 4.2 σ; far quicker than drawing."""
    half = [NormalDist().inv_cdf((i + 0.5) / _STEPS) for i in range(_STEPS // 2)]
    return np.array(half + [-v for v in reversed(half)], np.float32)


class SensorReadout:
    """Keeps the buffers; one frame at a time.

    A pixel at level L holds e = L·full_well/gain electrons. Their number varies with variance e (shot
    noise, normal in place of Poisson: e is above 20 where it matters) plus read_noise². Full scale clips,
    and so does black.
    """

    def __init__(self, sensor: SimulatedSensor) -> None:
        shape = (sensor.intrinsics.height, sensor.intrinsics.width)
        full_scale_e = sensor.full_well_e / sensor.gain
        self._shot = 1.0 / full_scale_e
        self._read = (sensor.read_noise_e / full_scale_e) ** 2
        self._values, self._sharpening = _values(sensor.transfer, sensor.tone_contrast), sensor.sharpening
        self._codes = np.round(self._values).astype(np.uint8)
        self._deviation: Image = np.empty(shape, np.float32)
        self._noise: Image = np.empty(shape, np.float32)
        self._step: NDArray[np.uint16] = np.empty(shape, np.uint16)

    def read(self, level: Image, rng: np.random.Generator, into: Pixels) -> None:
        """Fills `into` (H, W) from linear light (H, W), full scale 1."""
        np.multiply(level, np.float32(self._shot), out=self._deviation)
        np.add(self._deviation, np.float32(self._read), out=self._deviation)
        cv2.sqrt(self._deviation, self._deviation)
        draws = rng.integers(0, _STEPS, level.shape, np.uint16)
        np.take(_normal_quantiles(), draws, out=self._noise, mode="clip")
        np.multiply(self._noise, self._deviation, out=self._noise)
        np.add(self._noise, level, out=self._noise)
        np.multiply(self._noise, np.float32(_STEPS), out=self._noise)
        np.clip(self._noise, 0, _STEPS - 1, out=self._noise)
        np.copyto(self._step, self._noise, casting="unsafe")
        if self._sharpening:
            self._sharpen(into)
        else:
            np.take(self._codes, self._step, out=into, mode="clip")

    def _sharpen(self, into: Pixels) -> None:
        """By an unsharp mask, as a processor does it: after the tone curve, noise and all."""
        value = np.take(self._values, self._step)
        sharper = value + np.float32(self._sharpening) * (value - cv2.GaussianBlur(value, (0, 0), SHARPENED_PX))
        np.copyto(into, np.round(np.clip(sharper, 0.0, 255.0)), casting="unsafe")
