"""Requests to the Pi's camera: what counts as doing as asked, and what is said where picamera2 is not there."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import pytest

from ledpi.camera.capture_settings import SENSORS, check_mode, disagreement, fixed_controls, frame_rows, row_time
from ledpi.camera.picamera import open_picamera
from ledpi.config.settings import CameraSettings
from ledpi.core.errors import CameraError

CLASSES_HZ = (1250.0, 2450.0)
ROW_US = 16001 / 504  # as the current driver's 58.333 MHz comes out of libcamera, in whole µs
MIN_FRAME_US = 16001.0
ASKED = {"ExposureTime": 10000, "AnalogueGain": 4.0, "FrameDurationLimits": (16168, 16168)}
MADE = {"ExposureTime": 9969, "AnalogueGain": 4.0, "FrameDuration": 16159}
CONFIGURED = {
    "sensor": {"output_size": (640, 480), "bit_depth": 10},
    "main": {"size": (640, 480), "format": "YUV420"},
}


def rows(**settings: Any) -> int:
    return frame_rows(CameraSettings(**settings), ROW_US, CLASSES_HZ, "ov5647", MIN_FRAME_US)


# ---- Without picamera2


def test_without_picamera2_the_remedy_is_named() -> None:
    """On a machine without the system's picamera2 the error says what to install, and how."""
    try:
        import picamera2  # noqa: F401
    except ImportError:
        pass
    else:
        pytest.skip("picamera2 is installed here")
    with pytest.raises(CameraError) as caught:
        open_picamera(CameraSettings(), CLASSES_HZ)
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
        open_picamera(CameraSettings(), CLASSES_HZ)


def test_another_size_is_refused_before_anything_is_opened() -> None:
    """A scaled picture has another row time; the message says so, with the keys."""
    with pytest.raises(CameraError, match=r"camera.width, camera.height: must be 640 and 480 .* 800 and 600"):
        open_picamera(CameraSettings(width=800, height=600), CLASSES_HZ)


# ---- The mode, and its rows


def test_the_mode_asked_for_is_accepted() -> None:
    """The sensor's own 640 × 480 at 10 bit, with luma ahead; frames of whole rows below what was asked.

    314 rows of 31.75 µs are 9969 µs. 504 rows are 20.0025 cycles of 1250 Hz: 512 move the bands; 20 ms need more.
    """
    check_mode(CONFIGURED)
    check_mode(CONFIGURED | {"main": {"size": (640, 480), "format": "NV12"}})
    assert disagreement(MADE, ASKED, ROW_US) is None
    assert rows() == 512
    assert rows(exposure_us=20000) >= 633


@pytest.mark.parametrize(
    "other",
    [
        {"sensor": {"output_size": (1296, 972), "bit_depth": 10}},
        {"sensor": {"output_size": (640, 480), "bit_depth": 8}},
        {"sensor": None},
        {"main": {"size": (640, 400), "format": "YUV420"}},
        {"main": {"size": (640, 480), "format": "XBGR8888"}},
    ],
)
def test_any_other_mode_or_picture_is_refused(other: dict[str, Any]) -> None:
    """A mode of another size has other rows, one of another depth another clock; a picture may be no luma."""
    with pytest.raises(CameraError, match=r"^picamera2: .*; must be \(640, 480\)"):
        check_mode(CONFIGURED | other)


def test_the_row_time_is_the_shortest_frame_over_its_rows() -> None:
    """OV5647, by hand: 504 rows of 1852 clocks at 58.333 MHz are 16001.3 µs, at 55 MHz 16971; or as it was measured."""
    facts = SENSORS["ov5647"]
    assert (facts.row_clocks, facts.shortest_frame_rows) == (0x073C, 0x1F8)  # its registers hts and vts
    assert row_time(CameraSettings(), "ov5647", 16001.0) == pytest.approx(1852 / 58.333, rel=1e-4)
    assert row_time(CameraSettings(), "ov5647", 16971.0) == pytest.approx(1852 / 55.0, rel=1e-4)
    assert row_time(CameraSettings(row_time_us=31.8), "imx708", 16001.0) == 31.8


@pytest.mark.parametrize("model", ["imx219", "imx708"])
def test_rows_that_are_not_known_are_not_guessed(model: str) -> None:
    """The IMX219's shortest frame depends on the driver's age; a sensor that is not in the table has none at all."""
    with pytest.raises(CameraError, match=rf"^camera.row_time_us: auto is for ov5647, and this camera is {model}"):
        row_time(CameraSettings(), model, 16001.0)


@pytest.mark.parametrize(("exposure_us", "shortest_us"), [(10000, 16001), (20000, 20096)])
def test_a_frame_period_shorter_than_possible_is_refused(exposure_us: float, shortest_us: int) -> None:
    """504 rows of the mode, or the exposure and 4 rows (629 + 4 rows of 31.748 µs), whichever is longer."""
    with pytest.raises(CameraError) as caught:
        rows(exposure_us=exposure_us, frame_duration_us=10_000)
    assert str(caught.value) == f"camera.frame_duration_us: must be at least {shortest_us} here, not 10000"


def test_frequencies_that_stand_still_in_every_frame_are_said() -> None:
    """No period helps a frequency with whole cycles in each row; the key to set is named."""
    with pytest.raises(
        CameraError, match=r"^camera.frame_duration_us: no frame of .* the phases of 40000 Hz all moving"
    ):
        frame_rows(CameraSettings(), 25.0, (40_000.0,), "ov5647", MIN_FRAME_US)


# ---- The controls


def test_the_controls_have_the_types_that_libcamera_takes() -> None:
    """Whole microseconds for times, floats for gains."""
    asked = fixed_controls(
        exposure_us=10000.4, analogue_gain=2, duration_us=16168, colour_gains=(1.4, 1.2), noise_reduction_off=0
    )
    assert (asked["ExposureTime"], type(asked["ExposureTime"])) == (10000, int)
    assert (asked["AnalogueGain"], type(asked["AnalogueGain"])) == (2.0, float)
    assert asked["FrameDurationLimits"] == (16168, 16168)


@pytest.mark.parametrize(
    ("made", "message"),
    [
        ({"ExposureTime": 9967}, "camera.exposure_us: 10000 µs was asked, and the camera reports 9967"),
        ({"ExposureTime": 10001}, "camera.exposure_us: 10000 µs was asked, and the camera reports 10001"),
        ({"AnalogueGain": 1.0}, "camera.analogue_gain: 4 was asked, and the camera reports 1"),
        ({"FrameDuration": 33333}, "camera.frame_duration_us: 16168 µs was asked, and the camera reports 33333"),
    ],
)
def test_what_the_camera_did_instead_is_said(made: dict[str, Any], message: str) -> None:
    """The key, what was asked, and what was done; more than a row off the exposure is not as asked."""
    assert disagreement(MADE | made, ASKED, ROW_US) == message
