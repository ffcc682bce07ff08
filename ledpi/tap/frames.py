"""What a client gets from the tap, as the records of the path: to decode or draw a frame once more."""

from __future__ import annotations

import math
from dataclasses import asdict
from typing import Any

import numpy as np

from ledpi.config.panels import PanelSettings
from ledpi.core.errors import ConfigError, TapError
from ledpi.core.records import CameraInfo, Floats, Frame, Intrinsics, PanelValues
from ledpi.diagnosis.diagnose import NotRead
from ledpi.diagnosis.why_not import WhyNot
from ledpi.markers.dictionaries import load_dictionary

WITH_REASONS = ("rejected", "evidence")  # extras of a picture from which `not_read_of` knows all
SAME_PX = 1.0  # corners of one square, which are told twice, rounded


def camera_of(hello: dict[str, Any]) -> CameraInfo:
    """The daemon's camera. Raises TapError where the hello does not hold it."""
    camera = hello.get("camera", {})
    names = ("width", "height", "exposure_us", "row_time_us", "transfer", "frame_length_rows")
    try:
        return CameraInfo(**{name: camera[name] for name in names}, intrinsics=_lens_of(camera))
    except (KeyError, TypeError, ValueError) as error:
        raise TapError(f"the daemon's hello holds no whole camera: {error}") from None


def panel_of(hello: dict[str, Any]) -> PanelValues:
    """The panels that the daemon looks for. Raises TapError."""
    try:
        return PanelValues(**hello["panels"])
    except (KeyError, TypeError) as error:
        raise TapError(f"the daemon's hello holds no whole panel: {error}") from None


def settings_of(hello: dict[str, Any]) -> PanelSettings:
    """The same as settings, to decode with. Raises TapError where the dictionary cannot be read from here."""
    try:
        settings = PanelSettings(**asdict(panel_of(hello)))
        load_dictionary(settings.dictionary)
    except (ValueError, ConfigError) as error:
        raise TapError(f"the daemon's panels cannot be used here: {error}") from None
    return settings


def why_not_of(hello: dict[str, Any]) -> WhyNot:
    """For the pictures of this daemon. Raises TapError."""
    camera = camera_of(hello)
    return WhyNot(camera, settings_of(hello), camera.intrinsics)


def not_read_of(picture: dict[str, Any]) -> list[NotRead]:
    """What was dropped in a picture that was asked for WITH_REASONS."""
    looks = [look for look in picture.get("looks", []) if look.get("why")]
    found = []
    for rejected in picture.get("rejected", []):
        corners = np.array(rejected["corners_px"], np.float64)
        look = next((x for x in looks if np.abs(np.array(x["corners_px"]) - corners).max() < SAME_PX), None)
        nats = None if look is None else _square(look.get("cells_nats") or [])
        found.append(NotRead(corners_px=corners, why=rejected["why"], cells_nats=nats))
    return found


def read_px_of(picture: dict[str, Any]) -> list[Floats]:
    """The corners (4, 2) of each panel that was read in it."""
    return [np.array(marker["corners_px"], np.float64) for marker in picture["decoded"]["markers"]]


def _square(numbers: list[float]) -> Floats | None:
    """(n, n); None where there are none, or not of a square."""
    side = math.isqrt(len(numbers))
    return np.array(numbers, np.float64).reshape(side, side) if side and side * side == len(numbers) else None


def frame_of(hello: dict[str, Any], picture: dict[str, Any]) -> Frame:
    """The frame of a picture's answer, with the camera's times. Raises TapError."""
    try:
        decoded = picture["decoded"]
        return Frame(
            pixels=picture["pixels"],
            seq=decoded["seq"],
            row0_readout_ns=decoded["sensor_timestamp_ns"],
            exposure_us=decoded["exposure_us"],
            row_time_us=hello["camera"]["row_time_us"],
            transfer=hello["camera"]["transfer"],
            analogue_gain=decoded["analogue_gain"],
        )
    except (KeyError, TypeError, ValueError) as error:
        raise TapError(f"the daemon's picture holds no whole frame: {error}") from None


def _lens_of(camera: dict[str, Any]) -> Intrinsics | None:
    if camera["fx"] is None:
        return None
    values = {name: camera[name] for name in ("width", "height", "fx", "fy", "cx", "cy")}
    return Intrinsics(**values, distortion=tuple(camera["distortion"]))
