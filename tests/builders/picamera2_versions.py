"""Stand-ins for picamera2 by version: each takes the calls that its version takes, and no others.

The signatures are those of picamera2's tags, v0.3.12 (July 2023) to v0.3.36 (May 2026). Behind them is an OV5647 that
does as told.
"""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable
from concurrent.futures import CancelledError
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np

VIDEO = (
    "main={}, lores=None, raw={}, transform=None, colour_space=None, buffer_count=6, controls={}, "
    "display='main', encode='main', queue=True"
)
# What changed in which version; the next ones have it, too. None: there is no such thing.
CHANGES: dict[str, dict[str, str | None]] = {
    "0.3.12": {
        "Picamera2": "camera_num=0, verbose_console=None, tuning=None",
        "create_video_configuration": VIDEO,
        "configure": "camera_config='preview'",
        "camera_configuration": "",
        "set_controls": "controls",
        "start": "config=None, show_preview=False",
        "capture_request": "wait=None, signal_function=None",
        "cancel_all_and_flush": None,
        "close": "",
        "get_result": "",
        "MappedArray": "request, stream, reshape=True",
    },
    "0.3.13": {
        "create_video_configuration": f"{VIDEO}, sensor={{}}",
        "MappedArray": "request, stream, reshape=True, write=True",
    },
    "0.3.15": {"capture_request": "wait=None, signal_function=None, flush=None"},
    "0.3.17": {
        "Picamera2": "camera_num=0, verbose_console=None, tuning=None, allocator=None",
        "create_video_configuration": f"{VIDEO}, sensor={{}}, use_case='video'",
        "get_result": "timeout=None",
    },
    "0.3.20": {"cancel_all_and_flush": ""},
    "0.3.24": {"configure": "camera_config=None"},
    "0.3.36": {},
}
ROW_US = 33.67
TUNING = {
    "version": 2.0,
    "algorithms": [
        {"rpi.contrast": {"gamma_curve": [0, 0, 65535, 65535], "ce_enable": 1}},
        {"rpi.ccm": {"ccms": []}},
        {"rpi.awb": {"ct_curve": [2500, 1.0, 0.36, 5000, 0.7, 0.5, 7000, 0.6, 0.6]}},
    ],
}


def signatures(version: str) -> dict[str, inspect.Signature | None]:
    """By name, of a version in CHANGES."""
    known: dict[str, str | None] = {}
    for since, changes in CHANGES.items():
        known |= changes
        if since == version:
            break
    return {name: None if text is None else _signature(text) for name, text in known.items()}


def _signature(text: str) -> inspect.Signature:
    signature: inspect.Signature = eval(f"__import__('inspect').signature(lambda {text}: None)")
    return signature


class Sensor:
    """Picamera2's methods. `forgetful`: what is asked before the start is lost. `failing`: raised by reads."""

    def __init__(self, *, forgetful: bool = False, obeys: bool = True, failing: Exception | None = None) -> None:
        self.camera_controls = {
            "AnalogueGain": (1.0, 63.9, None),
            "ExposureTime": (134, 3_000_000, None),
            "FrameDurationLimits": (16_971, 1_000_000, None),
        }
        self.closed = False
        self._forgetful, self._obeys, self.failing = forgetful, obeys, failing
        self._started = False
        self._asked: dict[str, Any] = {}
        self._configuration: dict[str, Any] = {}
        self._due_ns = 0

    def create_video_configuration(self, **asked: Any) -> dict[str, Any]:
        return asked

    def configure(self, camera_config: dict[str, Any]) -> None:
        self._configuration = camera_config

    def camera_configuration(self) -> dict[str, Any]:
        main = {"size": (640, 480), "format": "YUV420"}
        return {
            "sensor": {"output_size": (640, 480), "bit_depth": 10},
            "main": main,
            "colour_space": self._configuration["colour_space"],
        }

    def set_controls(self, controls: dict[str, Any]) -> None:
        if self._obeys and (self._started or not self._forgetful):
            self._asked |= controls

    def start(self, show_preview: bool) -> None:
        self._started = True

    def capture_request(self, wait: bool) -> None:
        pass

    def cancel_all_and_flush(self) -> None:
        pass

    def close(self) -> None:
        self.closed = True

    def get_result(self, timeout: float) -> Any:
        """The next frame's, half a millisecond after the last."""
        if self.closed:
            raise CancelledError
        if self.failing is not None:
            raise self.failing
        time.sleep(0.0005)
        self._due_ns = max(self._due_ns + 1000, time.monotonic_ns() - 5_000_000)
        metadata = {
            "SensorTimestamp": self._due_ns,
            "ExposureTime": int(self._asked.get("ExposureTime", 66_657) // ROW_US * ROW_US),
            "AnalogueGain": self._asked.get("AnalogueGain", 4.0),
            "FrameDuration": int(self._asked.get("FrameDurationLimits", [66_657])[0] // ROW_US * ROW_US),
        }
        array = np.full((720, 640), 20, np.uint8)
        return SimpleNamespace(get_metadata=lambda: metadata, release=lambda: None, array=array)


def stand_in(version: str, sensor: Sensor) -> tuple[ModuleType, ModuleType]:
    """picamera2 of that version, before this sensor, and a libcamera."""
    known = signatures(version)

    def checked(name: str, do: Callable[..., Any]) -> Callable[..., Any]:
        signature = known[name]
        assert signature is not None

        def call(*given: Any, **named: Any) -> Any:
            signature.bind(*given, **named)
            return do(*given, **named)

        return call

    def opened(*given: Any, **named: Any) -> SimpleNamespace:
        signature = known["Picamera2"]
        assert signature is not None
        signature.bind(*given, **named)
        methods = [name for name in known if hasattr(sensor, name) and known[name] is not None and name != "get_result"]
        calls = {name: checked(name, getattr(sensor, name)) for name in methods}
        job = SimpleNamespace(get_result=checked("get_result", sensor.get_result))
        calls["capture_request"] = checked("capture_request", lambda wait: job)
        return SimpleNamespace(camera_controls=sensor.camera_controls, **calls)

    class MappedArray:
        def __init__(self, *given: Any, **named: Any) -> None:
            signature = known["MappedArray"]
            assert signature is not None
            self.array = signature.bind(*given, **named).arguments["request"].array

        def __enter__(self) -> MappedArray:
            return self

        def __exit__(self, *_: object) -> None:
            pass

    picamera2, libcamera = ModuleType("picamera2"), ModuleType("libcamera")
    opened.load_tuning_file = lambda tuning_file, dir=None: TUNING  # type: ignore[attr-defined]
    picamera2.Picamera2, picamera2.MappedArray = opened, MappedArray  # type: ignore[attr-defined]
    model = SimpleNamespace(name="Model")
    properties = SimpleNamespace(items=lambda: [(model, "ov5647")])  # libcamera's keys are objects with a name
    camera = SimpleNamespace(id="/base/soc/i2c0mux/i2c@1/ov5647@36", properties=properties)
    manager = SimpleNamespace(cameras=[camera])
    libcamera.CameraManager = SimpleNamespace(singleton=lambda: manager, version="v0.5.2")  # type: ignore[attr-defined]
    libcamera.ColorSpace = SimpleNamespace(Sycc=lambda: SimpleNamespace(range="full"))  # type: ignore[attr-defined]
    off = SimpleNamespace(NoiseReductionModeEnum=SimpleNamespace(Off=0))
    libcamera.controls = SimpleNamespace(draft=off)  # type: ignore[attr-defined]
    return picamera2, libcamera
