"""Reads panels in pictures that each stand alone."""

from __future__ import annotations

import operator
from collections.abc import Mapping, Sequence
from os import PathLike, fspath
from pathlib import Path
from typing import Any

from ledpi.api.drawn import drawn
from ledpi.api.exposed import Decoder, Exposure, Panels, Read, check_exposure, override
from ledpi.api.fix import Fix
from ledpi.api.lens import Lens
from ledpi.api.marker import Marker
from ledpi.api.picture import Image, OneAtATime, checked_picture
from ledpi.api.reason import Reason
from ledpi.api.stream import Stream
from ledpi.config.camera_yaml import load_intrinsics
from ledpi.config.robot import load_robot
from ledpi.core.errors import ConfigError
from ledpi.core.records import Intrinsics, Phase, Pixels, RowsFrom, Transfer
from ledpi.core.wording import shortened

EXPOSURE_US = 10_000.0  # where a program does not say: the configuration's default


class Reader:
    """Knows the panels and the lens. Not shared between threads.

    `side_m` is the outer edge of the lit grid, in metres. `lens` is the path of a camera.yaml, ours or another tool's,
    a `Lens`, or None: then there are IDs and corners, but no poses. `transfer` is the camera's tone: "srgb" as most
    deliver it, "linear" as `ledpi run` sets the Pi's. `overrides` by ID: panels that differ, as {7: {"side_m": 0.3}}.
    `map` is the path of a markers.yaml; with it and a lens `fix` says where the robot is, and `camera_mount` how the
    camera sits on it. A stream's `state` says it between pictures, too, by `odometry`: {"base_m": 0.3}, between the
    wheels, where there is no gyro. All others are as the configuration's keys of these names.

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
            override("robot.camera_mount", _mapping("camera_mount", camera_mount, '{"rpy_deg": [0, -90, 0]}')),
            override("odometry", _mapping("odometry", odometry, '{"base_m": 0.3}')),
            override("camera.transfer", transfer),
            override("camera.rows_from", rows_from),
        )
        self._panels = Panels(overrides=values, lens=_intrinsics(lens))
        load_robot(self._panels.config())  # checked here, where they are given
        self._decoder: tuple[object, Decoder] | None = None  # of the last picture's kind
        self._read: Read | None = None
        self._guard = OneAtATime("reader")

    @property
    def rejected(self) -> dict[str, int]:
        """Counts what in the last picture was no marker, by its reason of docs/troubleshooting.md."""
        return {} if self._read is None else dict(self._read.rejected)

    @property
    def fix(self) -> Fix | None:
        """Tells where the robot is by the last picture; None where that does not say, or there is no map."""
        return None if self._read is None else self._read.fix

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
        """Explains what looks like a panel and is not reported, with what helps; panels first. Takes a second.

        Arguments and errors are as for `read`.
        """
        with self._guard:
            picture = checked_picture(image)
            return self._decoder_of(picture, row_time_us, exposure_us).why_not(picture)

    def draw(self, image: Image, markers: Sequence[Marker]) -> Pixels:
        """The picture in colour (blue, green, red), with cells, axes and ID of each of its markers.

        `markers` are those that `read` gave for this picture. Raises PictureError as `read` does.
        """
        return drawn(self._panels, checked_picture(image), markers)

    def _decoder_of(self, picture: Pixels, row_time_us: float, exposure_us: float) -> Decoder:
        kind = (picture.shape, row_time_us, exposure_us)
        if self._decoder is None or self._decoder[0] != kind:
            exposure = Exposure(row_time_us=row_time_us, exposure_us=exposure_us)
            check_exposure(self._panels, exposure)
            self._decoder = kind, Decoder(self._panels, exposure, picture, stream=False)
        return self._decoder[1]

    def stream(self, *, row_time_us: float, exposure_us: float = EXPOSURE_US) -> Stream:
        """For the pictures of one camera, one after another: they add up, so panels are read from further away.

        Raises ConfigError for a time that no camera has.
        """
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
            return [operator.index(value) for value in values]
    except TypeError:
        pass
    raise ConfigError(f"{name}: must be whole numbers, as [7, 23], not {shortened(values)}")
