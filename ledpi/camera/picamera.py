"""The Raspberry Pi's camera through picamera2 and libcamera. The only module that imports them.

**Not seen on hardware**: written from the sources of picamera2, libcamera and the Linux driver of the OV5647.

What the decoder lives on: the sensor's own 640 × 480 mode, an exposure and a frame period that stay as they
were set, and every automatic off. One is left: the ISP's adaptive tone curve, which no control switches off.
Frames are marked `srgb`, which that curve is near.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Mapping, Sequence
from concurrent.futures import CancelledError
from types import ModuleType
from typing import Any

import numpy as np

from ledpi.camera.capture_settings import (
    MODE,
    check_mode,
    disagreement,
    fixed_controls,
    frame_rows,
    row_time,
    start_gain,
)
from ledpi.camera.timing import exposure_honoured, frame_duration_us
from ledpi.config import CameraSettings
from ledpi.errors import CameraError
from ledpi.records import CameraInfo, Frame, Pixels, Rejected

_SETTLE_FRAMES = 30  # controls act after 2 frames and the first 2 are bad: no agreement by then is a refusal
_STALL_S = 1.0  # many frame periods
_INSTALL = "sudo apt install python3-picamera2, and a virtual environment with --system-site-packages"


class PicameraCamera:
    """A started camera whose metadata agrees with what was asked. Made by `open_picamera`."""

    def __init__(self, picam2: Any, mapped_array: Any, info: CameraInfo) -> None:
        self._picam2 = picam2
        self._mapped_array = mapped_array  # picamera2.MappedArray
        self._info = info
        self._in_use = threading.Lock()  # held while a request is waited for or in our hands
        self._closed = threading.Event()
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

    def read(self, into: Pixels) -> Frame | Rejected | None:
        """As `Camera.read`. Picture and metadata are of one request, which is released at once."""
        with self._in_use:
            request = self._next_request()
            if request is None:
                return None
            try:
                metadata = request.get_metadata()
                with self._mapped_array(request, "main", write=False) as mapped:
                    # Luma is the upper part of YUV420 (and of NV12); rows are padded on the right.
                    np.copyto(into, mapped.array[: self._info.height, : self._info.width])
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
            self._picam2.close()

    def settle(self, asked: Mapping[str, Any]) -> None:
        """Waits until the camera does what was asked. Raises CameraError where it does not."""
        for _ in range(_SETTLE_FRAMES):
            request = self._next_request()
            if request is None:
                return
            metadata = request.get_metadata()
            request.release()
            difference = disagreement(metadata, asked, self._info.row_time_us)
            if difference is None:
                break
        else:
            raise CameraError(f"picamera2: {difference}")
        age_ns = time.monotonic_ns() - metadata.get("SensorTimestamp", 0)
        if not 0 <= age_ns < 1_000_000_000:
            raise CameraError("picamera2: SensorTimestamp is not of CLOCK_MONOTONIC; update libcamera")

    def _next_request(self) -> Any | None:
        if self._closed.is_set():
            return None
        job = self._picam2.capture_request(wait=False)
        try:
            return job.get_result(timeout=_STALL_S)
        except CancelledError:
            return None
        except TimeoutError:
            raise CameraError(f"picamera2: the camera delivered nothing for {_STALL_S:g} s") from None

    def _frame(self, metadata: Mapping[str, Any], into: Pixels) -> Frame | Rejected:
        readout_ns, exposure_us = metadata.get("SensorTimestamp"), metadata.get("ExposureTime")
        info = self._info
        if readout_ns is None or (self._last_ns is not None and readout_ns <= self._last_ns):
            return Rejected(stage="capture", reason="timestamp")
        if exposure_us is None or not exposure_honoured(
            asked_us=info.exposure_us, reported_us=exposure_us, row_time_us=info.row_time_us
        ):
            return Rejected(stage="capture", reason="exposure")
        if self._last_ns is not None and info.frame_length_rows is not None:
            period_ns = info.frame_length_rows * info.row_time_us * 1e3
            self._seq += max(1, round((readout_ns - self._last_ns) / period_ns))
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

    Raises CameraError where there is no camera, or where it does not do what was asked.
    """
    if (settings.width, settings.height) != MODE:
        raise CameraError(
            f"camera.width, camera.height: must be {MODE[0]} and {MODE[1]} with picamera2 (a scaled picture "
            f"has another row time), not {settings.width} and {settings.height}"
        )
    libcamera, picamera2 = _import_picamera2()
    cameras = picamera2.Picamera2.global_camera_info()
    if not cameras:
        raise CameraError("picamera2: no camera found; check the cable, and see rpicam-hello --list-cameras")
    try:
        picam2 = picamera2.Picamera2(0)  # the first of that list
    except (RuntimeError, OSError) as error:
        raise CameraError(
            f"picamera2: the camera cannot be opened ({error.__cause__ or error}); "
            "if another process holds it, `fuser /dev/video*` tells which"
        ) from None
    try:
        asked, info = _configure(picam2, libcamera, settings, frequencies_hz, cameras[0].get("Model", "?"))
        picam2.set_controls(asked)  # goes to the camera with its start
        picam2.start(show_preview=False)
        camera = PicameraCamera(picam2, picamera2.MappedArray, info)
        camera.settle(asked)
        return camera
    except BaseException as error:
        picam2.close()
        if isinstance(error, (RuntimeError, OSError)):
            raise CameraError(f"picamera2: {error}") from None
        raise


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
    picam2: Any, libcamera: ModuleType, settings: CameraSettings, frequencies_hz: Sequence[float], model: str
) -> tuple[dict[str, Any], CameraInfo]:
    """Puts the camera into its mode. Returns the controls to start it with, and what is then known of it."""
    configuration = picam2.create_video_configuration(
        main={"format": "YUV420", "size": MODE},
        raw=None,
        sensor={"output_size": MODE, "bit_depth": 10},
        colour_space=libcamera.ColorSpace.Sycc(),  # full range: a video's default puts luma into 16..235
        display=None,
        encode=None,
    )
    picam2.configure(configuration)
    check_mode(picam2.camera_configuration())
    colours = picam2.libcamera_config.at(0).color_space
    if colours is None or colours.range != libcamera.ColorSpace.Range.Full:
        raise CameraError(f"picamera2: the camera gives {colours}; must be full range; update libcamera")
    shortest_us = float(picam2.camera_controls["FrameDurationLimits"][0])
    row_time_us = row_time(settings, model, shortest_us)
    rows = frame_rows(settings, row_time_us, frequencies_hz, round(shortest_us / row_time_us))
    asked = fixed_controls(
        exposure_us=settings.exposure_us,
        analogue_gain=start_gain(settings),
        duration_us=frame_duration_us(rows, row_time_us),
        noise_reduction_off=libcamera.controls.draft.NoiseReductionModeEnum.Off,
    )
    info = CameraInfo(
        width=MODE[0],
        height=MODE[1],
        exposure_us=settings.exposure_us,
        row_time_us=row_time_us,
        transfer="srgb" if settings.transfer == "auto" else settings.transfer,
        frame_length_rows=rows,
    )
    return asked, info
