"""The Raspberry Pi's camera through picamera2 and libcamera. The only module that imports them.

**Not seen on hardware**: written from the sources of picamera2, libcamera and the Linux drivers, and tested with the
real picamera2 and libcamera, on libcamera's virtual camera.

What the decoder lives on: the sensor's own 640 × 480 mode, an exposure and a frame period that stay as they were set, a
picture that is linear in light, and every automatic off.
"""

from __future__ import annotations

import contextlib
import threading
import time
from collections import deque
from collections.abc import Mapping, Sequence
from concurrent.futures import CancelledError
from concurrent.futures import TimeoutError as NoResultError  # Python's own TimeoutError from 3.11 on
from types import ModuleType
from typing import Any

import numpy as np

from ledpi.camera.capture_settings import check_mode, disagreement, fixed_controls, frame_rows, row_time
from ledpi.camera.gain import FIRST_GAIN
from ledpi.camera.holder import who_holds
from ledpi.camera.sensors import BIT_DEPTH, MODE
from ledpi.camera.timing import exposure_honoured, frame_duration_us
from ledpi.camera.tuning import linear_tuning, white_gains
from ledpi.config.settings import CameraSettings
from ledpi.core.errors import CameraError, CameraLostError
from ledpi.core.records import CameraInfo, Frame, Pixels, Rejected

STALL_PERIODS = 5  # without a frame for so many periods, the camera has stalled
_SETTLE_FRAMES = 30  # controls act after 2 frames and the first 2 are bad: no agreement by then is a refusal
_START_S = 2.0  # for the first frame: the sensor is powered up and its firmware loaded
# Frames that are asked for ahead of time, 130 ms at 60 a second. Where this thread is held up, so many wait for it, and
# one more in picamera2; what comes after that is missed. The camera needs three buffers to go on meanwhile. (Where one
# wants the newest frame only, those that waited cost a copy each, 35 µs.)
ASKED_AHEAD = 8
_BUFFERS = ASKED_AHEAD + 1 + 3
# How picamera2 and libcamera say that something failed; an index: the camera of that number is gone again.
_FAILURES = (RuntimeError, OSError, IndexError)
_INSTALL = "sudo apt install python3-picamera2, and a virtual environment with --system-site-packages"


class PicameraCamera:
    """A started camera whose metadata agrees with what was asked. Made by `open_picamera`."""

    def __init__(
        self, picam2: Any, mapped_array: Any, info: CameraInfo, gain_limits: tuple[float, float] | None
    ) -> None:
        self._picam2 = picam2
        self._mapped_array = mapped_array  # picamera2.MappedArray
        self._info = info
        self._gain_limits = gain_limits
        assert info.frame_length_rows is not None
        self._period_s = info.frame_length_rows * info.row_time_us * 1e-6
        self._in_use = threading.Lock()  # held while a request is waited for or in our hands
        self._closed = threading.Event()
        self._asked: deque[Any] = deque()  # picamera2's jobs, the next frame's first
        self._seq = 0
        self._last_ns: int | None = None

    @property
    def info(self) -> CameraInfo:
        """What was configured, with the camera's own row time."""
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
        except _FAILURES as error:
            raise CameraLostError(f"picamera2: {error}") from None

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
                with contextlib.suppress(CancelledError, NoResultError, RuntimeError, OSError):
                    self._asked.popleft().get_result(timeout=0).release()
            self._picam2.close()

    def settle(self, asked: Mapping[str, Any]) -> None:
        """Waits until the camera does what was asked. Raises CameraError where it does not."""
        difference: str | None = None
        for number in range(_SETTLE_FRAMES):
            request = self._next_request(STALL_PERIODS * self._period_s if number else _START_S)
            assert request is not None, "nobody else has this camera yet"
            metadata = request.get_metadata()
            request.release()
            difference = disagreement(metadata, asked, self._info.row_time_us)
            if difference is None:
                break
        if difference is not None:
            raise CameraError(f"picamera2: {difference}")
        age_ns = time.monotonic_ns() - metadata.get("SensorTimestamp", 0)
        if not 0 <= age_ns < 1_000_000_000:
            raise CameraError("picamera2: SensorTimestamp is not of CLOCK_MONOTONIC; update libcamera")

    def _made_since(self, asked_ns: int, request: Any | None) -> Any | None:
        """Of the frames that have waited since the camera was opened, none: a gap would follow them."""
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


def open_picamera(settings: CameraSettings, frequencies_hz: Sequence[float]) -> PicameraCamera:
    """Opens, configures and starts the first camera. `frequencies_hz`: what the panels blink at.

    Raises CameraLostError where there is no camera, it is in use or fails as it starts, CameraError where it does not
    do what was asked.
    """
    if (settings.width, settings.height) != MODE:
        raise CameraError(
            f"camera.width, camera.height: must be {MODE[0]} and {MODE[1]} with picamera2 (a scaled picture "
            f"has another row time), not {settings.width} and {settings.height}"
        )
    libcamera, picamera2 = _import_picamera2()
    model = first_model(libcamera)
    try:
        tuning = picamera2.Picamera2.load_tuning_file(f"{model}.json")
        linear, colour_gains = linear_tuning(tuning), white_gains(tuning)
    except (RuntimeError, ValueError) as error:
        raise CameraError(f"picamera2: libcamera's tuning file {model}.json cannot be used: {error}") from None
    try:
        picam2 = picamera2.Picamera2(0, tuning=linear)
    except _FAILURES as error:
        holder = who_holds("/dev/media*") or "`sudo fuser -v /dev/media*` tells if another process holds it"
        why = error.__cause__ or error
        raise CameraLostError(f"picamera2: the camera cannot be opened ({why}); {holder}") from None
    opened: Any = picam2  # what to close where the rest fails
    try:
        asked, info = _configure(picam2, libcamera, settings, frequencies_hz, model, colour_gains)
        picam2.set_controls(asked)  # goes to the camera with its start
        picam2.start(show_preview=False)
        limits = picam2.camera_controls["AnalogueGain"][:2] if settings.analogue_gain == "auto" else None
        opened = camera = PicameraCamera(picam2, picamera2.MappedArray, info, limits)
        camera.settle(asked)
        return camera
    except BaseException as error:
        with contextlib.suppress(*_FAILURES):  # of one that is half started; the first error counts
            opened.close()
        if isinstance(error, _FAILURES):  # no memory for its buffers as the machine boots, say
            raise CameraLostError(f"picamera2: {error}") from None
        raise


def first_model(libcamera: ModuleType) -> str:
    """The sensor of the camera that picamera2 calls number 0, as "ov5647".

    libcamera reads its tuning files when its camera manager starts, so the manager that is asked here must be gone
    before `Picamera2(tuning=…)` is made, which starts another; it ends with the last reference to it. Asking anew also
    finds what was plugged in since. Raises CameraLostError where there is none, or they cannot be listed.
    """
    try:
        found = [
            (camera.id, next(value for key, value in camera.properties.items() if key.name == "Model"))
            for camera in libcamera.CameraManager.singleton().cameras
            if "/usb" not in camera.id
        ]
    except _FAILURES as error:
        raise CameraLostError(f"picamera2: the cameras cannot be listed ({error})") from None
    if not found:
        raise CameraLostError("picamera2: no camera found; check the cable, and see rpicam-hello --list-cameras")
    return str(max(found)[1])  # picamera2 sorts so


def _import_picamera2() -> tuple[ModuleType, ModuleType]:
    try:
        import libcamera
        import picamera2
    except ImportError as error:
        raise CameraError(f"picamera2: cannot be imported ({error}); needs {_INSTALL}") from None
    except ValueError as error:  # "numpy.dtype size changed": the system's simplejpeg was built for numpy 1
        raise CameraError(
            f"picamera2: cannot be imported ({error}); on Bookworm, install under constraints/bookworm.txt"
        ) from None
    return libcamera, picamera2


def _configure(
    picam2: Any,
    libcamera: ModuleType,
    settings: CameraSettings,
    frequencies_hz: Sequence[float],
    model: str,
    colour_gains: tuple[float, float],
) -> tuple[dict[str, Any], CameraInfo]:
    """Puts the camera into its mode. Returns the controls to start it with, and what is then known of it."""
    full_range = libcamera.ColorSpace.Sycc()  # a video's default puts luma into 16..235
    configuration = picam2.create_video_configuration(
        main={"format": "YUV420", "size": MODE},
        raw=None,
        buffer_count=_BUFFERS,
        sensor={"output_size": MODE, "bit_depth": BIT_DEPTH},
        colour_space=full_range,
        display=None,
        encode=None,
    )
    picam2.configure(configuration)
    check_mode(picam2.camera_configuration())
    colours = picam2.camera_configuration()["colour_space"]
    if colours.range != full_range.range:
        raise CameraError(f"picamera2: the camera gives {colours}; must be full range; update libcamera")
    shortest_us = float(picam2.camera_controls["FrameDurationLimits"][0])
    row_time_us = row_time(settings, model, shortest_us)
    rows = frame_rows(settings, row_time_us, frequencies_hz, model, shortest_us)
    asked = fixed_controls(
        exposure_us=settings.exposure_us,
        analogue_gain=FIRST_GAIN if settings.analogue_gain == "auto" else settings.analogue_gain,
        duration_us=frame_duration_us(rows, row_time_us),
        colour_gains=colour_gains,
        noise_reduction_off=libcamera.controls.draft.NoiseReductionModeEnum.Off,
    )
    info = CameraInfo(
        width=MODE[0],
        height=MODE[1],
        exposure_us=settings.exposure_us,
        row_time_us=row_time_us,
        transfer="linear" if settings.transfer == "auto" else settings.transfer,
        frame_length_rows=rows,
    )
    return asked, info
