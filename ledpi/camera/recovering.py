"""A camera that comes back: closed and opened again, with back-off, when it stalls, fails or is unplugged."""

from __future__ import annotations

import contextlib
import logging
import threading
import time
from collections.abc import Callable
from dataclasses import replace

from ledpi.camera.base import AdjustableGain, Camera
from ledpi.core.errors import CameraError, CameraLostError
from ledpi.core.records import CameraInfo, Frame, PanelValues, Pixels, Rejected

LOST = Rejected(stage="camera", reason="lost")
BACKOFF_FIRST_S = 0.1
BACKOFF_LAST_S = 0.5  # so that one that is back is in use within 2 s, opening included
# Without a frame for so long the process ends, and its service manager starts another: what is wrong may be in it. Less
# than the unit's WatchdogSec=, so that it ends by itself and says why.
DEADLINE_S = 8.0

UNFIT_FRAMES = 30  # half a second of a camera

_log = logging.getLogger(__name__)


class RecoveringCamera:
    """Keeps the contract of `Camera` over one that may be lost; `open_camera` makes another like it.

    While it is lost each `read` is one attempt, and returns `LOST`: at once when the camera has just failed, later
    after the back-off. `seq` goes on after the last frame. Raises CameraLostError after DEADLINE_S without a frame,
    and where what comes back is another camera, as nothing that was set up for the first one fits.
    """

    def __init__(self, open_camera: Callable[[], Camera]) -> None:
        """Raises what the first opening raises."""
        self._open = open_camera
        self._changing = threading.Lock()  # of _camera, between its reader and `close`
        self._closed = threading.Event()
        self._camera: Camera | None = open_camera()
        self._broken: Camera | None = None  # lost, and not closed yet
        self._info = self._camera.info
        self._panel = self._camera.panel
        self._gain: float | None = None
        self._seq, self._first_seq = -1, 0
        self._lost_s: float | None = None  # since when; None: it delivers
        self._backoff_s = BACKOFF_FIRST_S
        self._said = ""
        self._unfit = 0  # frames in a row

    @property
    def info(self) -> CameraInfo:
        """As `Camera.info`: that of the first opening."""
        return self._info

    @property
    def panel(self) -> PanelValues | None:
        """As `Camera.panel`."""
        return self._panel

    @property
    def gain_limits(self) -> tuple[float, float] | None:
        """As `AdjustableGain.gain_limits`; None where the camera's gain cannot be set."""
        camera = self._camera
        return camera.gain_limits if isinstance(camera, AdjustableGain) else None

    def set_gain(self, gain: float) -> None:
        """As `AdjustableGain.set_gain`; a camera that is lost has it when it is back."""
        self._gain = gain
        camera = self._camera
        if isinstance(camera, AdjustableGain):
            with contextlib.suppress(Exception):  # it is being closed, or fails: `read` will say so
                camera.set_gain(gain)

    def read(self, into: Pixels) -> Frame | Rejected | None:
        """As `Camera.read`."""
        camera = self._camera
        if camera is None:
            return self._try_again()
        try:
            result = camera.read(into)
        except (CameraError, OSError) as error:
            return self._lose(camera, error)
        if not isinstance(result, Frame):
            return None if result is None else self._count_unfit(camera, result)
        self._unfit = 0
        self._seq = self._first_seq + result.seq
        self._lost_s, self._backoff_s = None, BACKOFF_FIRST_S
        return result if self._first_seq == 0 else replace(result, seq=self._seq)

    def _count_unfit(self, camera: Camera, result: Rejected) -> Rejected | None:
        """One frame may be unfit; one after the other, and the camera is not what it was set up to be."""
        self._unfit += 1
        if self._unfit < UNFIT_FRAMES:
            return result
        return self._lose(camera, CameraLostError(f"{self._unfit} unusable frames in a row: {result.key}"))

    def close(self) -> None:
        """As `Camera.close`."""
        self._closed.set()
        with self._changing:
            camera, self._camera = self._camera, None
        if camera is not None:
            _close_quietly(camera)
        self._close_broken()

    def _lose(self, camera: Camera, error: CameraError | OSError) -> Rejected | None:
        with self._changing:
            if self._closed.is_set():
                return None
            self._broken, self._camera = camera, None
        if self._lost_s is None:  # else it was opened again and gave no frame: lost ever since
            self._lost_s = time.monotonic()
        self._give_up_in_time(error)
        self._said = str(error)
        _log.warning("camera lost: %s; opening it again", error)
        return LOST  # the reader is told first: closing may take as long as five frames again

    def _close_broken(self) -> None:
        with self._changing:
            camera, self._broken = self._broken, None
        if camera is not None:
            _close_quietly(camera)

    def _try_again(self) -> Rejected | None:
        self._close_broken()
        if self._closed.wait(self._backoff_s):
            return None
        self._backoff_s = min(2 * self._backoff_s, BACKOFF_LAST_S)
        try:
            camera = self._open()
        except (CameraError, OSError) as error:
            self._give_up_in_time(error)
            if str(error) != self._said:
                _log.warning("camera still lost: %s", error)
                self._said = str(error)
            return LOST
        if camera.info != self._info:
            _close_quietly(camera)
            raise CameraLostError(f"camera: another one came back, {camera.info}; was {self._info}")
        self._take(camera)
        _log.warning("camera back after %.1f s", self._away_s())
        return LOST

    def _give_up_in_time(self, error: CameraError | OSError) -> None:
        if self._away_s() > DEADLINE_S:
            raise CameraLostError(f"{error}; given up after {self._away_s():.0f} s") from None

    def _away_s(self) -> float:
        return 0.0 if self._lost_s is None else time.monotonic() - self._lost_s

    def _take(self, camera: Camera) -> None:
        with self._changing:
            if self._closed.is_set():
                _close_quietly(camera)
                return
            self._camera = camera
        self._first_seq = self._seq + 1
        self._unfit = 0
        if self._gain is not None:
            self.set_gain(self._gain)


def _close_quietly(camera: Camera) -> None:
    """One that fails as it is closed is given back all the same: nobody could do more."""
    with contextlib.suppress(Exception):
        camera.close()
