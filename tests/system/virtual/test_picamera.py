"""The Pi's camera through the real picamera2 and libcamera."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
import threading
import time
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ledpi.camera.picamera import open_picamera
from ledpi.camera.picamera_stream import ASKED_AHEAD, STALL_PERIODS, PicameraCamera
from ledpi.config.settings import CameraSettings
from ledpi.core.errors import CameraError, CameraLostError
from ledpi.core.records import Frame, Pixels, Rejected
from tests.builders import ROOT
from tests.builders.virtual_picamera2 import ROW_US, Behaviour, VirtualPicamera2, show, unplug
from tests.builders.waiting import limit_s

CLASSES_HZ = (1250.0, 2450.0)


def opened(**settings: Any) -> PicameraCamera:
    return open_picamera(CameraSettings(**settings), CLASSES_HZ)


def refusal(behaviour: Behaviour, **settings: Any) -> str:
    with pytest.raises(CameraError) as caught:
        opened(**settings)
    assert not any(camera.is_open for camera in behaviour.opened)
    message = str(caught.value)
    assert "\n" not in message
    return message


def slot() -> Pixels:
    return np.zeros((480, 640), np.uint8)


def read(camera: PicameraCamera, into: Pixels | None = None) -> Frame:
    frame = camera.read(slot() if into is None else into)
    assert isinstance(frame, Frame)
    return frame


def read_on(camera: PicameraCamera) -> None:
    """Until it raises."""
    into = slot()
    while True:
        camera.read(into)


# ---- What is asked, and what comes


def test_everything_is_fixed_before_the_first_frame(behaviour: Behaviour) -> None:
    """Exposure, gain, colours and period as asked, every automatic off; libcamera took all of their types."""
    opened(exposure_us=10000.4, analogue_gain=2)
    (camera,) = behaviour.opened
    (_, asked), *later = camera.asked
    assert later == []
    assert asked["ExposureTime"] == 10000
    assert asked["AnalogueGain"] == 2.0
    assert asked["FrameDurationLimits"][0] == asked["FrameDurationLimits"][1]
    off = ("AeEnable", "AwbEnable", "Sharpness", "Brightness")
    assert not any(asked[name] for name in off)
    assert (asked["Contrast"], asked["Saturation"], int(asked["NoiseReductionMode"])) == (1.0, 1.0, 0)
    assert asked["ColourGains"] == pytest.approx((1.41, 1.26), abs=0.01)  # vc4/ov5647.json at 5000 K


def test_picamera2_chose_the_mode(behaviour: Behaviour) -> None:
    """Chooses of the sensor's four, by its own score; its row time and the period that moves both classes follow."""
    info = opened().info
    assert behaviour.opened[0].camera_configuration()["sensor"] == {"output_size": (640, 480), "bit_depth": 10}
    assert info.row_time_us == pytest.approx(ROW_US, rel=1e-4)
    assert info.frame_length_rows == 512
    assert (info.width, info.height, info.exposure_us, info.transfer) == (640, 480, 10000.0, "linear")


def test_libcamera_is_pointed_at_a_linear_tuning(behaviour: Behaviour, monkeypatch: pytest.MonkeyPatch) -> None:
    """When its manager starts, which is when it reads tuning files, the file named to it has a straight tone curve."""
    import libcamera

    curves: list[object] = []
    start = libcamera.CameraManager.singleton

    def started() -> object:
        path = os.environ.get("LIBCAMERA_RPI_TUNING_FILE")
        algorithms = json.loads(Path(path).read_text())["algorithms"] if path and Path(path).exists() else []
        curves.extend(a["rpi.contrast"]["gamma_curve"] for a in algorithms if "rpi.contrast" in a)
        return start()

    monkeypatch.setattr(libcamera.CameraManager, "singleton", staticmethod(started))
    managers_before = start()
    held = id(managers_before)
    del managers_before
    opened()
    assert curves == [[0, 0, 65535, 65535]]
    assert held  # nobody held a manager from before, or the first look at the cameras would have been the last


def test_luma_and_its_metadata_are_of_one_request(behaviour: Behaviour) -> None:
    """Nine grey pictures: each frame is all of one brightness, and carries its own time, exposure and gain."""
    camera, into = opened(), slot()
    shades, times = [], []
    for _ in range(24):
        frame = read(camera, into)
        assert into.min() == into.max()
        shades.append(int(into[0, 0]))
        times.append(frame.row0_readout_ns)
        assert (frame.exposure_us, frame.analogue_gain) == (int(314 * ROW_US), 4.0)
        assert 0 <= time.monotonic_ns() - frame.row0_readout_ns - frame.host_offset_ns < 1e9
    assert set(shades) >= {20 * n for n in range(2, 6)}
    assert np.diff(times) == pytest.approx(512 * ROW_US * 1e3, abs=2)


def test_exactly_one_copy_of_a_frame(behaviour: Behaviour, monkeypatch: pytest.MonkeyPatch) -> None:
    """From libcamera's buffer into the slot: one copy of that size is made, and no memory for another is taken."""
    camera, into = opened(), slot()
    sizes: list[int] = []
    copy = np.copyto

    def counted(to: Pixels, source: Pixels, **options: Any) -> None:
        sizes.append(source.size)
        assert np.shares_memory(to, into)
        copy(to, source, **options)

    monkeypatch.setattr(np, "copyto", counted)
    read(camera, into)
    tracemalloc.start()
    for _ in range(5):
        read(camera, into)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert sizes == [640 * 480] * 6
    assert peak < 640 * 480 / 2


def test_frames_before_the_controls_act_are_not_handed_out(behaviour: Behaviour) -> None:
    """The first frames still have another exposure; none of them is seen."""
    behaviour.unsettled = 7
    assert 10000 - ROW_US <= read(opened()).exposure_us <= 10000


def test_a_missed_frame_leaves_a_gap_in_seq(behaviour: Behaviour) -> None:
    """seq follows the sensor's time: a reader that sleeps finds out how much it missed."""
    camera = opened()
    before = read(camera)
    time.sleep(0.6)
    reads = ASKED_AHEAD + 4  # more than can have waited
    after = [read(camera) for _ in range(reads)][-1]
    period_ns = 512 * ROW_US * 1e3
    assert after.seq - before.seq == round((after.row0_readout_ns - before.row0_readout_ns) / period_ns)
    assert after.seq - before.seq > reads


def test_the_first_frame_is_made_after_it_was_asked_for(behaviour: Behaviour) -> None:
    """Those that have waited since the camera was opened are let go, so no gap follows them."""
    camera = opened()
    time.sleep(0.4)
    asked_ns = time.monotonic_ns()
    frames = [read(camera) for _ in range(4)]
    assert frames[0].row0_readout_ns > asked_ns
    assert [frame.seq for frame in frames] == [0, 1, 2, 3]


def test_the_gain_can_be_set_while_it_runs(behaviour: Behaviour) -> None:
    """Each frame says the gain that it was made with: two more with the old one, then the new one."""
    camera = opened()
    assert camera.gain_limits == (1.0, 63.9375)
    assert read(camera).analogue_gain == 4.0
    camera.set_gain(8)
    gains = [read(camera).analogue_gain for _ in range(10)]
    assert gains[0] == 4.0
    assert gains[-1] == 8.0
    assert sorted(gains, key=lambda gain: gain or 0) == gains


def test_a_fixed_gain_is_not_adjustable(behaviour: Behaviour) -> None:
    """`analogue_gain: 2` stays 2."""
    assert opened(analogue_gain=2).gain_limits is None


# ---- Refusals


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mode": (1296, 972)}, "picamera2: the sensor's mode is (1296, 972), 10 bit; must be (640, 480), 10 bit"),
        ({"bit_depth": 8}, "picamera2: the sensor's mode is (640, 480), 8 bit; must be"),
        ({"limited_range": True}, "picamera2: the camera gives"),
        ({"clock_offset_ns": 10**18}, "picamera2: SensorTimestamp is not of CLOCK_MONOTONIC"),
        (
            {"metadata": {"ExposureTime": 8000}},
            "picamera2: camera.exposure_us: 10000 µs was asked, and the camera reports 8000",
        ),
        ({"metadata": {"AnalogueGain": 1.0}}, "picamera2: camera.analogue_gain: 4 was asked, and the camera reports 1"),
        ({"metadata": {"FrameDuration": 33333}}, "picamera2: camera.frame_duration_us: 16263 µs was asked"),
    ],
)
def test_a_camera_that_does_not_do_as_asked_is_refused(
    behaviour: Behaviour, change: dict[str, Any], message: str
) -> None:
    """Tells what was asked, and what the camera did; it is closed again."""
    for name, value in change.items():
        setattr(behaviour, name, value)
    assert refusal(behaviour).startswith(message)


def test_no_camera_is_said_and_one_plugged_in_later_is_found(behaviour: Behaviour, tmp_path: Path) -> None:
    """Says what to check; it may come back, so trying again is worth while."""
    unplug()
    with pytest.raises(CameraLostError, match=r"^picamera2: no camera found; check the cable"):
        opened()
    show(tmp_path / "later", [np.full((480, 640), 90, np.uint8)])
    assert isinstance(opened().read(slot()), Frame)


def test_another_sensor_needs_a_measured_row_time(behaviour: Behaviour, tmp_path: Path) -> None:
    """The rows of a sensor that is not known well enough are not guessed; with the measured value it runs."""
    show(tmp_path / "imx", [np.full((480, 640), 90, np.uint8)], model="imx219")
    assert refusal(behaviour).startswith("camera.row_time_us: auto is for ov5647, and this camera is imx219; measure")
    assert opened(row_time_us=ROW_US).info.row_time_us == ROW_US


def test_a_sensor_without_a_tuning_file_is_refused(behaviour: Behaviour, tmp_path: Path) -> None:
    """Its tone would not be known."""
    show(tmp_path / "other", [np.full((480, 640), 90, np.uint8)], model="ov9999")
    assert "libcamera's tuning file ov9999.json cannot be used" in refusal(behaviour, row_time_us=31.75)


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
    """A frame with another exposure, without a time, or out of time, is dropped; later ones are read."""
    camera = opened()
    read(camera)
    behaviour.metadata = change
    results = [camera.read(slot()) for _ in range(8)]
    assert key in [result.key for result in results if isinstance(result, Rejected)]
    behaviour.metadata = {}
    assert any(isinstance(camera.read(slot()), Frame) for _ in range(8))


def test_a_reader_that_is_held_up_for_eight_frames_misses_none(behaviour: Behaviour) -> None:
    """They are asked for ahead of time, and wait."""
    camera = opened(frame_duration_us=50_000)  # long, so that a busy machine does not hold it up for a ninth
    before = read(camera)
    time.sleep((ASKED_AHEAD - 0.5) * 0.05)
    assert [read(camera).seq - before.seq for _ in range(9)] == list(range(1, 10))


# ---- The end


def test_a_stall_is_noticed_after_five_periods(behaviour: Behaviour) -> None:
    """A camera that delivers nothing is reported, not waited for; then it can be closed."""
    camera = opened()
    read(camera)
    behaviour.stalled.set()
    started = time.monotonic()
    with pytest.raises(CameraLostError, match=r"^picamera2: the camera delivered nothing for 0\.081 s"):
        read_on(camera)
    assert time.monotonic() - started >= STALL_PERIODS * 512 * ROW_US * 1e-6
    camera.close()
    assert not behaviour.opened[0].is_open


def test_a_process_that_is_held_up_has_not_lost_its_camera(behaviour: Behaviour) -> None:
    """Stopped for ten periods while it waits for a frame, eight times: the camera was there all the time."""
    camera = opened()
    before = read(camera)
    stop_and_go = "for i in 1 2 3 4 5 6 7 8; do kill -STOP $1; sleep 0.16; kill -CONT $1; sleep 0.04; done"
    with subprocess.Popen(["sh", "-c", stop_and_go, "sh", str(os.getpid())]) as hold_up:
        while hold_up.poll() is None:
            after = read(camera)
    assert after.seq - before.seq > 8 * STALL_PERIODS


def test_an_error_while_waiting_is_a_lost_camera(behaviour: Behaviour) -> None:
    """Ends the wait with what picamera2's event loop raises; it is closed and may be opened again."""
    camera = opened()
    behaviour.failing = RuntimeError("Failed to queue request: No such device")
    with pytest.raises(CameraLostError, match=r"^picamera2 [^:]*: Failed to queue request: No such device"):
        read_on(camera)
    camera.close()
    assert isinstance(opened().read(slot()), Frame)


def test_close_ends_a_waiting_read(behaviour: Behaviour) -> None:
    """From another thread, while nothing comes: the read gives None at once."""
    camera = opened(frame_duration_us=400_000)  # so that a stall would be noticed after 2 s only
    got: list[object] = []
    behaviour.stalled.set()
    reader = threading.Thread(target=lambda: got.append(camera.read(slot())))
    reader.start()
    time.sleep(0.05)
    camera.close()
    camera.close()
    reader.join(1.5)
    assert got == [None]
    assert camera.read(slot()) is None


def test_stopping_while_frames_come(behaviour: Behaviour) -> None:
    """The reader gets frames, then None; nothing hangs and nothing is raised."""
    camera = opened()
    got: list[object] = []

    def capture() -> None:
        into = slot()
        while (result := camera.read(into)) is not None:
            got.append(result)

    reader = threading.Thread(target=capture)
    reader.start()
    while len(got) < 5:
        time.sleep(0.01)
    camera.close()
    reader.join(limit_s())
    assert not reader.is_alive()


WRONG_TYPE = """
import sys
from tests.builders.virtual_picamera2 import Behaviour, use
from ledpi.camera import picamera
from ledpi.config.settings import CameraSettings
from ledpi.core.errors import CameraError
use(Behaviour(), setattr)
fixed = picamera.fixed_controls
picamera.fixed_controls = lambda **values: fixed(**values) | {"ExposureTime": sys.argv[1]}
try:
    picamera.open_picamera(CameraSettings(), (1250.0, 2450.0))
except (CameraError, TypeError) as error:
    print(type(error).__name__, error, flush=True)
"""


def test_libcamera_judges_the_controls(behaviour: Behaviour) -> None:
    """An exposure that is a text is refused at the start: what other tests ask for was really taken.

    In a process of its own, as libcamera may end one whose start has failed.
    """
    command = [sys.executable, "-c", WRONG_TYPE, "10000"]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False, timeout=limit_s(30))
    at_the_start = r"CameraLostError picamera2 \S+, libcamera \S+: TypeError: "
    assert re.match(at_the_start, done.stdout), done.stdout + done.stderr


def test_the_stand_in_is_a_picamera2(behaviour: Behaviour) -> None:
    """Runs picamera2's class; the subclass adds what the virtual camera lacks."""
    import picamera2.picamera2

    opened()
    assert isinstance(behaviour.opened[0], picamera2.picamera2.Picamera2)
    assert VirtualPicamera2.capture_request is picamera2.picamera2.Picamera2.capture_request
