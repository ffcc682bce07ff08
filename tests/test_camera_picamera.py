"""The Pi's camera, as far as that goes without one.

What runs here for real: the absence of picamera2, and all that is decided before and after its calls. What
stands in for picamera2 below follows its sources; the real library has the last word.
"""

from __future__ import annotations

import sys
import threading
import time
from concurrent.futures import CancelledError, Future
from dataclasses import dataclass, field
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any, ClassVar

import numpy as np
import pytest

from ledpi.camera.picamera import PicameraCamera, open_picamera
from ledpi.config import CameraSettings
from ledpi.errors import CameraError
from ledpi.records import Frame, Rejected

CLASSES_HZ = (1250.0, 2450.0)
WAIT_S = 10.0
STRIDE = 704  # padded, as on a Pi 5
AUTOMATICS_OFF = {
    "AeEnable": False,
    "AwbEnable": False,
    "ColourGains": (1.0, 1.0),
    "NoiseReductionMode": "off",
    "Sharpness": 0.0,
    "Contrast": 1.0,
    "Saturation": 1.0,
    "Brightness": 0.0,
}


@dataclass
class Behaviour:
    """What the camera under the stand-in does. The default is an OV5647 at 58.333 MHz that does as told."""

    cameras: list[dict[str, Any]] = field(default_factory=lambda: [{"Num": 0, "Model": "ov5647"}])
    mode: tuple[int, int] = (640, 480)
    colour_range: str = "full"
    shortest_us: int = 16001  # 504 · 1852 / 58.333 = 16001.3
    unsettled: int = 3  # frames until the controls act
    metadata: dict[str, Any] = field(default_factory=dict)  # what it reports other than as asked
    frames: int = 1000  # then it stalls
    open_error: Exception | None = None


class Request:
    def __init__(self, camera: StandIn, number: int) -> None:
        self.camera, self.number, self.released = camera, number, False
        buffer = np.full((720, STRIDE), 255, np.uint8)  # chroma and padding, which must not arrive
        buffer[:480, :640] = number
        self.buffer = buffer

    def get_metadata(self) -> dict[str, Any]:
        asked = self.camera.asked
        row_us = 1852 / 58.333
        duration_us = int(asked["FrameDurationLimits"][0] / row_us) * row_us
        metadata = {
            "SensorTimestamp": self.camera.start_ns + round(self.number * duration_us * 1e3),
            "ExposureTime": int(int(asked["ExposureTime"] / row_us) * row_us),
            "AnalogueGain": int(asked["AnalogueGain"] * 16) / 16,
            "FrameDuration": round(duration_us),
        }
        if self.number < self.camera.behaviour.unsettled:
            metadata |= {"ExposureTime": 1500}
        return metadata | self.camera.behaviour.metadata

    def release(self) -> None:
        assert not self.released
        self.released = True


class StandIn:
    """The part of picamera2.Picamera2 that is used, and no more."""

    behaviour: ClassVar[Behaviour] = Behaviour()
    instances: ClassVar[list[StandIn]] = []

    def __init__(self, index: int) -> None:
        assert index == 0
        if self.behaviour.open_error is not None:
            raise RuntimeError("Camera __init__ sequence did not complete.") from self.behaviour.open_error
        self.asked: dict[str, Any] = {}
        self.requests: list[Request] = []
        self.waiting: Future[Request] | None = None
        self.started = self.closed = False
        self.camera_controls: dict[str, Any] = {}
        StandIn.instances.append(self)

    @classmethod
    def global_camera_info(cls) -> list[dict[str, Any]]:
        return cls.behaviour.cameras

    def create_video_configuration(self, **values: Any) -> dict[str, Any]:
        return values

    def configure(self, configuration: dict[str, Any]) -> None:
        assert configuration["sensor"] == {"output_size": (640, 480), "bit_depth": 10}
        assert configuration["colour_space"] == "sycc"
        self.configuration = configuration | {"sensor": {"output_size": self.behaviour.mode, "bit_depth": 10}}
        colours = SimpleNamespace(range=self.behaviour.colour_range)
        self.libcamera_config = SimpleNamespace(at=lambda index: SimpleNamespace(color_space=colours))
        self.camera_controls = {"FrameDurationLimits": (self.behaviour.shortest_us, 10_000_000, None)}

    def camera_configuration(self) -> dict[str, Any]:
        return self.configuration

    def set_controls(self, controls: dict[str, Any]) -> None:
        assert not self.started
        self.asked = controls

    def start(self, *, show_preview: bool) -> None:
        self.started = True
        self.start_ns = time.monotonic_ns() - 900_000_000  # it is not paced: its frames must not lie ahead

    def capture_request(self, *, wait: bool) -> SimpleNamespace:
        assert all(request.released for request in self.requests)
        future: Future[Request] = Future()
        if len(self.requests) < self.behaviour.frames:
            request = Request(self, len(self.requests))
            self.requests.append(request)
            future.set_result(request)
        else:
            self.waiting = future
        return SimpleNamespace(get_result=lambda timeout: future.result(timeout))

    def cancel_all_and_flush(self) -> None:
        if self.waiting is not None and not self.waiting.done():
            self.waiting.set_exception(CancelledError())

    def close(self) -> None:
        self.closed = True


class MappedArray:
    def __init__(self, request: Request, stream: str, *, write: bool) -> None:
        assert (stream, write) == ("main", False)
        assert not request.released
        self.array = request.buffer

    def __enter__(self) -> MappedArray:
        return self

    def __exit__(self, *args: object) -> None:
        pass


@pytest.fixture
def behaviour(monkeypatch: pytest.MonkeyPatch) -> Behaviour:
    """Puts the stand-in where `import picamera2` and `import libcamera` find it."""
    picamera2, libcamera = ModuleType("picamera2"), ModuleType("libcamera")
    picamera2.Picamera2, picamera2.MappedArray = StandIn, MappedArray  # type: ignore[attr-defined]
    ranges = SimpleNamespace(Full="full", Limited="limited")
    libcamera.ColorSpace = SimpleNamespace(Sycc=lambda: "sycc", Range=ranges)  # type: ignore[attr-defined]
    off = SimpleNamespace(NoiseReductionModeEnum=SimpleNamespace(Off="off"))
    libcamera.controls = SimpleNamespace(draft=off)  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "picamera2", picamera2)
    monkeypatch.setitem(sys.modules, "libcamera", libcamera)
    monkeypatch.setattr(StandIn, "behaviour", Behaviour())
    monkeypatch.setattr(StandIn, "instances", [])
    return StandIn.behaviour


def opened(**settings: Any) -> PicameraCamera:
    return open_picamera(CameraSettings(**settings), CLASSES_HZ)


def refusal(**settings: Any) -> str:
    with pytest.raises(CameraError) as caught:
        opened(**settings)
    assert all(camera.closed for camera in StandIn.instances)
    assert all(request.released for camera in StandIn.instances for request in camera.requests)
    message = str(caught.value)
    assert "\n" not in message
    return message


def picture() -> np.ndarray:
    return np.zeros((480, 640), np.uint8)


# ---- For real, without picamera2


def test_without_picamera2_the_remedy_is_named() -> None:
    """On a machine without the system's picamera2 the error says what to install, and how."""
    try:
        import picamera2  # noqa: F401
    except ImportError:
        pass
    else:
        pytest.skip("picamera2 is installed here")
    with pytest.raises(CameraError) as caught:
        opened()
    message = str(caught.value)
    assert "picamera2: cannot be imported (No module named" in message
    assert "sudo apt install python3-picamera2" in message
    assert "--system-site-packages" in message


def test_a_numpy_that_does_not_fit_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A system package built for numpy 1 fails with a ValueError on import; the remedy is another one."""
    (tmp_path / "libcamera.py").write_text("raise ValueError('numpy.dtype size changed')")
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.delitem(sys.modules, "libcamera", raising=False)
    with pytest.raises(CameraError, match=r"numpy.dtype size changed.*constraints/bookworm.txt"):
        opened()


def test_another_size_is_refused_before_anything_is_opened() -> None:
    """A scaled picture has another row time; the message says so, with the keys."""
    with pytest.raises(CameraError, match=r"camera.width, camera.height: must be 640 and 480 .* 800 and 600"):
        opened(width=800, height=600)


# ---- With the stand-in


def test_everything_is_fixed_before_the_start(behaviour: Behaviour) -> None:
    """Exposure, gain and frame period as asked, all automatics off, with the types that libcamera accepts."""
    opened(exposure_us=10000.4, analogue_gain=2)
    asked = StandIn.instances[0].asked
    assert {key: asked[key] for key in AUTOMATICS_OFF} == AUTOMATICS_OFF
    assert (asked["ExposureTime"], type(asked["ExposureTime"])) == (10000, int)
    assert (asked["AnalogueGain"], type(asked["AnalogueGain"])) == (2.0, float)
    shortest, longest = asked["FrameDurationLimits"]
    assert shortest == longest
    assert type(shortest) is int
    assert set(asked) == {*AUTOMATICS_OFF, "ExposureTime", "AnalogueGain", "FrameDurationLimits"}


def test_row_time_and_frame_length_come_from_the_configured_camera(behaviour: Behaviour) -> None:
    """At 58.333 MHz a row takes 31.75 µs, and 509 rows keep the phases of 1250 and 2450 Hz moving."""
    info = opened().info
    assert info.row_time_us == pytest.approx(1852 / 58.333, rel=1e-4)
    assert info.frame_length_rows == 509
    assert (info.width, info.height, info.exposure_us) == (640, 480, 10000.0)
    assert info.transfer == "srgb"
    assert info.intrinsics is None


def test_measured_values_override_the_camera_s(behaviour: Behaviour) -> None:
    """What `ledpi calibrate shutter` measured, and the tone that the owner knows, are taken."""
    info = opened(row_time_us=31.8, transfer="linear").info
    assert (info.row_time_us, info.transfer) == (31.8, "linear")


def test_only_luma_arrives_and_in_one_copy(behaviour: Behaviour) -> None:
    """The frame's pixels are the given array, without the padding at the right and the chroma below."""
    camera, into = opened(), picture()
    frame = camera.read(into)
    assert isinstance(frame, Frame)
    assert frame.pixels.base is into
    assert (into == StandIn.instances[0].requests[-1].number).all()
    assert into.flags.writeable


def test_picture_and_metadata_are_of_one_request(behaviour: Behaviour) -> None:
    """Each frame carries the time, exposure and gain of the very request that its pixels came from."""
    camera, into = opened(), picture()
    for _ in range(5):
        frame = camera.read(into)
        assert isinstance(frame, Frame)
        metadata = StandIn.instances[0].requests[int(into[0, 0])].get_metadata()
        assert frame.row0_readout_ns == metadata["SensorTimestamp"]
        assert (frame.exposure_us, frame.analogue_gain) == (metadata["ExposureTime"], 4.0)
        assert frame.host_offset_ns == 0


def test_frames_before_the_controls_act_are_not_handed_out(behaviour: Behaviour) -> None:
    """The first frames still have another exposure; none of them is seen."""
    behaviour.unsettled = 7
    frame = opened().read(picture())
    assert isinstance(frame, Frame)
    assert 10000 - 31.75 <= frame.exposure_us <= 10000


def test_every_request_is_released(behaviour: Behaviour) -> None:
    """A request that is kept starves the camera of buffers."""
    camera = opened()
    for _ in range(20):
        camera.read(picture())
    camera.close()
    assert all(request.released for request in StandIn.instances[0].requests)
    assert StandIn.instances[0].closed


def test_a_missed_frame_leaves_a_gap_in_seq(behaviour: Behaviour) -> None:
    """seq follows the camera's time, as its frames are not numbered."""
    camera = opened()
    first = camera.read(picture())
    StandIn.instances[0].requests += [Request(StandIn.instances[0], 0) for _ in range(2)]  # taken by nobody
    for request in StandIn.instances[0].requests[-2:]:
        request.release()
    second = camera.read(picture())
    assert isinstance(first, Frame)
    assert isinstance(second, Frame)
    assert (first.seq, second.seq) == (0, 3)


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"ExposureTime": 9900}, "capture.exposure"),
        ({"ExposureTime": None}, "capture.exposure"),
        ({"SensorTimestamp": None}, "capture.timestamp"),
        ({"SensorTimestamp": 1}, "capture.timestamp"),
    ],
)
def test_a_frame_made_otherwise_is_rejected(behaviour: Behaviour, change: dict[str, Any], key: str) -> None:
    """A frame with another exposure, without a time, or out of time, is dropped; the next one is read."""
    camera = opened()
    assert isinstance(camera.read(picture()), Frame)
    behaviour.metadata = change
    rejected = camera.read(picture())
    assert isinstance(rejected, Rejected)
    assert rejected.key == key
    behaviour.metadata = {}
    assert isinstance(camera.read(picture()), Frame)


def test_no_camera_is_said(behaviour: Behaviour) -> None:
    """picamera2 without a camera: what to check."""
    behaviour.cameras = []
    assert refusal().startswith("picamera2: no camera found; check the cable")


def test_a_camera_in_use_is_said(behaviour: Behaviour) -> None:
    """The reason that lies under picamera2's own error is what helps."""
    behaviour.open_error = RuntimeError("Device or resource busy")
    assert "cannot be opened (Device or resource busy); if another process holds it" in refusal()


def test_another_sensor_mode_is_refused(behaviour: Behaviour) -> None:
    """libcamera may choose another mode than the one asked for; its rows take another time."""
    behaviour.mode = (1296, 972)
    assert refusal().startswith("picamera2: the sensor's mode is (1296, 972); must be (640, 480), whose row")


def test_limited_range_is_refused(behaviour: Behaviour) -> None:
    """Luma squeezed into 16..235 would bend every brightness that the decoder sees."""
    behaviour.colour_range = "limited"
    assert "must be full range" in refusal()


def test_another_sensor_needs_a_measured_row_time(behaviour: Behaviour) -> None:
    """The rows of a sensor that is not known are not guessed; with the measured value it runs."""
    behaviour.cameras = [{"Num": 0, "Model": "imx219"}]
    assert refusal().startswith("camera.row_time_us: auto is for ov5647, and this camera is imx219; measure")
    assert opened(row_time_us=31.75).info.row_time_us == 31.75


@pytest.mark.parametrize(
    ("metadata", "message"),
    [
        ({"ExposureTime": 8000}, "camera.exposure_us: 10000 µs was asked, and the camera reports 8000"),
        ({"ExposureTime": 10033}, "camera.exposure_us: 10000 µs was asked, and the camera reports 10033"),
        ({"AnalogueGain": 1.0}, "camera.analogue_gain: 4.0 was asked, and the camera reports 1.0"),
        ({"FrameDuration": 33333}, "camera.frame_duration_us: 16168 µs was asked, and the camera reports"),
    ],
)
def test_a_camera_that_does_not_do_as_asked_is_refused(
    behaviour: Behaviour, metadata: dict[str, Any], message: str
) -> None:
    """The key, what was asked, and what the camera did."""
    behaviour.metadata = metadata
    assert refusal().startswith(f"picamera2: {message}")


def test_another_clock_is_refused(behaviour: Behaviour) -> None:
    """A timestamp of another clock would make every age on the wire wrong."""
    behaviour.metadata = {"SensorTimestamp": time.time_ns()}
    assert "is not of CLOCK_MONOTONIC" in refusal()


@pytest.mark.parametrize(("exposure_us", "shortest_us"), [(10000, 16001), (20000, 20096)])
def test_a_frame_period_shorter_than_possible_is_refused(
    behaviour: Behaviour, exposure_us: float, shortest_us: int
) -> None:
    """504 rows of the mode, or the exposure and 4 rows (629 + 4 rows of 31.748 µs), whichever is longer."""
    message = refusal(exposure_us=exposure_us, frame_duration_us=10_000)
    assert message == f"camera.frame_duration_us: must be at least {shortest_us} here, not 10000"


def test_a_long_exposure_lengthens_the_frame(behaviour: Behaviour) -> None:
    """With 20 ms of exposure the frame is at least as long, without being asked."""
    rows = opened(exposure_us=20000).info.frame_length_rows
    assert rows is not None
    assert rows >= 633


def test_frequencies_that_stand_still_in_every_frame_are_said(behaviour: Behaviour) -> None:
    """No period helps a frequency with whole cycles in each row; the key to set is named."""
    with pytest.raises(CameraError, match=r"^camera.frame_duration_us: no frame of "):
        open_picamera(CameraSettings(row_time_us=25.0), (40_000.0,))
    assert StandIn.instances[0].closed


def test_a_stall_is_an_error(behaviour: Behaviour, monkeypatch: pytest.MonkeyPatch) -> None:
    """A camera that delivers nothing is reported, not waited for."""
    monkeypatch.setattr("ledpi.camera.picamera._STALL_S", 0.05)
    behaviour.frames = 4
    camera = opened()
    with pytest.raises(CameraError, match=r"delivered nothing for 0\.05 s"):
        camera.read(picture())
    camera.close()
    assert StandIn.instances[0].closed


def test_close_ends_a_waiting_read(behaviour: Behaviour, monkeypatch: pytest.MonkeyPatch) -> None:
    """Closing from another thread: the read gives None, and the camera is closed only after it has let go."""
    monkeypatch.setattr("ledpi.camera.picamera._STALL_S", WAIT_S)
    behaviour.frames = 4
    camera = opened()
    got: list[object] = []
    reader = threading.Thread(target=lambda: got.append(camera.read(picture())))
    reader.start()
    time.sleep(0.05)
    camera.close()
    camera.close()
    reader.join(WAIT_S / 2)
    assert got == [None]
    assert camera.read(picture()) is None
