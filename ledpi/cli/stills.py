"""The camera, panels and lens of a picture: what it says itself, else what the configuration says; --set overrides."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

if TYPE_CHECKING:
    from collections.abc import Sequence

    from ledpi.config.settings import Config
    from ledpi.core.records import CameraInfo, Intrinsics


class Still(NamedTuple):
    """All that decoding a picture needs beside its pixels."""

    camera: CameraInfo
    settings: Config
    lens: Intrinsics | None


def still_of(path: Path, config: Config, overrides: Sequence[str]) -> Still:
    """`config` with `overrides`, which are those of --set. Raises LedpiError."""
    from ledpi.config.camera_yaml import lens_of
    from ledpi.core.errors import RecordingError, TapError
    from ledpi.recording.overrides import camera_with
    from ledpi.recording.still import still_camera
    from ledpi.tap.frames import camera_of, settings_of

    told = _told(path)
    if told is None:
        camera = still_camera(config.camera)
        return Still(camera, config, lens_of(camera, config.camera.intrinsics))
    try:
        own = camera_of(told)
        panels = [item for item in overrides if item.startswith(("panels", "decode", "robot"))]
        settings = settings_of(told, panels).model_copy(update={"map": config.map})
    except TapError as error:
        raise RecordingError(f"{path}: what it says of its camera and panels cannot be used: {error}") from None
    camera = camera_with(config, own)
    return Still(camera, settings, camera.intrinsics)


def says_all(path: Path) -> bool:
    """Tells whether a picture needs no configuration."""
    return _told(path) is not None


def _told(path: Path) -> dict[str, Any] | None:
    """Returns what a picture says of itself; None also where it cannot be read, which whoever decodes it tells."""
    from ledpi.core.errors import RecordingError
    from ledpi.core.files import read_bytes
    from ledpi.recording.picture import MAX_BYTES
    from ledpi.recording.picture_text import text_of

    try:
        return text_of(read_bytes(path, RecordingError, MAX_BYTES))
    except RecordingError:
        return None
