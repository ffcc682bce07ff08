"""Pictures: what they say of themselves, and drawn ones to files, whole or not at all."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import cv2

from ledpi.camera.recorded import camera_with
from ledpi.camera.recording.picture import MAX_BYTES, still_camera, text_of
from ledpi.config.camera_yaml import lens_of
from ledpi.config.settings import Config
from ledpi.core.errors import ConfigError, RecordingError, TapError, raising
from ledpi.core.files import not_written, put_in_place, read_bytes, write_beside
from ledpi.core.records import CameraInfo, Intrinsics, Pixels
from ledpi.daemon.tap.frames import camera_of, settings_of


class Still(NamedTuple):
    """All that decoding a picture needs beside its pixels."""

    camera: CameraInfo
    settings: Config
    lens: Intrinsics | None


def still_of(path: Path, config: Config, overrides: Sequence[str]) -> Still:
    """`config` with `overrides`, which are those of --set. Raises LedpiError."""
    told = _told(path)
    if told is None:
        camera = still_camera(config.camera)
        return Still(camera, config, lens_of(camera, config.camera.intrinsics))
    with raising(f"{path}: what it says of its camera and panels cannot be used", RecordingError, TapError):
        own = camera_of(told)
        panels = [item for item in overrides if item.startswith(("panels", "decode", "robot"))]
        settings = settings_of(told, panels).model_copy(update={"map": config.map, "bodies": config.bodies})
    camera = camera_with(config, own)
    return Still(camera, settings, camera.intrinsics)


def says_all(path: Path) -> bool:
    """Tells whether a picture needs no configuration."""
    return _told(path) is not None


def _told(path: Path) -> dict[str, Any] | None:
    """Returns what a picture says of itself; None also where it cannot be read, which whoever decodes it tells."""
    try:
        return text_of(read_bytes(path, RecordingError, MAX_BYTES))
    except RecordingError:
        return None


def check_apart(folder: Path, pictures: Iterable[Path], option: str) -> None:
    """Raises ConfigError where drawings in `folder` would lie among the `pictures`, whose names they may have."""
    if folder.resolve() in {parent.resolve() for parent in {path.parent for path in pictures}}:
        raise ConfigError(f"{option} {folder}: holds the pictures that are read; must be another folder")


def write_drawn(path: Path, drawn: Pixels, option: str) -> None:
    """Encodes as the suffix says, whole or not at all. Raises RecordingError, which names the `option` of the path."""
    data = cv2.imencode(path.suffix.lower(), drawn)[1]
    try:
        put_in_place(write_beside(path, data.tobytes()), path)
    except OSError as error:
        raise not_written(path, error, RecordingError, f"{option} {path}") from None
