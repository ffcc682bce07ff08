"""The frames of a started Raspberry Pi camera: asked for ahead of time, one request each, dated by the sensor."""

from __future__ import annotations

import contextlib
import threading
import time
from collections import deque
from collections.abc import Mapping
from concurrent.futures import CancelledError
from concurrent.futures import TimeoutError as NoResultError  # Python's own TimeoutError from 3.11 on
from types import ModuleType
from typing import Any

import numpy as np

from ledpi.camera.capture_settings import disagreement
from ledpi.camera.picamera_version import unforeseen, versions
from ledpi.camera.timing import exposure_honoured
from ledpi.core.errors import CameraError, CameraLostError
from ledpi.core.records import CameraInfo, Frame, Pixels, Rejected

STALL_PERIODS = 5  # without a frame for so many periods, the camera has stalled
# Controls go with the next frame that is asked for, act 2 later, and the first 2 are bad. Some versions forget what is
# asked before the start: so it is asked again.
_ASK_AGAIN_FRAMES = 12
_SETTLE_FRAMES = 3 * _ASK_AGAIN_FRAMES  # no agreement by then is a refusal
_START_S = 2.0  # for the first frame: the sensor is powered up and its firmware loaded
# Frames that are asked for ahead of time, 130 ms at 60 a second. Where this thread is held up, so many wait for it, and
# one more in picamera2; what comes after that is missed. The camera needs three buffers to go on meanwhile. (Where one
# wants the newest frame only, those that waited cost a copy each, 35 µs.)
ASKED_AHEAD = 8
# How picamera2 and libcamera say that something failed; an index: the camera of that number is gone again.
FAILURES = (RuntimeError, OSError, IndexError)


class PicameraCamera:
    """A started camera whose metadata agrees with what was asked. Made by `open_picamera`."""

    def __init__(
        self,
        picam2: Any,
        mapped_array: Any,
        info: CameraInfo,
        gain_limits: tuple[float, float] | None,
        libcamera: ModuleType | None = None,
    ) -> None:
        self._picam2 = picam2
        self._mapped_array = mapped_array  # picamera2.MappedArray
        self._info = info
        self._gain_limits = gain_limits
        self._libcamera = libcamera  # whose version an error is to name
        assert info.frame_length_rows is not None
        self._period_s = info.frame_length_rows * info.row_time_us * 1e-6
        self._in_use = threading.Lock()  # held while a request is waited for or in our hands
        self._closed = threading.Event()
        self._asked: deque[Any] = deque()  # picamera2's jobs, the next frame's first
        self._seq = 0
        self._last_ns: int | None = None

    @property
    def info(self) -> CameraInfo:
        """Tells what was configured, with the camera's own row time."""
        return self._info

    @property
    def panel(self) -> None:
        """A camera does not know what it looks at."""
        return None

    @property
    def gain_limits(self) -> tuple[float, float] | None:
        """As `Camera.gain_limits`: the sensor's, where the configuration leaves the gain open."""
        return self._gain_limits

    def set_gain(self, gain: float) -> None:
        """As `Camera.set_gain`; acts 2 frames later."""
        self._picam2.set_controls({"AnalogueGain": float(gain)})

    def read(self, into: Pixels) -> Frame | Rejected | None:
        """As `Camera.read`. Picture and metadata are of one request, which is released at once."""
        try:
            return self._read(into)
        except FAILURES as error:
            raise CameraLostError(f"{versions(self._libcamera)}: {error}") from None
        except CameraError:
            raise
        except Exception as error:  # as another version has it; a new start may do better
            raise CameraLostError(str(unforeseen(error, self._libcamera))) from error

    def _read(self, into: Pixels) -> Frame | Rejected | None:
        with self._in_use:
            request = self._next_request(STALL_PERIODS * self._period_s)
            if self._last_ns is None:
                request = self._made_since(time.monotonic_ns(), request)
            if request is None:
                return None
            try:
                with self._mapped_array(request, "main", write=False) as mapped:
                    # Luma is the upper part of YUV420 (and of NV12); rows are padded on the right.
                    np.copyto(into, mapped.array[: self._info.height, : self._info.width])
                metadata = request.get_metadata()
            finally:
                request.release()
        return self._frame(metadata, into)

    def close(self) -> None:
        """As `Camera.close`."""
        if self._closed.is_set():
            return
        self._closed.set()
        self._picam2.cancel_all_and_flush()  # ends a waiting read
        with self._in_use:
            while self._asked:
                with contextlib.suppress(CancelledError, Exception):
                    self._asked.popleft().get_result(timeout=0).release()
            self._picam2.close()

    def settle(self, asked: Mapping[str, Any]) -> None:
        """Waits until the camera does what was asked, and asks again. Raises CameraLostError where it never does."""
        difference: str | None = None
        for number in range(_SETTLE_FRAMES):
            if number and number % _ASK_AGAIN_FRAMES == 0:
                self._picam2.set_controls(dict(asked))
            request = self._next_request(STALL_PERIODS * self._period_s if number else _START_S)
            assert request is not None, "nobody else has this camera yet"
            metadata = request.get_metadata()
            request.release()
            difference = disagreement(metadata, asked, self._info.row_time_us)
            if difference is None:
                break
        if difference is not None:
            raise CameraLostError(f"picamera2: {difference}")
        age_ns = time.monotonic_ns() - metadata.get("SensorTimestamp", 0)
        if not 0 <= age_ns < 1_000_000_000:
            raise CameraError("picamera2: SensorTimestamp is not of CLOCK_MONOTONIC; update libcamera")

    def _made_since(self, asked_ns: int, request: Any | None) -> Any | None:
        """Finds none among the frames that have waited since the camera was opened: a gap would follow them."""
        while request is not None and request.get_metadata().get("SensorTimestamp", asked_ns) < asked_ns:
            request.release()
            request = self._next_request(STALL_PERIODS * self._period_s)
        return request

    def _next_request(self, timeout_s: float) -> Any | None:
        if self._closed.is_set():
            return None
        while len(self._asked) < ASKED_AHEAD:
            self._asked.append(self._picam2.capture_request(wait=False))
        job = self._asked.popleft()
        # In several waits: a process that was held up as a whole wakes to a wait that is over, and to one only.
        for _ in range(STALL_PERIODS):
            try:
                return job.get_result(timeout=timeout_s / STALL_PERIODS)
            except CancelledError:
                return None
            except NoResultError:
                if self._closed.is_set():  # between the two looks, so that the wait could not be ended
                    return None
        raise CameraLostError(f"picamera2: the camera delivered nothing for {timeout_s:.2g} s")

    def _frame(self, metadata: Mapping[str, Any], into: Pixels) -> Frame | Rejected:
        readout_ns, exposure_us = metadata.get("SensorTimestamp"), metadata.get("ExposureTime")
        info = self._info
        if readout_ns is None or (self._last_ns is not None and readout_ns <= self._last_ns):
            return Rejected(stage="capture", reason="timestamp")
        if exposure_us is None or not exposure_honoured(
            asked_us=info.exposure_us, reported_us=exposure_us, row_time_us=info.row_time_us
        ):
            return Rejected(stage="capture", reason="exposure")
        if self._last_ns is not None:
            self._seq += max(1, round((readout_ns - self._last_ns) * 1e-9 / self._period_s))
        self._last_ns = readout_ns
        return Frame(
            pixels=into.view(),
            seq=self._seq,
            row0_readout_ns=readout_ns,
            exposure_us=exposure_us,
            row_time_us=info.row_time_us,
            transfer=info.transfer,
            analogue_gain=metadata.get("AnalogueGain"),
        )
