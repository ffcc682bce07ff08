"""A picture file as a frame: any format that OpenCV reads, with what the configuration says of its exposure."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from ledpi.camera.recording.picture import MAX_BYTES, PNG_SIGNATURE, png_fault
from ledpi.config.settings import CameraSettings
from ledpi.core.errors import ConfigError, RecordingError
from ledpi.core.files import read_bytes
from ledpi.core.records import CameraInfo, Frame, Pixels

SUFFIXES = {".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".tif", ".tiff"}
# The file's own orientation mark is passed over: lens and shutter belong to the sensor's rows and columns.
_AS_EXPOSED = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
_DEPTHS = (8, 10, 12, 14, 16)  # bits, of the 16 in which sensors' values are stored


def still_camera(settings: CameraSettings) -> CameraInfo:
    """Returns the camera that took a picture, by the configuration. Raises ConfigError where that leaves it open."""
    if settings.row_time_us == "auto":
        raise ConfigError(
            "a picture file has no row time: add --set camera.row_time_us=33.67 (OV5647; other cameras: "
            "docs/raspberry-pi.md#other-cameras)"
        )
    return CameraInfo(
        width=settings.width,
        height=settings.height,
        exposure_us=settings.exposure_us,
        row_time_us=settings.row_time_us,
        transfer="srgb" if settings.transfer == "auto" else settings.transfer,
        rows_from=settings.rows_from,
    )


def read_still(path: Path, camera: CameraInfo, seq: int = 0) -> Frame:
    """The picture as a frame at time 0. Raises RecordingError where it cannot be read or has another size."""
    wanted = f"must be {camera.width} × {camera.height}"
    data = read_bytes(path, RecordingError, MAX_BYTES)
    fault = png_fault(data) if data.startswith(PNG_SIGNATURE) else None
    if fault is not None:
        raise RecordingError(f"{path}: {fault[1]}")
    picture = decode_grey(data)
    if picture is None:
        raise RecordingError(f"{path}: cannot be read as a picture of 8 or 16 bits; {wanted}")
    if picture.shape != (camera.height, camera.width):
        raise RecordingError(f"{path}: is {picture.shape[1]} × {picture.shape[0]}; {wanted}")
    return Frame(
        pixels=picture,
        seq=seq,
        row0_readout_ns=0,
        exposure_us=camera.exposure_us,
        row_time_us=camera.row_time_us,
        transfer=camera.transfer,
    )


def decode_grey(data: bytes) -> Pixels | None:
    """A picture file's grey values (H, W), its rows as they were exposed; None where it has none of 8 or 16 bits.

    Of 16 bits the upper eight of those that are used: a sensor of 10 or 12 bits leaves the others 0, and taken as they
    stand its pictures would be black.
    """
    if not data:
        return None
    coded = np.frombuffer(data, np.uint8)
    try:
        picture = cv2.imdecode(coded, _AS_EXPOSED | cv2.IMREAD_ANYDEPTH)
        if picture is not None and picture.dtype == np.uint8:
            return np.asarray(cv2.imdecode(coded, _AS_EXPOSED), np.uint8)
    except cv2.error:
        return None
    if picture is None or picture.dtype != np.uint16:
        return None
    bits = next(depth for depth in _DEPTHS if int(picture.max()) < 1 << depth)
    return np.asarray(picture >> (bits - 8), np.uint8)
