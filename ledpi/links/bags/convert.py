"""A recording → a bag, with what `ledpi decode` gives for it; and a bag, or a video, → a recording.

A bag of ours holds a recording, which comes back as it was. Of another one the grey pictures and the lens are taken;
what it does not say (row time, exposure, panels) the configuration must.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import chain
from pathlib import Path

import cv2
import numpy as np

from ledpi.camera.base import frame_by
from ledpi.camera.recording.format import FRAMES_FILE, HEADER_FILE, MAX_LINES_BYTES, TRUTH_FILE
from ledpi.camera.recording.picture import MAX_BYTES
from ledpi.camera.recording.writer import RecordingWriter
from ledpi.config.camera_yaml import lens_of
from ledpi.config.settings import Config
from ledpi.config.values import MAX_SIDE_PX
from ledpi.core.errors import ConfigError, RecordingError
from ledpi.core.files import nothing_left, read_bytes, read_text
from ledpi.core.records import CameraInfo, Intrinsics, Pixels
from ledpi.links.bags import contents
from ledpi.links.bags.bag_writer import BagWriter
from ledpi.links.bags.own import restore_recording
from ledpi.links.bags.reading import Item, messages
from ledpi.links.bags.replay import Replay, Warn
from ledpi.links.ros.contents import CAMERA_INFO, COMPRESSED_IMAGE
from ledpi.wire.diary import DIARY_FILE

IMAGES = {"sensor_msgs/msg/Image", COMPRESSED_IMAGE}


@dataclass(frozen=True, slots=True, kw_only=True)
class Picture:
    """One picture of somebody else's, and the lens where it is known."""

    pixels: Pixels  # (H, W)
    time_ns: int
    lens: Intrinsics | None


def pictures_of_bag(items: Iterator[Item], path: Path, topic: str | None) -> Iterator[Picture]:
    """Yields those of one topic. The lens is the last that was told before the first picture."""
    seen: set[str] = set()
    infos: dict[str, contents.Info] = {}
    last_ns: int | None = None
    for item in items:
        if item.type == CAMERA_INFO and last_ns is None:
            infos[item.topic] = contents.checked(contents.Info, item.read(), f"{path}: {item.topic}")
        if item.type not in IMAGES:
            continue
        seen.add(item.topic)
        if topic is None and len(seen) > 1:
            raise RecordingError(f"{path}: has pictures on several topics; --topic {' or '.join(sorted(seen))}")
        if topic is None or item.topic == topic:
            picture = _picture(item, {} if last_ns is not None else infos, path)
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


def _picture(item: Item, infos: Mapping[str, contents.Info], path: Path) -> Picture:
    message, where = item.read(), f"{path}: {item.topic}"
    if item.type == COMPRESSED_IMAGE:
        coded = contents.checked(contents.Compressed, message, where)
        stamp, pixels = coded.header.stamp, contents.luma_of_compressed(coded, where)
    else:
        image = contents.checked(contents.Image, message, where)
        stamp, pixels = image.header.stamp, contents.luma_of_image(image, where)
    return Picture(pixels=pixels, time_ns=stamp.time_ns, lens=_lens(item.topic, infos, pixels, path))


def _lens(topic: str, infos: Mapping[str, contents.Info], pixels: Pixels, path: Path) -> Intrinsics | None:
    """That of the topic's own camera (`/cam/image_raw` and `/cam/camera_info`); of a single other one, where it is."""
    own = [name for name in infos if name.count("/") > 1 and topic.startswith(name.rpartition("/")[0] + "/")]
    names = sorted(own, key=len)[-1:] or (list(infos) if len(infos) == 1 else [])
    height, width = pixels.shape
    return next((contents.lens_of_info(infos[name], width, height, f"{path}: {name}") for name in names), None)


def pictures_of_video(path: Path) -> Iterator[Picture]:
    """Yields them with the video's own times. Raises RecordingError."""
    if not path.is_file():
        raise RecordingError(f"{path}: no such file")
    with contents.libraries_silent():
        video = cv2.VideoCapture(str(path))
    if not video.isOpened():
        raise RecordingError(f"{path}: cannot be read as a video; is it whole? One that was cut off has no index")
    video.set(cv2.CAP_PROP_ORIENTATION_AUTO, 0)  # rows as the sensor read them, however the phone was held
    if max(video.get(cv2.CAP_PROP_FRAME_WIDTH), video.get(cv2.CAP_PROP_FRAME_HEIGHT)) > MAX_SIDE_PX:
        raise RecordingError(f"{path}: has pictures of more than {MAX_SIDE_PX} pixels a side; must be smaller")
    rate_hz = video.get(cv2.CAP_PROP_FPS)
    last_ns, period_ns = -1, round(1e9 / (rate_hz if 0.001 < rate_hz < 1e6 else 30.0))
    try:
        while True:
            with contents.libraries_silent():
                there, picture = video.read()
            if not there:
                return
            at_ms = video.get(cv2.CAP_PROP_POS_MSEC)
            time_ns = round(at_ms * 1e6) if math.isfinite(at_ms) else -1
            last_ns = time_ns = time_ns if time_ns > last_ns else last_ns + period_ns
            grey = picture if picture.ndim == 2 else cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
            yield Picture(pixels=np.asarray(grey, np.uint8), time_ns=time_ns, lens=None)
    finally:
        video.release()


NO_CLOCK = "does not say when it was taken (wall_clock_offset_ns): the bag's times begin in 1970"


def export_bag(replay: Replay, out: Path, warn: Warn) -> Iterator[None]:
    """Writes it, and yields after each frame. Raises LedpiError; where the disk is full, nothing is left of it."""
    recording = replay.recording
    lines, truth = (_lines(recording.folder / name) for name in (FRAMES_FILE, TRUTH_FILE))
    offset_ns, diary = recording.wall_clock_offset_ns, recording.folder / DIARY_FILE
    if offset_ns is None:
        warn(f"{recording.folder}: {NO_CLOCK}")
    with (
        nothing_left(out),
        BagWriter(
            out,
            camera=recording.camera,
            dictionary=recording.dictionary,
            panel=recording.panel,
            header=read_text(recording.folder / HEADER_FILE, RecordingError),
            diary=read_text(diary, RecordingError, MAX_LINES_BYTES) if diary.exists() else None,
        ) as bag,
    ):
        for entry, frame, decoded in replay.frames(warn):
            bag.write_line(frame, lines[entry.seq], read_bytes(entry.picture, RecordingError, MAX_BYTES), offset_ns)
            bag.write_live(frame, decoded)
            if entry.seq in truth:
                bag.write_truth(frame, truth[entry.seq])
            yield


def _lines(path: Path) -> dict[int, str]:
    """By seq, as they stand there; a last one that is cut off is left out."""
    if not path.exists():
        return {}
    found = {}
    for text in read_text(path, RecordingError, MAX_LINES_BYTES).split("\n"):
        try:
            found[int(json.loads(text)["seq"])] = text
        except ValueError:
            continue
    return found


NO_LENS = "has no camera info: the recording has no lens, and gives IDs without poses; or set camera.intrinsics"


def import_bag(config: Config, path: Path, out: Path, topic: str | None, warn: Warn) -> Iterator[int]:
    """Writes the recording, and yields after each frame how many there are. Raises LedpiError."""
    with contents.memory_bounded(path):
        items = messages(path, warn)
        first = next(items, None)
        if first is None:
            raise RecordingError(f"{path}: is empty: it holds no message")
        if first.topic == contents.METADATA and not first.type:
            yield from restore_recording(first.read(), items, path, out)
        else:
            yield from _write(config, pictures_of_bag(chain([first], items), path, topic), path, out, warn)


def import_video(config: Config, path: Path, out: Path, warn: Warn) -> Iterator[int]:
    """As `import_bag`. The pictures' times are the video's own. Raises LedpiError."""
    with contents.memory_bounded(path):
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
            writer.write(frame_by(camera, picture.pixels, seq, picture.time_ns), wall_clock_offset_ns=0)
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
