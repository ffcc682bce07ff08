"""A V4L2 device (a USB camera) through OpenCV: for trying things out.

**Not seen on hardware.** V4L2 tells neither the row time nor, for certain, which event a frame's time belongs
to: uvcvideo stamps the arrival of a frame's first bytes, which is taken here as the read-out of row 0. What
the device buffers before that is not in the poses' age, so this is no camera for a robot in motion.
"""

from __future__ import annotations

import logging
import os
import threading
import time

import cv2
import numpy as np

from ledpi.camera.base import frame_by
from ledpi.config.settings import CameraSettings
from ledpi.core.errors import CameraError, CameraLostError, RowTimeUnknownError, raising
from ledpi.core.linux import who_holds
from ledpi.core.records import CameraInfo, Frame, Pixels, Rejected

_MANUAL_EXPOSURE = 1  # V4L2_EXPOSURE_MANUAL
_VIDEO_MAJOR = 81  # of Linux's device numbers: video4linux
_EXPOSURE_UNIT_US = 100  # V4L2_CID_EXPOSURE_ABSOLUTE counts in 100 µs

_log = logging.getLogger(__name__)


class V4l2Camera:
    """An open device, made by `open_v4l2`. One that hangs keeps `close` waiting for OpenCV's 10 s at most."""

    def __init__(self, device: str, capture: cv2.VideoCapture, info: CameraInfo) -> None:
        self._device = device
        self._capture = capture
        self._info = info
        self._readout_ns = round(info.height * info.row_time_us * 1e3)
        self._picture = np.zeros((info.height, info.width, 3), np.uint8)
        self._in_use = threading.Lock()  # OpenCV's capture must not be released while it is read
        self._closed = threading.Event()
        self._seq = -1
        self._last_ns = 0

    @property
    def info(self) -> CameraInfo:
        """As `Camera.info`; the exposure is what the device says it uses."""
        return self._info

    @property
    def panel(self) -> None:
        """A camera does not know what it looks at."""
        return None

    def read(self, into: Pixels) -> Frame | Rejected | None:
        """As `Camera.read`. Colour is made grey by OpenCV's weights (ITU-R BT.601)."""
        with self._in_use:
            if self._closed.is_set():
                return None
            with raising(f"{self._device}", CameraLostError, cv2.error):
                done, self._picture = self._capture.read(self._picture)
                stamp_ns = round(self._capture.get(cv2.CAP_PROP_POS_MSEC) * 1e6)
        if self._closed.is_set():
            return None
        if not done:
            raise CameraLostError(f"{self._device}: delivers no more pictures; is it still plugged in?")
        if self._picture.ndim == 3:
            cv2.cvtColor(self._picture, cv2.COLOR_BGR2GRAY, dst=into)
        else:
            np.copyto(into, self._picture)
        return self._frame(into, stamp_ns)

    def close(self) -> None:
        """As `Camera.close`."""
        self._closed.set()
        with self._in_use:
            self._capture.release()

    def _frame(self, into: Pixels, stamp_ns: int) -> Frame | Rejected:
        self._seq += 1
        latest_ns = time.monotonic_ns() - self._readout_ns  # the whole picture is here
        is_monotonic = 0 <= latest_ns - stamp_ns < 1_000_000_000
        readout_ns = stamp_ns if is_monotonic else latest_ns
        if readout_ns <= self._last_ns:
            return Rejected(stage="capture", reason="timestamp")
        self._last_ns = readout_ns
        return frame_by(self._info, into.view(), self._seq, readout_ns)


def open_v4l2(settings: CameraSettings, device: str) -> V4l2Camera:
    """Opens a device, as /dev/video0, and fixes what it lets one fix; warns where it does not.

    Raises CameraLostError where the device is not there or cannot be opened, CameraError where it is none or has not
    the size asked for.
    """
    if settings.row_time_us == "auto":
        raise RowTimeUnknownError(
            "camera.row_time_us: must be a number, as V4L2 cannot tell; `ledpi calibrate shutter` measures it"
        )
    _stat_node(device)
    # By its node, which a name below /dev/v4l/by-id or by-path leads to; that may be another each time.
    capture = cv2.VideoCapture(os.path.realpath(device), cv2.CAP_V4L2)
    if not capture.isOpened():
        if os.major(_stat_node(device).st_rdev) != _VIDEO_MAJOR:  # looked at anew, as it may have gone meanwhile
            raise CameraError(f"camera.source: {device} is no video device; see v4l2-ctl --list-devices")
        holder = who_holds(device) or f"`sudo fuser -v {device}` tells if another process holds it"
        raise CameraLostError(f"camera.source: {device} cannot be opened; {holder}")
    try:
        _set_size(capture, settings, device)
        exposure_us = _fix_exposure(capture, settings, device)
    except CameraError:
        capture.release()
        raise
    info = CameraInfo(
        width=settings.width,
        height=settings.height,
        exposure_us=exposure_us,
        row_time_us=settings.row_time_us,
        transfer="srgb" if settings.transfer == "auto" else settings.transfer,
        rows_from=settings.rows_from,
    )
    return V4l2Camera(device, capture, info)


def _stat_node(device: str) -> os.stat_result:
    try:
        return os.stat(device)
    except FileNotFoundError:
        raise CameraLostError(f"camera.source: {device} does not exist; see v4l2-ctl --list-devices") from None
    except OSError as error:
        raise CameraLostError(f"camera.source: {device}: {error.strerror or error}") from None


def _set_size(capture: cv2.VideoCapture, settings: CameraSettings, device: str) -> None:
    capture.set(cv2.CAP_PROP_FRAME_WIDTH, settings.width)
    capture.set(cv2.CAP_PROP_FRAME_HEIGHT, settings.height)
    if settings.frame_duration_us != "auto":
        capture.set(cv2.CAP_PROP_FPS, 1e6 / settings.frame_duration_us)
    size = int(capture.get(cv2.CAP_PROP_FRAME_WIDTH)), int(capture.get(cv2.CAP_PROP_FRAME_HEIGHT))
    if size != (settings.width, settings.height):
        raise CameraError(
            f"camera.width, camera.height: {device} gives {size[0]} × {size[1]} where "
            f"{settings.width} × {settings.height} was asked; set what it has"
        )


def _fix_exposure(capture: cv2.VideoCapture, settings: CameraSettings, device: str) -> float:
    """The exposure in µs that the device will use, as far as it tells."""
    capture.set(cv2.CAP_PROP_AUTO_WB, 0)
    is_manual = capture.set(cv2.CAP_PROP_AUTO_EXPOSURE, _MANUAL_EXPOSURE)
    is_set = capture.set(cv2.CAP_PROP_EXPOSURE, settings.exposure_us / _EXPOSURE_UNIT_US)
    reported_us = capture.get(cv2.CAP_PROP_EXPOSURE) * _EXPOSURE_UNIT_US
    if is_manual and is_set and abs(reported_us - settings.exposure_us) <= _EXPOSURE_UNIT_US:
        return reported_us
    message = "%s: the exposure cannot be fixed at %g µs; bands will vary with the light"
    _log.warning(message, device, settings.exposure_us)
    return reported_us if reported_us > 0 else settings.exposure_us
