"""What a client gets from the tap, as the records of the path: to decode or draw a frame once more."""

from __future__ import annotations

from typing import Any

from ledpi.core.errors import TapError
from ledpi.core.records import CameraInfo, Frame, Intrinsics, PanelValues


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
