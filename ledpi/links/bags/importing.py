"""A bag, or a video, → a recording.

A bag of ours holds a recording, which comes back as it was. Of another one the grey pictures and the lens are taken;
what it does not say (row time, exposure, panels) the configuration must.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import chain
from pathlib import Path

from ledpi.camera.recording.writer import RecordingWriter
from ledpi.config.camera_yaml import lens_of
from ledpi.config.settings import Config
from ledpi.core.errors import ConfigError, RecordingError
from ledpi.core.records import CameraInfo, Frame
from ledpi.links.bags.contents import METADATA, memory_bounded
from ledpi.links.bags.own import restore_recording
from ledpi.links.bags.pictures import Picture, pictures_of_bag, pictures_of_video
from ledpi.links.bags.reading import Warn, messages

NO_LENS = "has no camera info: the recording has no lens, and gives IDs without poses; or set camera.intrinsics"


def import_bag(config: Config, path: Path, out: Path, topic: str | None, warn: Warn) -> Iterator[int]:
    """Writes the recording, and yields after each frame how many there are. Raises LedpiError."""
    with memory_bounded(path):
        items = messages(path, warn)
        first = next(items, None)
        if first is None:
            raise RecordingError(f"{path}: is empty: it holds no message")
        if first.topic == METADATA and not first.type:
            yield from restore_recording(first.read(), items, path, out)
        else:
            yield from _write(config, pictures_of_bag(chain([first], items), path, topic), path, out, warn)


def import_video(config: Config, path: Path, out: Path, warn: Warn) -> Iterator[int]:
    """As `import_bag`. The pictures' times are the video's own. Raises LedpiError."""
    with memory_bounded(path):
        yield from _write(config, pictures_of_video(path), path, out, warn)


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
        for picture in chain([first], pictures):
            if picture.pixels.shape != (camera.height, camera.width):
                raise RecordingError(
                    f"{path}: holds pictures of several sizes; must be {camera.width} × {camera.height}"
                )
            writer.write(_frame(picture, camera, seq), wall_clock_offset_ns=0)
            seq += 1
            yield seq


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
