"""Contents of messages of others, checked, and the names of topics."""

from __future__ import annotations

import os
import resource
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Any, TypeVar

import cv2
import numpy as np
from pydantic import AliasChoices, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError

from ledpi.config.camera_yaml import lens_of_form
from ledpi.config.lens_forms import lens_form
from ledpi.config.values import MAX_SIDE_PX, Finite, SidePx
from ledpi.core.errors import CalibrationError, RecordingError, shortened_name
from ledpi.core.records import Intrinsics, Pixels

MAX_BYTES = 1 << 28  # beyond what the process has: the largest picture in colour, four times

IMAGE = "/camera/image_raw/compressed"
CAMERA_INFO = "/camera/camera_info"
# std_msgs/String: a line of frames.jsonl, of truth.jsonl, and what the tap tells of each frame.
FRAME, TRUTH, DECODED = "/ledpi/frame", "/ledpi/truth", "/ledpi/decoded"
METADATA = "ledpi.recording"  # the bag's metadata of this name: recording.yaml, controller.jsonl, a dictionary's file
CAMERA_FRAME = "camera_optical_frame"
# Encodings of ROS's camera drivers: bytes a pixel, and where the luma is in them.
_IN_PLACE = {
    "mono8": (1, 0),
    "8UC1": (1, 0),
    "yuv422_yuy2": (2, 0),
    "yuyv": (2, 0),
    "yuv422": (2, 1),
    "uyvy": (2, 1),
    "nv12": (1, 0),  # rows of colour follow those of luma
    "nv21": (1, 0),
}
_HALF_MORE_ROWS = {"nv12", "nv21"}
_SIXTEEN_BITS = {"mono16", "16UC1"}
_MIXED = {
    "bgr8": cv2.COLOR_BGR2GRAY,
    "8UC3": cv2.COLOR_BGR2GRAY,
    "rgb8": cv2.COLOR_RGB2GRAY,
    "bgra8": cv2.COLOR_BGRA2GRAY,
    "rgba8": cv2.COLOR_RGBA2GRAY,
}
ENCODINGS = "mono8, mono16, bgr8, rgb8, yuv422, yuv422_yuy2, nv12 or nv21"
Model = TypeVar("Model", bound=BaseModel)


@contextmanager
def memory_bounded(path: Path) -> Iterator[None]:
    """Lets the process take no more, and raises RecordingError where it wants to."""
    soft, hard = resource.getrlimit(resource.RLIMIT_DATA)
    has = 1024 * int(Path("/proc/self/status").read_text(encoding="ascii").split("VmData:")[1].split()[0])
    limits = [limit for limit in (soft, hard) if limit != resource.RLIM_INFINITY]
    resource.setrlimit(resource.RLIMIT_DATA, (min([has + MAX_BYTES, *limits]), hard))
    try:
        yield
    except MemoryError:
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))  # the words of the error, too, take some
        most = f"{MAX_BYTES >> 20} MB"
        raise RecordingError(f"{path}: would take more than {most} of memory to read; must be smaller") from None
    finally:
        resource.setrlimit(resource.RLIMIT_DATA, (soft, hard))


@contextmanager
def libraries_silent() -> Iterator[None]:
    """Lets nothing through of what OpenCV, libpng or libjpeg print of a damaged file: ledpi says it, in one line."""
    errors, nothing = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nothing, 2)
        yield
    finally:
        os.dup2(errors, 2)
        os.close(errors)
        os.close(nothing)


def _bytes(data: Any) -> Any:
    return np.asarray(data, np.uint8).ravel()


def _numbers(data: Any) -> Any:
    return data.tolist() if isinstance(data, np.ndarray) else data


Bytes = Annotated[Any, BeforeValidator(_bytes)]
Numbers = Annotated[list[Finite], BeforeValidator(_numbers), Field(max_length=14)]


class _Message(BaseModel):
    model_config = ConfigDict(from_attributes=True)


class _Stamp(_Message):
    sec: Annotated[int, Field(ge=0, lt=2**32)]
    nanosec: Annotated[int, Field(ge=0, lt=10**9)]

    @property
    def time_ns(self) -> int:
        return self.sec * 10**9 + self.nanosec


class _Header(_Message):
    stamp: _Stamp


class Text(_Message):
    """std_msgs/String."""

    data: str


class Compressed(_Message):
    """sensor_msgs/CompressedImage."""

    header: _Header
    format: str
    data: Bytes


class Image(_Message):
    """sensor_msgs/Image."""

    header: _Header
    width: SidePx
    height: SidePx
    step: Annotated[int, Field(ge=1)]
    encoding: str
    is_bigendian: bool
    data: Bytes


class _Region(_Message):
    x_offset: Annotated[int, Field(ge=0)]
    y_offset: Annotated[int, Field(ge=0)]
    width: Annotated[int, Field(ge=0)]
    height: Annotated[int, Field(ge=0)]


class Info(_Message):
    """sensor_msgs/CameraInfo: of a whole picture of the sensor, of which pictures show a region, maybe binned."""

    width: int
    height: int
    distortion_model: str
    k: Numbers = Field(validation_alias=AliasChoices("k", "K"))
    d: Numbers = Field(validation_alias=AliasChoices("d", "D"))
    binning_x: Annotated[int, Field(ge=0, le=64)] = 0
    binning_y: Annotated[int, Field(ge=0, le=64)] = 0
    roi: _Region | None = None


def checked(model: type[Model], message: Any, where: str) -> Model:
    """The message, as the model has it. Raises RecordingError."""
    try:
        return model.model_validate(message)
    except (ValidationError, ValueError, TypeError, OverflowError, RecursionError) as error:
        what = type(error).__name__
        if isinstance(error, ValidationError):
            first = error.errors()[0]
            key = ".".join(shortened_name(part) for part in first["loc"])
            what = f"{key}: {first['msg'].replace('Input should be', 'must be')}"
        raise RecordingError(f"{where}: holds a broken message: {shortened_name(what)}") from None


def luma_of_image(image: Image, where: str) -> Pixels:
    """Its luma. Raises RecordingError."""
    name, width, height, data = image.encoding, image.width, image.height, image.data
    mixed, sixteen = _MIXED.get(name), name in _SIXTEEN_BITS
    size, place = (4 if name in {"bgra8", "rgba8"} else 3, 0) if mixed is not None else _IN_PLACE.get(name, (0, 0))
    if sixteen:
        size, place = 2, 0 if image.is_bigendian else 1  # the upper eight bits
    if not size:
        what = f"{shortened_name(name) or 'of no encoding'}; must be {ENCODINGS}"
        raise RecordingError(f"{where}: is {what}: bag the camera's picture as its driver gives it")
    rows = height + height // 2 if name in _HALF_MORE_ROWS else height
    if data.size != rows * image.step or image.step < size * width:
        raise RecordingError(f"{where}: holds a picture whose size is not as it says")
    pixels = data.reshape(rows, image.step)[:height, : size * width].reshape(height, width, size)
    if mixed is not None:
        return np.asarray(cv2.cvtColor(np.ascontiguousarray(pixels), mixed), np.uint8)
    return np.ascontiguousarray(pixels[:, :, place])


def luma_of_compressed(image: Compressed, where: str) -> Pixels:
    """Its luma, as the sensor gave it: marks that turn a picture are passed over. Raises RecordingError."""
    try:
        with libraries_silent():
            picture = cv2.imdecode(image.data, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION)
    except cv2.error:
        picture = None
    if picture is None:
        what = shortened_name(image.format)
        raise RecordingError(f"{where}: holds a picture that cannot be decoded (format {what!r})")
    if max(picture.shape) > MAX_SIDE_PX:
        raise RecordingError(f"{where}: holds a picture of more than {MAX_SIDE_PX} pixels a side; must be smaller")
    return np.asarray(picture, np.uint8)


def lens_of_info(info: Info, width: int, height: int, where: str) -> Intrinsics | None:
    """The lens of pictures of this size; None where the camera is not calibrated, which ROS says by zeros.

    Raises RecordingError where it is of others, or of a model that is not known.
    """
    if not info.k or info.k[0] == 0:
        return None
    values = {
        "image_width": info.width,
        "image_height": info.height,
        "camera_matrix": info.k,
        "distortion_coefficients": info.d or [0.0] * 5,
    }
    names = {**dict.fromkeys(values, ""), "camera_matrix": "k", "distortion_coefficients": "d"}
    try:
        lens = lens_of_form(lens_form(values, names, info.distortion_model, where))
    except CalibrationError as error:
        raise RecordingError(f"{where}: {error}; set camera.intrinsics instead") from None
    region, bin_x, bin_y = info.roi, max(info.binning_x, 1), max(info.binning_y, 1)
    left, top, wide, high = (0, 0, info.width, info.height)
    if region is not None and region.width and region.height:
        left, top, wide, high = region.x_offset, region.y_offset, region.width, region.height
    if left + wide > info.width or top + high > info.height or (wide // bin_x, high // bin_y) != (width, height):
        raise RecordingError(
            f"{where}: is of {wide} × {high} pixels in steps of {bin_x} × {bin_y}, but the picture has {width} × "
            f"{height}: must be the lens of this picture; or bag without it and set camera.intrinsics"
        )
    return replace(  # a binned pixel's middle lies between those that it is made of
        lens,
        width=width,
        height=height,
        fx=lens.fx / bin_x,
        fy=lens.fy / bin_y,
        cx=(lens.cx - left + 0.5) / bin_x - 0.5,
        cy=(lens.cy - top + 0.5) / bin_y - 0.5,
    )
