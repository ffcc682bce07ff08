"""Picture files as frames."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from ledpi.camera.recording.picture import read_still
from ledpi.core.errors import RecordingError
from ledpi.core.records import CameraInfo

# An APP1 segment of 34 bytes: Exif, big-endian TIFF with one entry, Orientation (0x0112) = 3, upside down.
UPSIDE_DOWN = bytes.fromhex("ffe1 0022 457869660000 4d4d002a00000008 0001 0112 0003 00000001 0003 0000 00000000")


def test_rows_stay_as_the_sensor_exposed_them(tmp_path: Path) -> None:
    """A camera that was held upside down marks its file so; turned, the bands would run the wrong way."""
    dark_above = np.repeat(np.uint8([20, 220]), 16)[:, None] * np.ones((1, 32), np.uint8)
    jpeg = cv2.imencode(".jpg", dark_above)[1].tobytes()
    path = tmp_path / "held.jpg"
    path.write_bytes(jpeg[:2] + UPSIDE_DOWN + jpeg[2:])
    assert cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)[0, 0] > 200  # OpenCV sees the mark
    camera = CameraInfo(width=32, height=32, exposure_us=9967.0, row_time_us=33.67, transfer="srgb")
    assert read_still(path, camera).pixels[0, 0] < 40


@pytest.mark.parametrize("bits", [8, 10, 12, 14, 16])
def test_values_of_fewer_than_16_bits_are_read(tmp_path: Path, bits: int) -> None:
    """A sensor's 10 or 12 bits are stored in 16, and read by their own full scale."""
    light = np.linspace(0.0, 1.0, 32 * 32).reshape(32, 32)
    path = tmp_path / "deep.png"
    cv2.imwrite(str(path), np.round(light * (2**bits - 1)).astype(np.uint16))
    camera = CameraInfo(width=32, height=32, exposure_us=9967.0, row_time_us=33.67, transfer="linear")
    np.testing.assert_allclose(read_still(path, camera).pixels, 255 * light, atol=1.0)


@pytest.mark.parametrize("kind", [np.float32, np.int16, np.int32])
def test_values_of_other_kinds_are_told(tmp_path: Path, kind: type) -> None:
    """A TIFF may hold any: it is no black picture, and no traceback."""
    path = tmp_path / "other.tif"
    cv2.imwrite(str(path), np.full((32, 32), 200, kind))
    camera = CameraInfo(width=32, height=32, exposure_us=9967.0, row_time_us=33.67, transfer="linear")
    with pytest.raises(
        RecordingError, match=r"other\.tif: cannot be read as a picture of 8 or 16 bits; must be 32 × 32"
    ):
        read_still(path, camera)
