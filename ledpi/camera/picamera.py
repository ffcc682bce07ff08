"""The Raspberry Pi's camera through picamera2 and libcamera. The only module that imports them.

**Not seen on hardware**: written from the sources of picamera2, libcamera and the Linux drivers, and tested with the
real picamera2 and libcamera, on libcamera's virtual camera.

What the decoder lives on: the sensor's own 640 × 480 mode, an exposure and a frame period that stay as they were set, a
picture that is linear in light, and every automatic off.
"""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from types import ModuleType
from typing import Any

from ledpi.camera.capture_settings import (
    BIT_DEPTH,
    MODE,
    check_limits,
    check_mode,
    fixed_controls,
    frame_rows,
    row_time,
)
from ledpi.camera.gain import FIRST_GAIN
from ledpi.camera.picamera_stream import ASKED_AHEAD, FAILURES, PicameraCamera
from ledpi.camera.picamera_version import OLDEST, UPDATE, is_too_old, picamera2_version, unforeseen, versions
from ledpi.camera.timing import frame_duration_us
from ledpi.camera.tuning import linear_tuning, white_gains
from ledpi.config.settings import CameraSettings
from ledpi.core.errors import CameraError, CameraLostError, LedpiError, raising
from ledpi.core.linux import who_holds
from ledpi.core.records import CameraInfo

_BUFFERS = ASKED_AHEAD + 1 + 3  # those asked for, one more in picamera2, and three for the camera to go on
_INSTALL = "sudo apt install python3-picamera2, and a virtual environment with --system-site-packages"


def open_picamera(settings: CameraSettings, frequencies_hz: Sequence[float], number: int = 0) -> PicameraCamera:
    """Opens, configures and starts the camera that picamera2 calls `number`. `frequencies_hz`: what panels blink at.

    Raises CameraLostError where there is no camera, it is in use or fails as it starts, CameraError where it does not
    do what was asked.
    """
    if (settings.width, settings.height) != MODE:
        raise CameraError(
            f"camera.width, camera.height: must be {MODE[0]} and {MODE[1]} with picamera2 (a scaled picture "
            f"has another row time), not {settings.width} and {settings.height}"
        )
    libcamera, picamera2 = _import_picamera2()
    try:
        return _open(libcamera, picamera2, settings, frequencies_hz, number)
    except (LedpiError, *FAILURES):
        raise
    except Exception as error:  # what another version does not know, or does otherwise
        raise unforeseen(error, libcamera) from error


def _open(
    libcamera: ModuleType, picamera2: ModuleType, settings: CameraSettings, frequencies_hz: Sequence[float], number: int
) -> PicameraCamera:
    model = model_of(libcamera, number)
    with raising(
        f"picamera2: libcamera's tuning file {model}.json cannot be used", CameraError, (RuntimeError, ValueError)
    ):
        tuning = picamera2.Picamera2.load_tuning_file(f"{model}.json")
        linear, colour_gains = linear_tuning(tuning), white_gains(tuning)
    try:
        picam2 = picamera2.Picamera2(number, tuning=linear)
    except FAILURES as error:
        holder = who_holds("/dev/media*") or "`sudo fuser -v /dev/media*` tells if another process holds it"
        why = error.__cause__ or error
        raise CameraLostError(f"picamera2: the camera cannot be opened ({why}); {holder}") from None
    opened: Any = picam2  # what to close where the rest fails
    try:
        asked, info = _configure(picam2, libcamera, settings, frequencies_hz, model, colour_gains)
        picam2.set_controls(asked)  # goes to the camera with its start
        picam2.start(show_preview=False)
        limits = picam2.camera_controls["AnalogueGain"][:2] if settings.analogue_gain == "auto" else None
        opened = camera = PicameraCamera(picam2, picamera2.MappedArray, info, limits, libcamera)
        camera.settle(asked)
        return camera
    except BaseException as error:
        with contextlib.suppress(Exception):  # of one that is half started; the first error counts
            opened.close()
        if isinstance(error, FAILURES):  # no memory for its buffers as the machine boots, say
            raise CameraLostError(f"{versions(libcamera)}: {error}") from None
        raise


def model_of(libcamera: ModuleType, number: int) -> str:
    """The sensor of the camera that picamera2 calls by that number, as "ov5647".

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
    except FAILURES as error:
        raise CameraLostError(f"picamera2: the cameras cannot be listed ({error})") from None
    if not found:
        raise CameraLostError("picamera2: no camera found; check the cable, and see rpicam-hello --list-cameras")
    if number >= len(found):
        there = ", ".join(f"picamera2:{k} ({model})" for k, (_, model) in enumerate(sorted(found, reverse=True)))
        raise CameraLostError(f"picamera2:{number}: there is no such camera; there is {there}")
    return str(sorted(found, reverse=True)[number][1])  # picamera2 sorts so


def _import_picamera2() -> tuple[ModuleType, ModuleType]:
    try:
        import libcamera
        import picamera2
    except ImportError as error:
        raise CameraError(f"picamera2: cannot be imported ({error}); {_INSTALL}") from None
    except ValueError as error:  # "numpy.dtype size changed": the system's simplejpeg was built for numpy 1
        raise CameraError(
            f"picamera2: cannot be imported ({error}); on Bookworm, install under constraints/bookworm.txt"
        ) from None
    except Exception as error:  # the two do not fit each other
        raise unforeseen(error, None) from error
    if is_too_old(found := picamera2_version()):
        raise CameraError(f"picamera2 {found} is too old; must be {OLDEST} or newer: {UPDATE}")
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
    check_limits(asked, picam2.camera_controls)
    info = CameraInfo(
        width=MODE[0],
        height=MODE[1],
        exposure_us=settings.exposure_us,
        row_time_us=row_time_us,
        transfer="linear" if settings.transfer == "auto" else settings.transfer,
        frame_length_rows=rows,
        rows_from=settings.rows_from,
    )
    return asked, info
