"""From a program's values to the decoder of its pictures. All values pass the configuration's own checks."""

from __future__ import annotations

import json
import re
import threading
from collections import Counter
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from ledpi.camera.base import frame_by
from ledpi.camera.recording.picture import still_camera
from ledpi.config.panels import check_bands_visible
from ledpi.config.settings import Config, load_config
from ledpi.core.errors import ConfigError, PictureError
from ledpi.core.records import CameraInfo, Floats, Frame, Intrinsics, MarkerPose, Pixels
from ledpi.core.wording import shortened
from ledpi.pipeline.api.lens import Body, Fix, Marker, body_of, fix_of, marker_of
from ledpi.pipeline.diagnosis.diagnose import not_read_in
from ledpi.pipeline.diagnosis.why_not import WhyNot
from ledpi.pipeline.pipeline import Pipeline, load_robot
from ledpi.pipeline.trace import Trace

# What programs have: cv2.imread gives None where it cannot read a file, and its stubs know no dtype.
Image: TypeAlias = "NDArray[Any] | None"
_GREY = "must be grey, (height, width) uint8"
_OUR_KEYS = re.compile(r"^configuration: ((panels|camera|robot)\.|(?=(odometry|bodies)\.))")


def checked_picture(image: object) -> Pixels:
    """The picture as a view: nothing is copied, and the caller's own array stays writable.

    Raises PictureError for anything but (height, width) uint8. Colours are not mixed here: which channel comes
    first, nothing tells.
    """
    if not isinstance(image, np.ndarray):
        nothing = "; cv2.imread and others return None where they cannot read a file" if image is None else ""
        raise PictureError(f"image: {_GREY}, as a numpy array, not {type(image).__name__}{nothing}")
    if image.ndim == 3:
        raise PictureError(
            f"image: {_GREY}, not {_shape(image)} {image.dtype}: of colours take the grey, as by "
            "cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)"
        )
    if image.ndim != 2 or image.dtype != np.uint8:
        raise PictureError(f"image: {_GREY}, not {_shape(image)} {image.dtype}")
    return image.view(np.ndarray)


def check_size(picture: Pixels, width: int, height: int, because: str) -> None:
    """Raises PictureError where the picture is not so large. `because`: who says that it should be."""
    if picture.shape == (height, width):
        return
    has_chroma = picture.shape == (height * 3 // 2, width)
    below = f": below its grey rows are YUV420's colours; give image[:{height}]" if has_chroma else ""
    raise PictureError(
        f"image: must be {width} × {height} pixels, as {because}, not {picture.shape[1]} × {picture.shape[0]}{below}"
    )


class OneAtATime:
    """Guards what is not to be shared between threads: `with` it, two calls at once raise PictureError."""

    def __init__(self, what: str) -> None:
        self._what, self._lock = what, threading.Lock()

    def __enter__(self) -> None:
        if not self._lock.acquire(blocking=False):
            raise PictureError(f"this {self._what} is in use by another thread; make one for each thread")

    def __exit__(self, *_: object) -> None:
        self._lock.release()


def _shape(image: np.ndarray[tuple[int, ...], np.dtype[np.generic]]) -> str:
    return f"({', '.join(map(str, image.shape))})"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Reason:
    """Something that looks like a panel and is not reported, or what the whole picture lacks."""

    says: str  # what is wrong, as in "looks like ID 11 mirrored"
    helps: str  # what helps; "" where nothing is to be done
    is_panel: bool  # whether it surely is a panel, or the picture itself; else it may be a lamp
    corners_px: Floats | None  # (4, 2) clockwise; None for the whole picture


def reasons_of(frame: Frame, camera: CameraInfo, pipeline: Pipeline, lens: Intrinsics | None) -> list[Reason]:
    """Decodes the frame once more, and under other assumptions. Takes a second or two."""
    trace = Trace()
    read_px = [marker.detection.corners_px for marker in pipeline.decode(frame, trace).markers]
    why = WhyNot(camera, pipeline.panels, lens).explain(frame, not_read_in(trace), read_px)
    found = [
        Reason(says=one.says, helps=one.helps, is_panel=one.kind == "panel", corners_px=one.corners_px)
        for one in why.told
    ]
    return found + [Reason(says=note.says, helps=note.helps, is_panel=True, corners_px=None) for note in why.notes]


class Read(NamedTuple):
    """The result of reading one picture."""

    markers: list[Marker]
    fix: Fix | None
    bodies: dict[str, Body]  # by name
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
        bodies = {body.name: body_of(body) for body in decoded.bodies}
        return Read(markers, fix_of(decoded.robot), bodies, dict(sorted(reasons.items())), decoded.markers)

    def why_not(self, picture: Pixels) -> list[Reason]:
        """Explains a picture that stands alone."""
        return reasons_of(self._frame(picture, 0, 0), self._camera, self._pipeline, self._lens)

    def _frame(self, picture: Pixels, seq: int, time_ns: int) -> Frame:
        camera = self._camera
        check_size(picture, camera.width, camera.height, "the stream began")
        return frame_by(camera, picture, seq, time_ns)


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
