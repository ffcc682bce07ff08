"""The requests to the Pi's camera that make its bands readable, whether it does as asked, and facts of the sensors.

Pure functions. Nothing here was seen on hardware.

Sources, by file: the Linux drivers `drivers/media/i2c/ov5647.c` and `imx219.c` (raspberrypi/linux), and libcamera's
`src/ipa/rpi/cam_helper/cam_helper_ov5647.cpp` and `cam_helper_imx219.cpp`. All of the 640 × 480 mode, 10 bit.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from ledpi.camera.timing import choose_frame_length_rows, exposure_honoured
from ledpi.config.settings import CameraSettings
from ledpi.core.errors import CameraError, RowTimeUnknownError, raising

MODE = (640, 480)  # both sensors have it; no other is used, as a scaled picture has another row time
BIT_DEPTH = 10

# A sensor's gains are steps, and it takes the one below: the OV5647's are 1/16 apart, which is most at gain 1; the
# IMX219's are less than 5 % apart.
GAIN_TOLERANCE = 1 / 16
FORMATS = ("YUV420", "NV12")  # in both, luma is a picture of its own, ahead of the colours


@dataclass(frozen=True, slots=True, kw_only=True)
class SensorFacts:
    """Facts that the camera itself does not tell, or that are needed before it is open."""

    row_clocks: int  # pixel clocks from one row's start to the next's, blanking included
    shortest_frame_rows: int | None  # the driver's least frame, blanking included; None where drivers differ
    exposure_margin_rows: int  # that a frame is longer than its exposure, at least


SENSORS = {
    # hts 1852 (register 0x380c 0x073c), vts 0x1f8, OV5647_VBLANK_MIN 24; frameIntegrationDiff. The pixel rate is the
    # driver's word: 55 MHz, 58.333 MHz in newer ones.
    "ov5647": SensorFacts(row_clocks=1852, shortest_frame_rows=504, exposure_margin_rows=4),
    # IMX219_PPL_DEFAULT; IMX219_VBLANK_MIN is 4 in older drivers and 32 in newer ones, and newer ones double the pixel
    # rate of 182.4 MHz in binned modes, so the row time must be measured.
    "imx219": SensorFacts(row_clocks=3448, shortest_frame_rows=None, exposure_margin_rows=4),
}


def check_mode(configuration: Mapping[str, Any]) -> None:
    """Raises CameraError where what was configured is not what was asked (`camera_configuration()`)."""
    sensor, main = configuration.get("sensor") or {}, configuration["main"]
    mode = tuple(sensor.get("output_size") or ())
    if mode != MODE or sensor.get("bit_depth") != BIT_DEPTH:
        raise CameraError(
            f"picamera2: the sensor's mode is {mode or 'unknown'}, {sensor.get('bit_depth')} bit; "
            f"must be {MODE}, {BIT_DEPTH} bit, whose row time is known"
        )
    if tuple(main["size"]) != MODE or main["format"] not in FORMATS:
        raise CameraError(f"picamera2: pictures are {main['size']} {main['format']}; must be {MODE} {FORMATS[0]}")


def row_time(settings: CameraSettings, model: str, shortest_frame_us: float) -> float:
    """µs between the starts of two rows: measured, or the shortest frame's duration over its rows.

    Raises CameraError for a sensor whose rows are not known here.
    """
    if settings.row_time_us != "auto":
        return settings.row_time_us
    facts = SENSORS.get(model)
    if facts is None or facts.shortest_frame_rows is None:
        known = ", ".join(name for name, sensor in SENSORS.items() if sensor.shortest_frame_rows is not None)
        raise RowTimeUnknownError(
            f"camera.row_time_us: auto is for {known}, and this camera is {model}; measure it once with "
            "`ledpi calibrate shutter` and set it"
        )
    return shortest_frame_us / facts.shortest_frame_rows


def frame_rows(
    settings: CameraSettings, row_time_us: float, frequencies_hz: Sequence[float], model: str, shortest_frame_us: float
) -> int:
    """The frame period in rows: as set, or the shortest that keeps the phases moving.

    Raises CameraError where the period set is too short for the sensor or the exposure, or none suits.
    """
    facts = SENSORS.get(model)
    margin = 4 if facts is None else facts.exposure_margin_rows
    exposure_rows = int(settings.exposure_us / row_time_us)
    shortest = max(round(shortest_frame_us / row_time_us), exposure_rows + margin)
    if settings.frame_duration_us == "auto":
        with raising("camera.frame_duration_us", CameraError):
            return choose_frame_length_rows(
                shortest_rows=shortest, row_time_us=row_time_us, frequencies_hz=frequencies_hz
            )
    rows = round(settings.frame_duration_us / row_time_us)
    if rows < shortest:
        raise CameraError(
            f"camera.frame_duration_us: must be at least {shortest * row_time_us:.0f} here, "
            f"not {settings.frame_duration_us:g}"
        )
    return rows


def fixed_controls(
    *,
    exposure_us: float,
    analogue_gain: float,
    duration_us: int,
    colour_gains: tuple[float, float],
    noise_reduction_off: Any,
) -> dict[str, Any]:
    """Every control that a frame depends on. libcamera judges the types: ExposureTime must be an int."""
    return {
        "AeEnable": False,
        "ExposureTime": int(exposure_us),
        "AnalogueGain": float(analogue_gain),
        "AwbEnable": False,
        "ColourGains": colour_gains,
        "FrameDurationLimits": (duration_us, duration_us),
        "NoiseReductionMode": noise_reduction_off,
        "Sharpness": 0.0,
        "Contrast": 1.0,
        "Saturation": 1.0,
        "Brightness": 0.0,
    }


def check_limits(asked: Mapping[str, Any], camera_controls: Mapping[str, Any]) -> None:
    """Raises CameraError for what this camera says that it cannot do, and so a person must change."""
    for key, name in (("camera.exposure_us", "ExposureTime"), ("camera.analogue_gain", "AnalogueGain")):
        least, most = (camera_controls.get(name) or (None, None))[:2]
        if least is not None and most is not None and not least <= asked[name] <= most:
            raise CameraError(f"{key}: must be {least:g} to {most:g} with this camera, not {asked[name]:g}")


def disagreement(metadata: Mapping[str, Any], asked: Mapping[str, Any], row_time_us: float) -> str | None:
    """The key to set and what the camera did, where a frame was not made as asked. None where it was."""
    exposure, wanted = metadata.get("ExposureTime", 0), asked["ExposureTime"]
    if not exposure_honoured(asked_us=wanted, reported_us=exposure, row_time_us=row_time_us):
        return f"camera.exposure_us: {wanted} µs was asked, and the camera reports {exposure}"
    gain, wanted = metadata.get("AnalogueGain", 0), asked["AnalogueGain"]
    if abs(gain - wanted) > GAIN_TOLERANCE * wanted:
        return f"camera.analogue_gain: {wanted:g} was asked, and the camera reports {gain:g}"
    duration, wanted = metadata.get("FrameDuration", 0), asked["FrameDurationLimits"][0]
    if abs(duration - wanted) > row_time_us:
        return f"camera.frame_duration_us: {wanted} µs was asked, and the camera reports {duration}"
    return None
