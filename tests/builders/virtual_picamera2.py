"""picamera2 on libcamera's virtual camera: what that lacks of a Pi's OV5647 is added here, around the real thing.

libcamera's virtual camera shows pictures, unpaced, has neither controls nor sensor modes, and needs memory of another
kind. So a subclass of `Picamera2` advertises the OV5647's controls and modes, keeps the sensor's pace, and writes into
each request's metadata what such a sensor would have done. All between is real: picamera2's choice of a mode, its
controls and libcamera's judgement of their types, its jobs, requests and mapped buffers.
"""

from __future__ import annotations

import ctypes
import mmap
import os
import sys
import threading
import time
import types
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import cv2
import numpy as np

INSTALLED = Path(sys.prefix)
# They are where the loader does not look; a path built into them would make libcamera look for its files elsewhere.
for _library in ("libcamera-base.so", "libcamera.so"):
    ctypes.CDLL(str(INSTALLED / "lib" / _library), mode=ctypes.RTLD_GLOBAL)

# picamera2's DRM preview imports it; nothing of it is used, but there must be one.
sys.modules.setdefault("pykms", types.ModuleType("pykms"))
sys.modules["pykms"].PixelFormat = SimpleNamespace(  # type: ignore[attr-defined]
    **dict.fromkeys(("RGB888", "BGR888", "XRGB8888", "XBGR8888", "YUV420", "YVU420", "NV12", "NV21", "YUYV", "YVYU"))
)

import libcamera  # noqa: E402
import picamera2.picamera2  # noqa: E402
from picamera2 import Picamera2  # noqa: E402
from picamera2.allocators.allocator import Allocator, Sync  # noqa: E402

VIRTUAL_YAML = INSTALLED / "share/libcamera/pipeline/virtual/virtual.yaml"
TUNING = INSTALLED / "share/libcamera/ipa/rpi"
ROW_US = 1852 / 58.333
MODES = [  # of the OV5647, drivers/media/i2c/ov5647.c
    {"format": "SGBRG10_CSI2P", "size": size} for size in ((640, 480), (1296, 972), (1920, 1080), (2592, 1944))
]


@dataclass
class Behaviour:
    """The sensor's doings. As it is here: an OV5647 at 58.333 MHz that does as told."""

    model: str = "ov5647"
    bit_depth: int = 10
    mode: tuple[int, int] | None = None  # another one than asked for
    limited_range: bool = False
    clock_offset_ns: int = 0
    unsettled: int = 2  # frames until controls act
    metadata: dict[str, Any] = field(default_factory=dict)  # what it reports other than as asked
    stalled: threading.Event = field(default_factory=threading.Event)
    failing: Exception | None = None  # of the next wait for a frame
    opened: list[VirtualPicamera2] = field(default_factory=list)
    tunings: list[str | None] = field(default_factory=list)  # that libcamera was pointed at, at each opening


class MemfdAllocator(Allocator):
    """Buffers in memory files, where there is no /dev/dma_heap: a plane for luma, and one for colour."""

    def __init__(self) -> None:
        super().__init__()
        self.sync = MappedSync
        self.mapped_buffers: dict[Any, mmap.mmap] = {}
        self._buffers: dict[Any, list[Any]] = {}
        self.count = 0  # as asked for: the virtual camera says 4, whatever it is asked, and takes more

    def allocate(self, libcamera_config: Any, _use_case: Any) -> None:
        self.close()
        for stream in libcamera_config:
            luma = stream.stride * stream.size.height
            self._buffers[stream.stream] = [self._buffer(stream.frame_size, luma) for _ in range(self.count)]

    def _buffer(self, size: int, luma: int) -> Any:
        fd = os.memfd_create("virtual-camera")
        os.ftruncate(fd, size)
        planes = []
        for offset, length in ((0, luma), (luma, size - luma)):
            plane = libcamera.FrameBuffer.Plane()
            plane.fd, plane.offset, plane.length = fd, offset, length
            planes.append(plane)
        buffer = libcamera.FrameBuffer(planes)
        self.mapped_buffers[buffer] = mmap.mmap(fd, size)
        os.close(fd)  # libcamera and the mapping have their own
        return buffer

    def buffers(self, stream: Any) -> list[Any]:
        return self._buffers[stream]

    def close(self) -> None:
        self.mapped_buffers.clear()
        self._buffers.clear()


class MappedSync(Sync):
    def __init__(self, allocator: MemfdAllocator, buffer: Any, write: bool) -> None:
        self._memory = allocator.mapped_buffers[buffer]

    def __enter__(self) -> mmap.mmap:
        return self._memory

    def __exit__(self, *args: object) -> None:
        pass

    get_buffer = __enter__


picamera2.picamera2.DmaAllocator = MemfdAllocator


class _FirstStays(dict[str, Any]):
    """picamera2 adds what the virtual camera advertises; what is there already is the sensor's."""

    def __setitem__(self, name: str, value: Any) -> None:
        self.setdefault(name, value)


class VirtualPicamera2(Picamera2):
    """An OV5647, as far as picamera2 can tell."""

    behaviour: ClassVar[Behaviour] = Behaviour()
    _loop: threading.Thread | None = None
    _due: ClassVar[list[Any]] = []

    @staticmethod
    def load_tuning_file(tuning_file: str, dir: str | None = None) -> dict[str, Any]:
        return Picamera2.load_tuning_file(tuning_file, dir or str(TUNING / "vc4"))

    # -- Modes and controls

    @property
    def camera_ctrl_info(self) -> dict[str, Any]:
        return self._advertised

    @camera_ctrl_info.setter
    def camera_ctrl_info(self, found: dict[str, Any]) -> None:
        names = libcamera.controls
        shortest_us = int(504 * ROW_US)
        ranges = {
            names.AeEnable: (False, True),
            names.ExposureTime: (int(4 * ROW_US), 3_066_979),
            names.AnalogueGain: (1.0, 63.9375),
            names.AwbEnable: (False, True),
            names.ColourGains: (0.0, 32.0),
            names.FrameDurationLimits: (shortest_us, 1_000_000),
            names.draft.NoiseReductionMode: (0, 4),
            names.Sharpness: (0.0, 16.0),
            names.Contrast: (0.0, 32.0),
            names.Saturation: (0.0, 32.0),
            names.Brightness: (-1.0, 1.0),
        }
        self._advertised = _FirstStays(
            (key.name, (key, SimpleNamespace(min=least, max=most, default=least)))
            for key, (least, most) in ranges.items()
        )

    def _get_raw_modes(self) -> list[dict[str, Any]]:
        return MODES

    def _is_rpi_camera(self) -> bool:
        return True

    def _open_camera(self) -> None:
        VirtualPicamera2.behaviour.tunings.append(os.environ.get("LIBCAMERA_RPI_TUNING_FILE"))
        super()._open_camera()
        self._number = 0
        self.asked: list[tuple[int, dict[str, Any]]] = []  # from this frame on, these controls
        VirtualPicamera2.behaviour.opened.append(self)

    def configure_(self, camera_config: Any) -> None:
        wanted = camera_config["colour_space"]
        self.allocator.count = camera_config["buffer_count"]
        super().configure_(camera_config)
        behaviour = self.behaviour
        if not behaviour.limited_range:  # the virtual camera knows Rec709 only
            self.camera_config["colour_space"] = wanted
        self.camera_config["sensor"]["bit_depth"] = behaviour.bit_depth
        if behaviour.mode is not None:
            self.camera_config["sensor"]["output_size"] = behaviour.mode

    def start_(self) -> None:
        self._number = 0
        self.asked = [(self.behaviour.unsettled, self.controls.make_dict())]
        self._start_ns = time.monotonic_ns()
        super().start_()

    def set_controls(self, controls: Any) -> None:
        super().set_controls(controls)
        if self.started:
            latest = self.asked[-1][1]
            self.asked.append((self._number + self.behaviour.unsettled, latest | controls))

    # -- Pace, and metadata

    @property
    def _requests(self) -> list[Any]:
        """picamera2's list of what libcamera has completed: to its event loop, only what is due."""
        return self._due if threading.current_thread() is self._loop else self._completed

    @_requests.setter
    def _requests(self, requests: list[Any]) -> None:
        if threading.current_thread() is self._loop:
            self._due = requests
        else:
            self._completed = requests

    def process_requests(self, display: Any) -> None:
        """As picamera2's, but one request a frame period, and none while the sensor is stalled."""
        self._loop = threading.current_thread()
        if self.behaviour.failing is not None:
            self._fail_whoever_waits()
        if self._completed and self.started and not self.behaviour.stalled.is_set():
            metadata = self._photograph()
            with self._requestslock:
                request = self._completed.pop(0)
            request.get_metadata = lambda: metadata
            self._due = [request]
            self._run_process_requests()  # for those that wait, and have had their notice
        super().process_requests(display)

    def _fail_whoever_waits(self) -> None:
        with self.lock:
            if self._job_list:
                self._job_list.pop(0)._future.set_exception(self.behaviour.failing)
                self.behaviour.failing = None

    def _photograph(self) -> dict[str, Any]:
        """Waits for the next frame's read-out, and says how it was made."""
        acting = [asked for since, asked in self.asked if self._number >= since]
        asked = acting[-1] if acting else {"ExposureTime": 1500, "AnalogueGain": 1.0, "FrameDurationLimits": (16001, 0)}
        rows = max(504, int(asked["FrameDurationLimits"][0] / ROW_US))
        period_ns = round(rows * ROW_US * 1e3)
        # Frames that are due wait in buffers; what finds none is lost, as a sensor does not wait.
        due = (time.monotonic_ns() - self._start_ns) // period_ns
        lost = max(0, due - len(self._completed))
        self._start_ns += lost * period_ns
        readout_ns = self._start_ns + round(504 * ROW_US * 1e3)
        self._start_ns += period_ns
        self._number += 1 + lost
        time.sleep(max(0.0, (readout_ns + 480 * ROW_US * 1e3 - time.monotonic_ns()) * 1e-9))
        made = {
            "SensorTimestamp": readout_ns + self.behaviour.clock_offset_ns,
            "ExposureTime": int(int(asked["ExposureTime"] / ROW_US) * ROW_US),
            "AnalogueGain": int(asked["AnalogueGain"] * 16) / 16,
            "FrameDuration": int(rows * ROW_US),
        }
        return made | self.behaviour.metadata


def show(folder: Path, pictures: list[np.ndarray], model: str = "ov5647") -> None:
    """Plugs in a virtual camera that shows these grey pictures (480, 640), each four times, over and over."""
    folder.mkdir(parents=True, exist_ok=True)
    for number, picture in enumerate(pictures):
        colour = cv2.cvtColor(picture, cv2.COLOR_GRAY2BGR)
        cv2.imwrite(str(folder / f"{number}.jpg"), colour, (cv2.IMWRITE_JPEG_QUALITY, 100))
    _describe("Virtual0", f'frames: {{path: "{folder}/"}}', model)


def unplug() -> None:
    """Takes it away: libcamera's next manager finds a webcam only, which is none of the Pi's.

    Were there no virtual camera at all, libcamera would not look for one again in this process.
    """
    _describe("/usb/webcam", 'test_pattern: "bars"', "webcam")


def _describe(name: str, what_it_shows: str, model: str) -> None:
    """Puts the file there whole: a daemon that looks for its camera just then would find none, and never again."""
    written = VIRTUAL_YAML.with_suffix(".new")
    written.write_text(
        f"""%YAML 1.1
---
"{name}":
  supported_formats:
  - {{width: 640, height: 480, frame_rates: [30]}}
  {what_it_shows}
  location: "CameraLocationFront"
  model: "{model}"
"""
    )
    written.replace(VIRTUAL_YAML)


def use(behaviour: Behaviour, replace: Callable[[Any, str, Any], None]) -> None:
    """Puts the subclass where `import picamera2` finds `Picamera2`; `replace` is setattr, or a monkeypatch's."""
    import picamera2 as package

    replace(package, "Picamera2", VirtualPicamera2)
    replace(VirtualPicamera2, "behaviour", behaviour)
