"""From a program's values to the decoder of its pictures. All values pass the configuration's own checks."""

from __future__ import annotations

import json
from collections import Counter
from dataclasses import dataclass
from typing import Any

from ledpi.api.marker import Marker, marker_of
from ledpi.api.picture import check_size
from ledpi.config.panels import check_bands_visible
from ledpi.config.settings import Config, load_config
from ledpi.core.records import Frame, Intrinsics, Pixels
from ledpi.pipeline.pipeline import Pipeline
from ledpi.recording.still import still_camera


@dataclass(frozen=True, slots=True, kw_only=True)
class Panels:
    """What a reader looks for, and through which lens."""

    overrides: tuple[str, ...]  # of the configuration, as --set takes them
    lens: Intrinsics | None

    def config(self, *further: str) -> Config:
        """Raises ConfigError where a value cannot be."""
        return load_config(None, (*self.overrides, *further))

    def lens_for(self, picture: Pixels) -> Intrinsics | None:
        """Raises PictureError for a picture of another size than the lens's."""
        if self.lens is not None:
            check_size(picture, self.lens.width, self.lens.height, "the lens says")
        return self.lens


@dataclass(frozen=True, slots=True, kw_only=True)
class Exposure:
    """How the rows of a picture were exposed."""

    row_time_us: float
    exposure_us: float

    def overrides(self) -> tuple[str, ...]:
        """As --set takes them."""
        return (override("camera.row_time_us", self.row_time_us), override("camera.exposure_us", self.exposure_us))


class Decoder:
    """The path of pictures of one size and exposure. Raises ConfigError and PictureError where there is none."""

    def __init__(self, panels: Panels, exposure: Exposure, picture: Pixels, *, stream: bool) -> None:
        height, width = picture.shape
        size = (override("camera.width", width), override("camera.height", height))
        config = panels.config(*exposure.overrides(), *size)
        self._camera = still_camera(config.camera)
        lens = panels.lens_for(picture)
        self._pipeline = Pipeline(self._camera, config.panels, intrinsics=lens, stream=stream)

    def read(self, picture: Pixels, seq: int = 0, time_ns: int = 0) -> tuple[list[Marker], dict[str, int]]:
        """The markers, and how often each reason for a rejection."""
        camera = self._camera
        check_size(picture, camera.width, camera.height, "the stream began")
        frame = Frame(
            pixels=picture,
            seq=seq,
            row0_readout_ns=time_ns,
            exposure_us=camera.exposure_us,
            row_time_us=camera.row_time_us,
            transfer=camera.transfer,
        )
        decoded = self._pipeline.decode(frame)
        reasons = Counter(rejected.key for rejected in decoded.rejected)
        return [marker_of(marker) for marker in decoded.markers], dict(sorted(reasons.items()))


def check_exposure(panels: Panels, exposure: Exposure) -> None:
    """Raises ConfigError where no camera exposes so, or no picture would show how the panels blink."""
    check_bands_visible(panels.config(*exposure.overrides()).panels, exposure.row_time_us, "row_time_us")


def override(key: str, value: object) -> str:
    """As --set takes it: JSON is YAML."""
    return f"{key}={json.dumps(value, default=_plain)}"


def _plain(value: Any) -> object:
    """numpy's numbers and arrays; paths."""
    tolist = getattr(value, "tolist", None)
    return tolist() if tolist is not None else str(value)
