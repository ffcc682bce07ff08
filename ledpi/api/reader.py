"""Reads panels in pictures that each stand alone."""

from __future__ import annotations

from collections.abc import Sequence
from os import PathLike
from pathlib import Path

from ledpi.api.exposed import Decoder, Exposure, Panels, check_exposure, override
from ledpi.api.lens import Lens
from ledpi.api.marker import Marker
from ledpi.api.picture import checked_picture
from ledpi.api.stream import Stream
from ledpi.config.camera_yaml import load_intrinsics
from ledpi.core.records import Intrinsics, Phase, Pixels, RowsFrom, Transfer

EXPOSURE_US = 10_000.0  # where a program does not say: the configuration's default


class Reader:
    """Knows the panels and the lens. Not shared between threads.

    `side_m` is the outer edge of the lit grid, in metres. `lens` is the path of a camera.yaml, ours or another tool's,
    a `Lens`, or None: then there are IDs and corners, but no poses. `transfer` is the camera's tone: "srgb" as most
    deliver it, "linear" as `ledpi run` sets the Pi's. All others are as the configuration's keys of these names.

    Raises ConfigError where a value cannot be, CalibrationError where the lens's file cannot be used.

    >>> Reader(side_m=160)  # doctest: +ELLIPSIS
    Traceback (most recent call last):
    ledpi.core.errors.ConfigError: configuration: panels.side_m: must be in metres, ...
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
        transfer: Transfer = "srgb",
        rows_from: RowsFrom = "above",
    ) -> None:
        overrides = (
            override("panels.side_m", side_m),
            override("panels.dictionary", dictionary),
            override("panels.black_hz", black_hz),
            override("panels.white_hz", white_hz),
            override("panels.duty", duty),
            override("panels.phase", phase),
            override("panels.ids", None if ids is None else list(ids)),
            override("camera.transfer", transfer),
            override("camera.rows_from", rows_from),
        )
        self._panels = Panels(overrides=overrides, lens=_intrinsics(lens))
        self._panels.config()  # checked here, where they are given
        self._decoder: tuple[object, Decoder] | None = None  # of the last picture's kind
        self._rejected: dict[str, int] = {}

    @property
    def rejected(self) -> dict[str, int]:
        """What in the last picture was no marker: how often each reason of docs/troubleshooting.md."""
        return dict(self._rejected)

    def read(self, image: Pixels, *, row_time_us: float, exposure_us: float = EXPOSURE_US) -> list[Marker]:
        """The markers in one picture, by itself, the surest first.

        `image`: (height, width) uint8, grey, its rows as the sensor exposed them: not scaled or rectified, and turned
        by 180° only where `rows_from` says so. It is neither kept nor changed. `row_time_us` is between the starts of
        two rows, `exposure_us` how long a row is exposed. Markers' times count from the start of row 0's read-out.

        Raises PictureError, a ValueError, for another picture or another size than the lens's, ConfigError for a time
        that no camera has.
        """
        picture = checked_picture(image)
        kind = (picture.shape, row_time_us, exposure_us)
        if self._decoder is None or self._decoder[0] != kind:
            exposure = Exposure(row_time_us=row_time_us, exposure_us=exposure_us)
            check_exposure(self._panels, exposure)
            self._decoder = kind, Decoder(self._panels, exposure, picture, stream=False)
        markers, self._rejected = self._decoder[1].read(picture)
        return markers

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
    return load_intrinsics(Path(lens).expanduser())
