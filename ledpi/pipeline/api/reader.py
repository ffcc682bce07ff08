"""Reads panels in pictures that each stand alone, and in those of one camera, one after another."""

from __future__ import annotations

import operator
from collections.abc import Mapping, Sequence
from functools import lru_cache
from itertools import islice
from os import PathLike, fspath
from pathlib import Path
from typing import Any

import numpy as np

from ledpi.config.camera_yaml import load_intrinsics
from ledpi.config.check import load_own_map
from ledpi.config.panels import PanelSettings
from ledpi.core.errors import ConfigError, PictureError, shortened
from ledpi.core.records import Intrinsics, Phase, Pixels, RowsFrom, Transfer
from ledpi.pipeline.api.exposed import (
    Decoder,
    Exposure,
    Image,
    OneAtATime,
    Panels,
    Read,
    Reason,
    check_exposure,
    checked_picture,
    override,
)
from ledpi.pipeline.api.lens import Body, Fix, Lens, Marker
from ledpi.pipeline.api.state import State, Whereabouts, whole_ns
from ledpi.pipeline.diagnosis.drawing import DIMMED, Placed, draw_markers

MOST_IDS = 1 << 16  # a packet has two bytes for one
EXPOSURE_US = 10_000.0  # where a program does not say: the configuration's default


def drawn(panels: Panels, picture: Pixels, markers: Sequence[Marker]) -> Pixels:
    """(height, width, 3), blue, green, red, as OpenCV shows and writes it: cells, outline, axes and ID of each."""
    settings, lens = _settings(panels), panels.lens_for(picture)
    words = settings.words
    canvas = np.repeat((picture * DIMMED).astype(np.uint8)[..., None], 3, axis=2)
    placed = [
        Placed(
            marker_id=marker.id,
            corners_px=marker.corners_px,
            word=words.codeword(marker.id),
            side_m=settings.spec(marker.id).side_m,
            position_m=marker.position_m,
            quaternion_wxyz=marker.quaternion_wxyz,
        )
        for marker in markers
    ]
    draw_markers(canvas, placed, lens)
    return canvas


@lru_cache(maxsize=8)
def _settings(panels: Panels) -> PanelSettings:
    """Kept, as making them takes longer than the drawing."""
    return panels.config().panels


class _Reading:
    """A reader or a stream: the panels that it looks for, and what the last picture gave."""

    def __init__(self, panels: Panels, what: str) -> None:
        self._panels, self._guard = panels, OneAtATime(what)
        self._read: Read | None = None

    @property
    def rejected(self) -> dict[str, int]:
        """Counts what in the last picture was no marker, by its reason of docs/troubleshooting.md."""
        return {} if self._read is None else dict(self._read.rejected)

    @property
    def fix(self) -> Fix | None:
        """Tells where the robot is by the last picture; None where that does not say, or there is no map."""
        return None if self._read is None else self._read.fix

    @property
    def bodies(self) -> dict[str, Body]:
        """Tells where the bodies are that the last picture shows, by name."""
        return {} if self._read is None else dict(self._read.bodies)

    def draw(self, image: Image, markers: Sequence[Marker]) -> Pixels:
        """The picture in colour (blue, green, red), with cells, axes and ID of each of its markers.

        `markers` are those that `read` gave for this picture. Raises PictureError as `read` does.
        """
        return drawn(self._panels, checked_picture(image), markers)


class Stream(_Reading):
    """Remembers the panels of earlier pictures. Made by `Reader.stream`; not shared between threads."""

    def __init__(self, panels: Panels, exposure: Exposure) -> None:
        super().__init__(panels, "stream")
        self._exposure = exposure
        self._decoder: Decoder | None = None  # of the first picture's size
        self._seq = 0
        self._last_ns: int | None = None
        self._whereabouts = Whereabouts(panels.config())

    def read(self, image: Image, *, time_ns: int) -> list[Marker]:
        """The markers in the next picture, the surest first.

        `image` is as for `Reader.read`. `time_ns` is when row 0's read-out began, in nanoseconds of any one clock, as
        exact as the camera tells it: to 20 µs, as the panels' blinking is followed from picture to picture. Pictures
        may be left out; after half a second without one, all begins anew.

        Raises PictureError, a ValueError, for another picture, another size than the first one's or the lens's, or a
        time that is not after the one before; the stream goes on as if there had been none. So does
        another thread that calls it meanwhile.
        """
        with self._guard:
            return self._next(image, time_ns)

    def add_odometry(
        self,
        *,
        time_ns: int,
        left_m: float | None = None,
        right_m: float | None = None,
        yaw_rad: float | None = None,
        restarted: bool = False,
        lifted: bool = False,
        slipping: bool = False,
    ) -> str | None:
        """Takes how the robot moved: totals that run on, of each wheel's way ahead, and of a gyro's angle to the left.

        `time_ns` is on the clock of the pictures; up to 2 s late, in any order. `restarted`: the totals begin anew;
        `lifted`: the robot may be anywhere; `slipping`: the wheels tell nothing since the message before. Returns why
        it is not used, a reason of docs/troubleshooting.md. Raises PictureError for what is no number.
        """
        with self._guard:
            totals = {"left_m": left_m, "right_m": right_m, "yaw_rad": yaw_rad}
            flags = {"restarted": restarted, "lifted": lifted, "slipping": slipping}
            return self._whereabouts.add_odometry(time_ns, totals, flags)

    def state(self, time_ns: int) -> State | None:
        """Tells where the robot is at a time, between pictures, too; None where that is not known, or without a map."""
        with self._guard:
            return self._whereabouts.at(time_ns)

    def _next(self, image: Image, time_ns: int) -> list[Marker]:
        picture = checked_picture(image)
        time_ns = whole_ns(time_ns)
        if self._last_ns is not None and time_ns <= self._last_ns:
            raise PictureError(f"time_ns: must be after the picture's before, {self._last_ns}, not {time_ns}")
        if self._decoder is None:
            self._decoder = Decoder(self._panels, self._exposure, picture, stream=True)
        self._read = self._decoder.read(picture, self._seq, time_ns)
        self._seq, self._last_ns = self._seq + 1, time_ns
        self._whereabouts.add_markers(self._read.poses)
        return list(self._read.markers)


class Reader(_Reading):
    """Knows the panels and the lens. Not shared between threads.

    `side_m` is the outer edge of the lit grid, in metres. `lens` is the path of a camera.yaml, ours or another tool's,
    a `Lens`, or None: then there are IDs and corners, but no poses. `transfer` is the camera's tone: "srgb" as most
    deliver it, "linear" as `ledpi run` sets the Pi's. `overrides` by ID: panels that differ, as {7: {"side_m": 0.3}}.
    `map` is the path of a markers.yaml; with it and a lens `fix` says where the robot is, and `camera_mount` how the
    camera sits on it. A stream's `state` says it between pictures, too, by `odometry`: {"base_m": 0.3}, between the
    wheels, where there is no gyro. `bodies`, as {"dock": {7: {"position_m": [0, 0, 0], "yaw_deg": 0}}}: what else
    carries panels, and how; then `bodies` says where it is. All others are as the configuration's keys of these names.

    Raises ConfigError, which begins with the argument's name, where a value cannot be, CalibrationError where the
    lens's file cannot be used.

    >>> Reader(side_m=160)  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    ledpi.core.errors.ConfigError: side_m: must be in metres, ...
    """

    def __init__(
        self,
        *,
        side_m: float,
        lens: str | PathLike[str] | Lens | None = None,
        dictionary: str = "DICT_4X4_50",
        black_hz: float = 1250.0,
        white_hz: float = 2450.0,
        duty: float = 0.5,
        phase: Phase = "free",
        ids: Sequence[int] | None = None,
        overrides: Mapping[int, Mapping[str, Any]] | None = None,
        upright: bool = False,
        map: str | PathLike[str] | None = None,
        bodies: Mapping[str, Mapping[int, Mapping[str, Any]]] | None = None,
        camera_mount: Mapping[str, Sequence[float]] | None = None,
        odometry: Mapping[str, Any] | None = None,
        transfer: Transfer = "srgb",
        rows_from: RowsFrom = "above",
    ) -> None:
        values = (
            override("panels.side_m", side_m),
            override("panels.dictionary", dictionary),
            override("panels.black_hz", black_hz),
            override("panels.white_hz", white_hz),
            override("panels.duty", duty),
            override("panels.phase", phase),
            override("panels.ids", _whole_numbers("ids", ids)),
            override("panels.overrides", _mapping("overrides", overrides, '{7: {"side_m": 0.3}}')),
            override("panels.upright", upright),
            override("map", None if map is None else fspath(_path("map", map))),
            override("bodies", _mapping("bodies", bodies, '{"dock": {7: {"position_m": [0, 0, 0], "yaw_deg": 0}}}')),
            override("robot.camera_mount", _mapping("camera_mount", camera_mount, '{"rpy_deg": [0, -90, 0]}')),
            override("odometry", _mapping("odometry", odometry, '{"base_m": 0.3}')),
            override("camera.transfer", transfer),
            override("camera.rows_from", rows_from),
        )
        super().__init__(Panels(overrides=values, lens=_intrinsics(lens)), "reader")
        load_own_map(self._panels.config())  # checked here, where they are given
        self._decoder: tuple[object, Decoder] | None = None  # of the last picture's kind

    def read(self, image: Image, *, row_time_us: float, exposure_us: float = EXPOSURE_US) -> list[Marker]:
        """The markers in one picture, by itself, the surest first.

        `image`: (height, width) uint8, grey, its rows as the sensor exposed them: not scaled or rectified, and turned
        by 180° only where `rows_from` says so. It is neither kept nor changed. `row_time_us` is between the starts of
        two rows, `exposure_us` how long a row is exposed. Markers' times count from the start of row 0's read-out.

        Raises PictureError, a ValueError, for another picture or another size than the lens's, ConfigError for a time
        that no camera has. Another thread that calls it meanwhile gets a PictureError, too.
        """
        with self._guard:
            picture = checked_picture(image)
            self._read = self._decoder_of(picture, row_time_us, exposure_us).read(picture)
            return list(self._read.markers)

    def why_not(self, image: Image, *, row_time_us: float, exposure_us: float = EXPOSURE_US) -> list[Reason]:
        """Explains what looks like a panel and is not reported, panels first; a second's work. Else as `read`."""
        with self._guard:
            picture = checked_picture(image)
            return self._decoder_of(picture, row_time_us, exposure_us).why_not(picture)

    def _decoder_of(self, picture: Pixels, row_time_us: float, exposure_us: float) -> Decoder:
        kind = (picture.shape, row_time_us, exposure_us)
        if self._decoder is None or self._decoder[0] != kind:
            exposure = Exposure(row_time_us=row_time_us, exposure_us=exposure_us)
            check_exposure(self._panels, exposure)
            self._decoder = kind, Decoder(self._panels, exposure, picture, stream=False)
        return self._decoder[1]

    def stream(self, *, row_time_us: float, exposure_us: float = EXPOSURE_US) -> Stream:
        """For one camera's pictures, in order: they add up, and read further. Raises ConfigError for times of none."""
        exposure = Exposure(row_time_us=row_time_us, exposure_us=exposure_us)
        check_exposure(self._panels, exposure)
        return Stream(self._panels, exposure)


def _intrinsics(lens: str | PathLike[str] | Lens | None) -> Intrinsics | None:
    if lens is None or isinstance(lens, Lens):
        return None if lens is None else lens.intrinsics()
    return load_intrinsics(_path("lens", lens).expanduser())


def _path(name: str, value: object) -> Path:
    if isinstance(value, (str, PathLike)):
        return Path(value)
    raise ConfigError(f"{name}: must be a path, not {shortened(value)}")


def _mapping(name: str, value: object, example: str) -> dict[Any, Any]:
    if value is None:
        return {}
    if isinstance(value, Mapping):
        return {key: dict(of) if isinstance(of, Mapping) else of for key, of in value.items()}
    raise ConfigError(f"{name}: must be as {example}, not {shortened(value)}")


def _whole_numbers(name: str, values: Sequence[int] | None) -> list[int] | None:
    """Refuses text: of "23" each digit would be an ID."""
    if values is None:
        return None
    try:
        if not isinstance(values, (str, bytes)):
            numbers = [operator.index(value) for value in islice(values, MOST_IDS + 1)]
            if len(numbers) > MOST_IDS:
                raise ConfigError(f"{name}: no dictionary has more than {MOST_IDS} IDs")
            return numbers
    except TypeError:
        pass
    raise ConfigError(f"{name}: must be whole numbers, as [7, 23], not {shortened(values)}")
