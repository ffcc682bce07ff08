"""A bag, or a video, → a recording.

A bag of ours holds a recording, which comes back as it was, byte by byte. Of another one the grey pictures and the lens
are taken; what it does not say (row time, exposure, panels) the configuration must.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ledpi.bags.names import FRAME, IMAGE, METADATA, TRUTH
from ledpi.bags.reading import Item, Warn, messages
from ledpi.config.camera_yaml import lens_of
from ledpi.config.settings import Config
from ledpi.core.errors import ConfigError, LedpiError, RecordingError
from ledpi.core.files import not_written
from ledpi.core.records import CameraInfo, Frame, Intrinsics, Pixels
from ledpi.core.wording import shortened_name
from ledpi.recording.format import FRAMES_FILE, HEADER_FILE, TRUTH_FILE, FrameLine
from ledpi.recording.writer import RecordingWriter
from ledpi.ros.contents import CAMERA_INFO, COMPRESSED_IMAGE

IMAGES = {"sensor_msgs/msg/Image", COMPRESSED_IMAGE}
GREY = {"mono8", "8UC1"}
NO_LENS = "has no camera info: the recording has no lens, and gives IDs without poses; or set camera.intrinsics"


def import_bag(config: Config, path: Path, out: Path, topic: str | None, warn: Warn) -> Iterator[int]:
    """Writes the recording, and yields after each frame how many there are. Raises LedpiError."""
    items = messages(path, warn)
    first = next(items, None)
    if first is None:
        raise RecordingError(f"{path}: is empty: it holds no message")
    if first.topic == METADATA and not first.type:
        yield from _restore(first.read(), items, path, out)
    else:
        yield from _write(config, _pictures(_with_first(first, items), path, topic), path, out, warn)


def _with_first(first: Item, items: Iterator[Item]) -> Iterator[Item]:
    yield first
    yield from items


# ---- A bag of ours


def _restore(words: dict[str, str], items: Iterator[Item], path: Path, out: Path) -> Iterator[int]:
    """The recording's files, as they were. A picture comes before its line; without that it is left out."""
    _begin(out, words, path)
    png, count = b"", 0
    with _new(out / FRAMES_FILE) as frames:
        for item in items:
            if item.topic == IMAGE:
                png = item.read().data.tobytes()
            elif item.topic == FRAME:
                text = item.read().data
                _put(out / _checked(text, path).file, png)
                frames.write(f"{text}\n".encode())
                count += 1
                yield count
            elif item.topic == TRUTH:
                with (out / TRUTH_FILE).open("ab") as truth:
                    truth.write(f"{item.read().data}\n".encode())


def _begin(out: Path, words: dict[str, str], path: Path) -> None:
    if HEADER_FILE not in words or any(Path(name).name != name for name in words):
        raise RecordingError(f"{path}: its metadata {METADATA} is not of a recording")
    _check_new(out)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise not_written(out, error, RecordingError) from None
    for name, text in words.items():
        _put(out / name, text.encode())


def _checked(text: str, path: Path) -> FrameLine:
    """Names no file outside the recording."""
    try:
        return FrameLine.model_validate(json.loads(text))
    except ValueError:
        raise RecordingError(f"{path}: {FRAME}: holds what is no line of {FRAMES_FILE}") from None


def _put(path: Path, data: bytes) -> None:
    path.parent.mkdir(exist_ok=True)
    with _new(path) as file:
        file.write(data)


def _new(path: Path) -> Any:
    return _File(path)


class _File:
    """A new file, whose errors are RecordingErrors."""

    def __init__(self, path: Path) -> None:
        self._path = path

    def __enter__(self) -> _File:
        try:
            self._file = self._path.open("xb", buffering=0)
        except OSError as error:
            raise self._failure(error) from None
        return self

    def __exit__(self, *_: object) -> None:
        self._file.close()

    def write(self, data: bytes) -> None:
        try:
            view = memoryview(data)
            while view:
                view = view[self._file.write(view) :]
        except OSError as error:
            raise self._failure(error) from None

    def _failure(self, error: OSError) -> LedpiError:
        return not_written(self._path, error, RecordingError)


# ---- Any other bag, or a video


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """One picture of somebody else's, and the lens where it is known."""

    pixels: Pixels  # (H, W)
    time_ns: int
    lens: Intrinsics | None


def _pictures(items: Iterator[Item], path: Path, topic: str | None) -> Iterator[Picture]:
    """Yields those of one topic. The lens is the last that was told before the first picture."""
    seen: set[str] = set()
    lens: Intrinsics | None = None
    last_ns: int | None = None
    for item in items:
        if item.type == CAMERA_INFO:
            lens = _lens(item.read()) or lens
        if item.type not in IMAGES:
            continue
        seen.add(item.topic)
        if topic is None and len(seen) > 1:
            raise RecordingError(f"{path}: has pictures on several topics; --topic {' or '.join(sorted(seen))}")
        if topic is None or item.topic == topic:
            picture = _picture(item.read(), lens, f"{path}: {item.topic}")
            if last_ns is not None and picture.time_ns <= last_ns:
                raise RecordingError(
                    f"{path}: {item.topic}: header stamps must increase from picture to picture, and {picture.time_ns} "
                    f"ns follows {last_ns} ns: bag the topic of a driver that stamps each exposure"
                )
            last_ns = picture.time_ns
            yield picture
    if topic is not None and topic not in seen:
        there = ", ".join(sorted(seen)) or "no pictures"
        raise RecordingError(f"{path}: has no pictures on {topic}; it has: {there}")


def _picture(message: Any, lens: Intrinsics | None, where: str) -> Picture:
    stamp = message.header.stamp
    return Picture(pixels=_pixels(message, where), time_ns=stamp.sec * 1_000_000_000 + stamp.nanosec, lens=lens)


def _pixels(message: Any, where: str) -> Pixels:
    if hasattr(message, "format"):
        picture = cv2.imdecode(message.data, cv2.IMREAD_UNCHANGED) if message.data.size else None
        if picture is None:
            raise RecordingError(f"{where}: holds a picture that cannot be decoded (format {message.format!r})")
        if picture.ndim != 2 or picture.dtype != np.uint8:
            raise _not_grey(where, f"{picture.shape} {picture.dtype}")
        return np.asarray(picture, np.uint8)
    if message.encoding not in GREY:
        raise _not_grey(where, shortened_name(message.encoding) or "of no encoding")
    if not message.data.size or message.data.size != message.height * message.step or message.step < message.width:
        raise RecordingError(f"{where}: holds a picture whose size is not as it says")
    return np.ascontiguousarray(message.data.reshape(message.height, message.step)[:, : message.width])


def _not_grey(where: str, what: str) -> RecordingError:
    return RecordingError(
        f"{where}: is {what}; must be 8-bit grey (mono8): bag the camera's mono image, as colours are mixed of several "
        "rows"
    )


def _lens(info: Any) -> Intrinsics | None:
    """None where the camera is not calibrated, which ROS says by zeros. Raises RecordingError for other lens models."""
    k, d = [float(number) for number in getattr(info, "k", getattr(info, "K", ()))], list(getattr(info, "d", ()))
    if not k or k[0] == 0:
        return None
    if info.distortion_model not in ("", "plumb_bob"):
        raise RecordingError(
            f"camera info: the lens model is {info.distortion_model}; must be plumb_bob: set camera.intrinsics instead"
        )
    k1, k2, p1, p2, k3 = ([float(number) for number in d] + [0.0] * 5)[:5]
    return Intrinsics(
        width=info.width, height=info.height, fx=k[0], fy=k[4], cx=k[2], cy=k[5], distortion=(k1, k2, p1, p2, k3)
    )


def import_video(config: Config, path: Path, out: Path, warn: Warn) -> Iterator[int]:
    """As `import_bag`. The pictures' times are the video's own. Raises LedpiError."""
    yield from _write(config, _of_video(path), path, out, warn)


def _of_video(path: Path) -> Iterator[Picture]:
    if not path.is_file():
        raise RecordingError(f"{path}: no such file")
    video = cv2.VideoCapture(str(path))
    if not video.isOpened():
        raise RecordingError(f"{path}: cannot be read as a video; is it whole? One that was cut off has no index")
    last_ns, period_ns = -1, round(1e9 / (video.get(cv2.CAP_PROP_FPS) or 30.0))
    try:
        while True:
            there, picture = video.read()
            if not there:
                return
            time_ns = round(video.get(cv2.CAP_PROP_POS_MSEC) * 1e6)
            last_ns = time_ns = time_ns if time_ns > last_ns else last_ns + period_ns
            grey = picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
            yield Picture(pixels=np.asarray(grey, np.uint8), time_ns=time_ns, lens=None)
    finally:
        video.release()


def _write(config: Config, pictures: Iterator[Picture], path: Path, out: Path, warn: Warn) -> Iterator[int]:
    """Writes them; what they do not say comes from the configuration."""
    first = next(pictures, None)
    if first is None:
        raise RecordingError(f"{path}: holds no pictures (sensor_msgs/Image or CompressedImage)")
    camera = _camera(config, first, path)
    if camera.intrinsics is None:
        warn(f"{path}: {NO_LENS}")
    panels, seq = config.panels, 0
    writer = RecordingWriter(
        out, camera=camera, dictionary=panels.dictionary, panel=panels.spec(), note=f"imported from {path.name}"
    )
    with writer:
        for picture in _with_first_picture(first, pictures):
            if picture.pixels.shape != (camera.height, camera.width):
                raise RecordingError(
                    f"{path}: holds pictures of several sizes; must be {camera.width} × {camera.height}"
                )
            writer.write(_frame(picture, camera, seq), wall_clock_offset_ns=0)
            seq += 1
            yield seq


def _with_first_picture(first: Picture, pictures: Iterator[Picture]) -> Iterator[Picture]:
    yield first
    yield from pictures


def _camera(config: Config, first: Picture, path: Path) -> CameraInfo:
    settings = config.camera
    if settings.row_time_us == "auto":
        raise ConfigError(
            f"{path}: does not say its row time: add --set camera.row_time_us=33.67 (OV5647; other cameras: "
            "docs/raspberry-pi.md#other-cameras), and camera.exposure_us"
        )
    height, width = first.pixels.shape
    camera = CameraInfo(
        width=width,
        height=height,
        exposure_us=settings.exposure_us,
        row_time_us=settings.row_time_us,
        transfer="srgb" if settings.transfer == "auto" else settings.transfer,
        intrinsics=first.lens,
    )
    return replace(camera, intrinsics=lens_of(camera, settings.intrinsics))


def _frame(picture: Picture, camera: CameraInfo, seq: int) -> Frame:
    return Frame(
        pixels=picture.pixels,
        seq=seq,
        row0_readout_ns=picture.time_ns,
        exposure_us=camera.exposure_us,
        row_time_us=camera.row_time_us,
        transfer=camera.transfer,
    )


def _check_new(out: Path) -> None:
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise RecordingError(f"{out}: is not empty; a recording needs a new or an empty folder")
