"""V4L2 devices, as far as that goes without one: a stand-in for OpenCV's capture, and the real absence."""

from __future__ import annotations

import logging
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import cv2
import numpy as np
import pytest

from ledpi.camera.simulate.scenes import still_scene
from ledpi.camera.simulated import SimulatedCamera, simulated_sensor
from ledpi.camera.v4l2 import V4l2Camera, open_v4l2
from ledpi.config.settings import CameraSettings, load_config
from ledpi.core.errors import CameraError
from ledpi.core.records import Frame, Rejected
from tests.builders.command import in_process

DEVICE = "/dev/null"  # exists; the stand-in does not look at it
READOUT_NS = 480 * 30_000


def test_the_shutter_of_a_device_that_cannot_tell_its_row_time_is_measured(
    device: set[int], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With nothing but `camera.source`: 33.67 µs are measured, and written where the daemon then reads them."""
    monkeypatch.chdir(tmp_path)
    Path("config.yaml").write_text(f"camera: {{source: 'v4l2:{DEVICE}'}}\npanels: {{side_m: 0.16}}\n")
    monkeypatch.setattr(cv2, "VideoCapture", Watching)
    monkeypatch.setattr("ledpi.camera.v4l2.time", SimpleNamespace(monotonic_ns=lambda: Watching.now_ns))
    status, out, _ = in_process(monkeypatch, capsys)("calibrate", "shutter", "--frames", "40")
    assert status == 0
    assert "the driver does not report one" in out
    assert load_config(Path("config.yaml")).camera.row_time_us == pytest.approx(33.67, rel=2e-3)


class StandIn:
    """cv2.VideoCapture with a device whose properties are a table; those in `fixed` cannot be set."""

    last: StandIn

    def __init__(self, device: str, backend: int) -> None:
        assert backend == cv2.CAP_V4L2
        self.values: dict[int, float] = {cv2.CAP_PROP_EXPOSURE: 156.0}
        self.fixed: set[int] = set(STAND_IN_FIXED)
        self.picture: np.ndarray | None = np.zeros((480, 640, 3), np.uint8)
        self.stamp_ns: int | None = None
        self.released = False
        StandIn.last = self

    def isOpened(self) -> bool:  # noqa: N802
        return True

    def set(self, key: int, value: float) -> bool:
        if key not in self.fixed:
            self.values[key] = value
        return key not in self.fixed

    def get(self, key: int) -> float:
        if key == cv2.CAP_PROP_POS_MSEC:
            return (time.monotonic_ns() - READOUT_NS if self.stamp_ns is None else self.stamp_ns) * 1e-6
        return self.values.get(key, 0.0)

    def read(self, buffer: np.ndarray) -> tuple[bool, Any]:
        return self.picture is not None, self.picture

    def release(self) -> None:
        self.released = True


class Watching(StandIn):
    """One that looks at panel 7 at 1 m. Its clock stands still between two frames: no busy machine misses one."""

    now_ns = 0

    def __init__(self, device: str, backend: int) -> None:
        super().__init__(device, backend)
        config = load_config(None, ("camera.source=simulated",))
        sensor = simulated_sensor(config.camera, config.panels)
        scene = still_scene(sensor, {7: config.panels.spec()}, "DICT_4X4_50", distance_m=1.0, angle_deg=0.0)
        self._camera = SimulatedCamera(scene, seed=0, paced=False)

    def read(self, buffer: np.ndarray) -> tuple[bool, Any]:
        grey = np.empty((480, 640), np.uint8)
        frame = self._camera.read(grey)
        assert isinstance(frame, Frame)
        self.stamp_ns = frame.row0_readout_ns
        Watching.now_ns = self.stamp_ns + 20_000_000
        return True, grey


STAND_IN_FIXED: set[int] = set()


@pytest.fixture
def device(monkeypatch: pytest.MonkeyPatch) -> set[int]:
    """Puts the stand-in in the place of OpenCV's capture; returns what of it cannot be set."""
    monkeypatch.setattr(cv2, "VideoCapture", StandIn)
    STAND_IN_FIXED.clear()
    return STAND_IN_FIXED


def opened(**settings: Any) -> tuple[V4l2Camera, StandIn]:
    return open_v4l2(CameraSettings(row_time_us=30.0, **settings), DEVICE), StandIn.last


@pytest.mark.parametrize(
    ("row_time_us", "path", "says"),
    [
        (30.0, "/dev/video77", r"^camera.source: /dev/video77 does not exist"),
        (30.0, "/dev/null", r"^camera.source: /dev/null is no video device; see v4l2-ctl"),
        ("auto", "/dev/video77", r"^camera.row_time_us: must be a number, as V4L2 cannot tell"),
    ],
)
def test_what_cannot_be_opened_is_named(row_time_us: Any, path: str, says: str) -> None:
    """For real: the key and the device. A guess at the row time would decode nothing."""
    with pytest.raises(CameraError, match=says):
        open_v4l2(CameraSettings(row_time_us=row_time_us), path)


@pytest.mark.parametrize(
    ("picture", "grey"),
    [
        (np.full((480, 640, 3), (10, 100, 200), np.uint8), round(0.114 * 10 + 0.587 * 100 + 0.299 * 200)),
        (np.full((480, 640), 77, np.uint8), 77),
    ],
)
def test_colour_becomes_grey_in_the_given_array(device: set[int], picture: np.ndarray, grey: int) -> None:
    """0.114 B + 0.587 G + 0.299 R (BT.601), in place; a device that is grey already needs no conversion."""
    camera, capture = opened()
    capture.picture = picture
    into = np.zeros((480, 640), np.uint8)
    frame = camera.read(into)
    assert isinstance(frame, Frame)
    assert (into == grey).all()
    assert frame.pixels.base is into


def test_an_exposure_that_is_honoured_is_reported(device: set[int], caplog: pytest.LogCaptureFixture) -> None:
    """V4L2 counts exposure in 100 µs; manual mode is 1."""
    camera, capture = opened(exposure_us=10000)
    assert capture.values[cv2.CAP_PROP_AUTO_EXPOSURE] == 1
    assert capture.values[cv2.CAP_PROP_EXPOSURE] == 100
    assert camera.info.exposure_us == 10000
    assert camera.info.transfer == "srgb"
    assert caplog.text == ""


@pytest.mark.parametrize("key", [cv2.CAP_PROP_AUTO_EXPOSURE, cv2.CAP_PROP_EXPOSURE])
def test_an_exposure_that_cannot_be_fixed_is_warned_of(
    device: set[int], key: int, caplog: pytest.LogCaptureFixture
) -> None:
    """The camera runs, and the owner is told what to expect of it."""
    device.add(key)
    with caplog.at_level(logging.WARNING):
        camera, _ = opened(exposure_us=10000)
    assert "the exposure cannot be fixed at 10000 µs" in caplog.text
    assert camera.info.exposure_us == (15600 if key == cv2.CAP_PROP_EXPOSURE else 10000)


def test_another_size_is_refused(device: set[int]) -> None:
    """A device without the size asked for is not taken with another."""
    device.add(cv2.CAP_PROP_FRAME_WIDTH)
    with pytest.raises(CameraError, match=r"gives 0 × 480 where 640 × 480 was asked"):
        opened()


def test_the_device_s_time_is_used_where_it_is_of_this_clock(device: set[int]) -> None:
    """The stamp is the start of row 0's read-out; one of another clock is replaced by the arrival."""
    camera, capture = opened()
    capture.stamp_ns = time.monotonic_ns() - 50_000_000
    frame = camera.read(np.zeros((480, 640), np.uint8))
    assert isinstance(frame, Frame)
    assert abs(frame.row0_readout_ns - capture.stamp_ns) < 1000
    capture.stamp_ns = time.time_ns()
    before = time.monotonic_ns()
    frame = camera.read(np.zeros((480, 640), np.uint8))
    assert isinstance(frame, Frame)
    assert before <= frame.row0_readout_ns + READOUT_NS <= time.monotonic_ns()


def test_the_same_time_twice_is_rejected(device: set[int]) -> None:
    """A picture handed out again is not a new one."""
    camera, capture = opened()
    capture.stamp_ns = time.monotonic_ns() - 50_000_000
    assert isinstance(camera.read(np.zeros((480, 640), np.uint8)), Frame)
    again = camera.read(np.zeros((480, 640), np.uint8))
    assert again == Rejected(stage="capture", reason="timestamp")


def test_an_unplugged_device_is_an_error(device: set[int]) -> None:
    """When no picture comes any more, the device is named."""
    camera, capture = opened()
    capture.picture = None
    with pytest.raises(CameraError, match=r"^/dev/null: delivers no more pictures"):
        camera.read(np.zeros((480, 640), np.uint8))


def test_a_closed_camera_gives_none(device: set[int]) -> None:
    """Closing twice is safe, and nothing is read from a device that was given back."""
    camera, capture = opened()
    camera.close()
    camera.close()
    assert capture.released
    assert camera.read(np.zeros((480, 640), np.uint8)) is None
