"""A picture file as a frame: any format that OpenCV reads, with what the configuration says of its exposure."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from ledpi.config.settings import CameraSettings
from ledpi.core.errors import ConfigError, RecordingError
from ledpi.core.files import read_bytes
from ledpi.core.records import CameraInfo, Frame
from ledpi.recording.picture import MAX_BYTES, PNG_SIGNATURE, png_fault

SUFFIXES = {".png", ".jpg", ".jpeg", ".bmp", ".pgm", ".tif", ".tiff"}
# The file's own orientation mark is passed over: lens and shutter belong to the sensor's rows and columns.
_AS_EXPOSED = cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION


def still_camera(settings: CameraSettings) -> CameraInfo:
    """What the configuration says of the camera that took a picture. Raises ConfigError where it leaves that open."""
    if settings.row_time_us == "auto":
        raise ConfigError("pictures do not say their row time: --set camera.row_time_us=33.67 (or what it was)")
    return CameraInfo(
        width=settings.width,
        height=settings.height,
        exposure_us=settings.exposure_us,
        row_time_us=settings.row_time_us,
        transfer="srgb" if settings.transfer == "auto" else settings.transfer,
    )


def read_still(path: Path, camera: CameraInfo, seq: int = 0) -> Frame:
    """The picture as a frame at time 0. Raises RecordingError where it cannot be read or has another size."""
    wanted = f"must be {camera.width} × {camera.height}"
    data = read_bytes(path, RecordingError, MAX_BYTES)
    fault = png_fault(data) if data.startswith(PNG_SIGNATURE) else None
    if fault is not None:
        raise RecordingError(f"{path}: {fault[1]}")
    try:
        picture = cv2.imdecode(np.frombuffer(data, np.uint8), _AS_EXPOSED) if data else None
    except cv2.error:
        picture = None
    if picture is None:
        raise RecordingError(f"{path}: cannot be read as a picture; {wanted}")
    if picture.shape != (camera.height, camera.width):
        raise RecordingError(f"{path}: is {picture.shape[1]} × {picture.shape[0]}; {wanted}")
    return Frame(
        pixels=np.asarray(picture, np.uint8),
        seq=seq,
        row0_readout_ns=0,
        exposure_us=camera.exposure_us,
        row_time_us=camera.row_time_us,
        transfer=camera.transfer,
    )
