"""What is asked of the Pi's camera so that its bands can be read, and whether it does that. Pure functions.

The sensor's facts are those of the OV5647, with their sources.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from ledpi.camera.timing import choose_frame_length_rows, exposure_honoured
from ledpi.config import CameraSettings
from ledpi.errors import CameraError

SENSOR = "ov5647"
MODE = (640, 480)
SHORTEST_FRAME_ROWS = 504  # of that mode: Linux driver ov5647.c, vts 0x1f8
EXPOSURE_MARGIN_ROWS = 4  # frame less exposure: libcamera cam_helper_ov5647.cpp, frameIntegrationDiff
GAIN_STEP = 1 / 16  # the same file, gainCode

# Where `analogue_gain: auto` starts, and stays until there is a control loop for it: a lit panel in a room is
# well above the noise at 10 ms, and the gain can still go either way.
START_GAIN = 4.0


def check_mode(configuration: Mapping[str, Any]) -> None:
    """Raises CameraError where what was configured is not what was asked (`camera_configuration()`)."""
    sensor, main = configuration.get("sensor") or {}, configuration["main"]
    mode = tuple(sensor.get("output_size") or ())
    if mode != MODE:
        raise CameraError(
            f"picamera2: the sensor's mode is {mode or 'unknown'}; must be {MODE}, whose row time is known"
        )
    if tuple(main["size"]) != MODE or main["format"] not in ("YUV420", "NV12"):
        raise CameraError(f"picamera2: pictures are {main['size']} {main['format']}; must be {MODE} YUV420")


def row_time(settings: CameraSettings, model: str, shortest_frame_us: float) -> float:
    """µs between the starts of two rows: measured, or the shortest frame's duration over its rows.

    Raises CameraError for a sensor whose rows are not known here.
    """
    if settings.row_time_us != "auto":
        return settings.row_time_us
    if model != SENSOR:
        raise CameraError(
            f"camera.row_time_us: auto is for {SENSOR}, and this camera is {model}; measure it once with "
            "`ledpi calibrate shutter` and set it"
        )
    return shortest_frame_us / SHORTEST_FRAME_ROWS


def frame_rows(
    settings: CameraSettings, row_time_us: float, frequencies_hz: Sequence[float], sensor_shortest_rows: int
) -> int:
    """The frame period in rows: as set, or the shortest that keeps the phases moving.

    Raises CameraError where the period set is too short for the sensor or the exposure, or none suits.
    """
    exposure_rows = int(settings.exposure_us / row_time_us)
    shortest = max(sensor_shortest_rows, exposure_rows + EXPOSURE_MARGIN_ROWS)
    if settings.frame_duration_us == "auto":
        try:
            return choose_frame_length_rows(
                shortest_rows=shortest, row_time_us=row_time_us, frequencies_hz=frequencies_hz
            )
        except ValueError as error:
            raise CameraError(f"camera.frame_duration_us: {error}") from None
    rows = round(settings.frame_duration_us / row_time_us)
    if rows < shortest:
        raise CameraError(
            f"camera.frame_duration_us: must be at least {shortest * row_time_us:.0f} here, "
            f"not {settings.frame_duration_us:g}"
        )
    return rows


def start_gain(settings: CameraSettings) -> float:
    """The analogue gain to start with."""
    return START_GAIN if settings.analogue_gain == "auto" else settings.analogue_gain


def fixed_controls(
    *, exposure_us: float, analogue_gain: float, duration_us: int, noise_reduction_off: Any
) -> dict[str, Any]:
    """Every control that a frame depends on. libcamera judges the types: ExposureTime must be an int."""
    return {
        "AeEnable": False,
        "ExposureTime": int(exposure_us),
        "AnalogueGain": float(analogue_gain),
        "AwbEnable": False,
        "ColourGains": (1.0, 1.0),  # luma is mostly green: gains for red and blue would add noise
        "FrameDurationLimits": (duration_us, duration_us),
        "NoiseReductionMode": noise_reduction_off,
        "Sharpness": 0.0,
        "Contrast": 1.0,
        "Saturation": 1.0,
        "Brightness": 0.0,
    }


def disagreement(metadata: Mapping[str, Any], asked: Mapping[str, Any], row_time_us: float) -> str | None:
    """The key to set and what the camera did, where a frame was not made as asked. None where it was."""
    exposure, wanted = metadata.get("ExposureTime", 0), asked["ExposureTime"]
    if not exposure_honoured(asked_us=wanted, reported_us=exposure, row_time_us=row_time_us):
        return f"camera.exposure_us: {wanted} µs was asked, and the camera reports {exposure}"
    gain, wanted = metadata.get("AnalogueGain", 0), asked["AnalogueGain"]
    if abs(gain - wanted) > GAIN_STEP:
        return f"camera.analogue_gain: {wanted} was asked, and the camera reports {gain}"
    duration, wanted = metadata.get("FrameDuration", 0), asked["FrameDurationLimits"][0]
    if abs(duration - wanted) > row_time_us:
        return f"camera.frame_duration_us: {wanted} µs was asked, and the camera reports {duration}"
    return None
