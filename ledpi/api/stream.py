"""Reads panels in the pictures of one camera, one after another."""

from __future__ import annotations

from collections.abc import Sequence

from ledpi.api.drawn import drawn
from ledpi.api.exposed import Decoder, Exposure, Panels, Read
from ledpi.api.fix import Fix
from ledpi.api.marker import Marker
from ledpi.api.picture import Image, OneAtATime, checked_picture
from ledpi.api.state import State, Whereabouts, whole_ns
from ledpi.core.errors import PictureError
from ledpi.core.records import Pixels


class Stream:
    """Remembers the panels of earlier pictures. Made by `Reader.stream`; not shared between threads."""

    def __init__(self, panels: Panels, exposure: Exposure) -> None:
        self._panels = panels
        self._exposure = exposure
        self._decoder: Decoder | None = None  # of the first picture's size
        self._seq = 0
        self._last_ns: int | None = None
        self._read: Read | None = None
        self._whereabouts = Whereabouts(panels.config())
        self._guard = OneAtATime("stream")

    @property
    def rejected(self) -> dict[str, int]:
        """Counts what in the last picture was no marker, by its reason of docs/troubleshooting.md."""
        return {} if self._read is None else dict(self._read.rejected)

    @property
    def fix(self) -> Fix | None:
        """Tells where the robot is by the last picture; None where that does not say, or there is no map."""
        return None if self._read is None else self._read.fix

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

    def draw(self, image: Image, markers: Sequence[Marker]) -> Pixels:
        """The picture in colour, with its markers, as `Reader.draw` gives it."""
        return drawn(self._panels, checked_picture(image), markers)

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
