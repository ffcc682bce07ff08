"""The grey pictures of somebody else's bag or video, with their times and the lens."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from ledpi.config.values import MAX_SIDE_PX
from ledpi.core.errors import RecordingError
from ledpi.core.records import Intrinsics, Pixels
from ledpi.links.bags.contents import (
    Compressed,
    Image,
    Info,
    checked,
    lens_of_info,
    libraries_silent,
    luma_of_compressed,
    luma_of_image,
)
from ledpi.links.bags.reading import Item
from ledpi.links.ros.contents import CAMERA_INFO, COMPRESSED_IMAGE

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
    infos: dict[str, Info] = {}
    last_ns: int | None = None
    for item in items:
        if item.type == CAMERA_INFO and last_ns is None:
            infos[item.topic] = checked(Info, item.read(), f"{path}: {item.topic}")
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


def _picture(item: Item, infos: Mapping[str, Info], path: Path) -> Picture:
    message, where = item.read(), f"{path}: {item.topic}"
    if item.type == COMPRESSED_IMAGE:
        coded = checked(Compressed, message, where)
        stamp, pixels = coded.header.stamp, luma_of_compressed(coded, where)
    else:
        image = checked(Image, message, where)
        stamp, pixels = image.header.stamp, luma_of_image(image, where)
    return Picture(pixels=pixels, time_ns=stamp.time_ns, lens=_lens(item.topic, infos, pixels, path))


def _lens(topic: str, infos: Mapping[str, Info], pixels: Pixels, path: Path) -> Intrinsics | None:
    """That of the topic's own camera (`/cam/image_raw` and `/cam/camera_info`); of a single other one, where it is."""
    own = [name for name in infos if name.count("/") > 1 and topic.startswith(name.rpartition("/")[0] + "/")]
    names = sorted(own, key=len)[-1:] or (list(infos) if len(infos) == 1 else [])
    height, width = pixels.shape
    return next((lens_of_info(infos[name], width, height, f"{path}: {name}") for name in names), None)


def pictures_of_video(path: Path) -> Iterator[Picture]:
    """Yields them with the video's own times. Raises RecordingError."""
    if not path.is_file():
        raise RecordingError(f"{path}: no such file")
    with libraries_silent():
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
            with libraries_silent():
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
