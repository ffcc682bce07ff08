"""From a program's values to the decoder of its pictures. All values pass the configuration's own checks."""

from __future__ import annotations

import json
import re
from collections import Counter
from dataclasses import dataclass
from typing import Any, NamedTuple

from ledpi.api.fix import Fix, fix_of
from ledpi.api.marker import Marker, marker_of
from ledpi.api.picture import check_size
from ledpi.api.reason import Reason, reasons_of
from ledpi.config.panels import check_bands_visible
from ledpi.config.robot import load_robot
from ledpi.config.settings import Config, load_config
from ledpi.core.errors import ConfigError
from ledpi.core.records import Frame, Intrinsics, MarkerPose, Pixels
from ledpi.core.wording import shortened
from ledpi.pipeline.pipeline import Pipeline
from ledpi.recording.still import still_camera


class Read(NamedTuple):
    """The result of reading one picture."""

    markers: list[Marker]
    fix: Fix | None
    rejected: dict[str, int]  # how often each reason
    poses: tuple[MarkerPose, ...]  # the same as the markers, as the decoder has them


@dataclass(frozen=True, slots=True, kw_only=True)
class Panels:
    """The panels that a reader looks for, and the lens that it looks through."""

    overrides: tuple[str, ...]  # of the configuration, as --set takes them
    lens: Intrinsics | None

    def config(self, *further: str) -> Config:
        """Raises ConfigError, which begins with the argument's name, where a value cannot be."""
        try:
            return load_config(None, (*self.overrides, *further))
        except ConfigError as error:
            raise ConfigError(_OUR_KEYS.sub("", str(error), count=1)) from None

    def lens_for(self, picture: Pixels) -> Intrinsics | None:
        """Raises PictureError for a picture of another size than the lens's."""
        if self.lens is not None:
            check_size(picture, self.lens.width, self.lens.height, "the lens says")
        return self.lens


@dataclass(frozen=True, slots=True, kw_only=True)
class Exposure:
    """The exposure of a picture's rows."""

    row_time_us: float
    exposure_us: float

    def overrides(self) -> tuple[str, ...]:
        """As --set takes them."""
        return (override("camera.row_time_us", self.row_time_us), override("camera.exposure_us", self.exposure_us))


_OUR_KEYS = re.compile(r"^configuration: ((panels|camera|robot)\.|(?=odometry\.))")


class Decoder:
    """The path of pictures of one size and exposure. Raises ConfigError and PictureError where there is none."""

    def __init__(self, panels: Panels, exposure: Exposure, picture: Pixels, *, stream: bool) -> None:
        height, width = picture.shape
        size = (override("camera.width", width), override("camera.height", height))
        config = panels.config(*exposure.overrides(), *size)
        self._camera = still_camera(config.camera)
        self._lens = panels.lens_for(picture)
        robot = load_robot(config)
        self._pipeline = Pipeline(self._camera, config.panels, intrinsics=self._lens, robot=robot, stream=stream)

    def read(self, picture: Pixels, seq: int = 0, time_ns: int = 0) -> Read:
        """All that a picture gives."""
        decoded = self._pipeline.decode(self._frame(picture, seq, time_ns))
        reasons = Counter(rejected.key for rejected in decoded.rejected)
        markers = [marker_of(marker) for marker in decoded.markers]
        return Read(markers, fix_of(decoded.robot), dict(sorted(reasons.items())), decoded.markers)

    def why_not(self, picture: Pixels) -> list[Reason]:
        """Explains a picture that stands alone."""
        return reasons_of(self._frame(picture, 0, 0), self._camera, self._pipeline, self._lens)

    def _frame(self, picture: Pixels, seq: int, time_ns: int) -> Frame:
        camera = self._camera
        check_size(picture, camera.width, camera.height, "the stream began")
        return Frame(
            pixels=picture,
            seq=seq,
            row0_readout_ns=time_ns,
            exposure_us=camera.exposure_us,
            row_time_us=camera.row_time_us,
            transfer=camera.transfer,
        )


def check_exposure(panels: Panels, exposure: Exposure) -> None:
    """Raises ConfigError where no camera exposes so, or no picture would show how the panels blink."""
    for name, value in (("row_time_us", exposure.row_time_us), ("exposure_us", exposure.exposure_us)):
        if isinstance(value, str):
            raise ConfigError(f"{name}: must be a number of microseconds, not {shortened(value)}")
    config = panels.config(*exposure.overrides())
    if exposure.exposure_us < exposure.row_time_us:
        raise ConfigError(
            f"exposure_us: must be at least row_time_us, {exposure.row_time_us:g} (sensors expose for whole rows), "
            f"not {exposure.exposure_us:g} (10 ms are 10000)"
        )
    check_bands_visible(config.panels, exposure.row_time_us, "row_time_us")


def override(key: str, value: object) -> str:
    """As --set takes it: JSON is YAML."""
    return f"{key}={json.dumps(value, default=_plain)}"


def _plain(value: Any) -> object:
    """numpy's numbers and arrays; paths."""
    tolist = getattr(value, "tolist", None)
    return tolist() if tolist is not None else str(value)
