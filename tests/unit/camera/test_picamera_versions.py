"""The Pi's camera by versions of picamera2: those on the page work, the others are one line."""

from __future__ import annotations

import errno
import re
import sys
from collections.abc import Callable
from importlib.metadata import PackageNotFoundError

import numpy as np
import pytest

from ledpi.camera.picamera import open_picamera
from ledpi.camera.picamera_stream import PicameraCamera
from ledpi.camera.picamera_version import OLDEST
from ledpi.config.settings import CameraSettings, load_config
from ledpi.core.errors import CameraError, CameraLostError, TransientError
from ledpi.core.records import Frame
from ledpi.workshop.doctor.checks import examine
from tests.builders import ROOT
from tests.builders.picamera2_versions import CHANGES, Sensor, stand_in

NEWEST = list(CHANGES)[-1]
Use = Callable[..., Sensor]


@pytest.fixture
def use(monkeypatch: pytest.MonkeyPatch) -> Use:
    """Installs a version, before a sensor. `says`: which version it says it is, None for none."""

    def use(version: str, says: str | None = "itself", **behaviour: object) -> Sensor:
        def said(_: str) -> str:
            if says is None:
                raise PackageNotFoundError
            return version if says == "itself" else says

        sensor = Sensor(**behaviour)  # type: ignore[arg-type]
        picamera2, libcamera = stand_in(version, sensor)
        monkeypatch.setitem(sys.modules, "picamera2", picamera2)
        monkeypatch.setitem(sys.modules, "libcamera", libcamera)
        monkeypatch.setattr("ledpi.camera.picamera_version.version", said)
        return sensor

    return use


def opened(**settings: object) -> PicameraCamera:
    return open_picamera(CameraSettings(**settings), (1250.0, 2450.0))  # type: ignore[arg-type]


def on_the_page() -> dict[str, bool]:
    """By each version of docs/raspberry-pi.md's table, from which on it is so: whether ledpi works with it."""
    page = (ROOT / "docs/raspberry-pi.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (\d+\.\d+\.\d+) [^|]*\|[^|]*\| (yes|no)\b", page, re.MULTILINE)
    return {version: works == "yes" for version, works in rows}


def test_the_page_has_a_row_for_each_change_that_matters() -> None:
    """From the oldest that works on, all do."""
    page = on_the_page()
    assert page.keys() <= CHANGES.keys()
    assert next(version for version, works in page.items() if works) == OLDEST
    assert list(page.values()) == sorted(page.values())


@pytest.mark.parametrize("version", CHANGES)
def test_a_version_does_what_the_page_says(version: str, use: Use) -> None:
    """Opened, read, its gain set, and closed; or refused, with its name and what to do."""
    works = next(works for since, works in reversed(on_the_page().items()) if _numbers(since) <= _numbers(version))
    sensor = use(version)
    if not works:
        with pytest.raises(CameraError, match=rf"^picamera2 {version} is too old; must be {OLDEST} or newer: sudo apt"):
            opened()
        return
    camera = opened(exposure_us=10_000)
    camera.set_gain(8.0)
    frames = [camera.read(np.zeros((480, 640), np.uint8)) for _ in range(3)]
    assert all(isinstance(frame, Frame) and frame.exposure_us == 9999 for frame in frames)
    camera.close()
    assert sensor.closed


def _numbers(version: str) -> list[int]:
    return [int(part) for part in version.split(".")]


@pytest.mark.parametrize(
    ("version", "said"),
    [
        ("0.3.12", "TypeError: got an unexpected keyword argument 'sensor'"),
        ("0.3.13", "TypeError: got an unexpected keyword argument 'timeout'"),
    ],
)
def test_an_old_one_that_does_not_say_how_old_it_is_is_one_line(version: str, said: str, use: Use) -> None:
    """With what went wrong, and what is needed: for a person to mend. The camera is given back."""
    sensor = use(version, says=None)
    with pytest.raises(CameraError) as refused:
        opened()
    line = f"picamera2 of unknown version, libcamera v0.5.2: {said}; needs picamera2 {OLDEST} or newer: sudo apt update"
    assert str(refused.value).startswith(line)
    assert not isinstance(refused.value, TransientError)
    assert sensor.closed or version == "0.3.13"  # which has no way to be closed while a job waits


def test_controls_are_asked_for_again_after_the_start(use: Use) -> None:
    """Some versions forget what was asked before."""
    use(NEWEST, forgetful=True)
    frame = opened(exposure_us=10_000).read(np.zeros((480, 640), np.uint8))
    assert isinstance(frame, Frame)
    assert frame.exposure_us == 9999


def test_a_camera_that_never_obeys_is_tried_again(use: Use) -> None:
    """It may be of this start alone; status 2 is for what a person must mend."""
    sensor = use(NEWEST, obeys=False)
    with pytest.raises(CameraLostError, match=r"camera\.exposure_us: 10000 µs was asked, and the camera reports 66632"):
        opened(exposure_us=10_000)
    assert sensor.closed


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"exposure_us": 130}, "camera.exposure_us: must be 134 to 3e+06 with this camera, not 130"),
        ({"analogue_gain": 64}, "camera.analogue_gain: must be 1 to 63.9 with this camera, not 64"),
    ],
)
def test_what_the_camera_cannot_do_is_for_a_person(settings: dict[str, float], said: str, use: Use) -> None:
    """It says so itself, so no start will help."""
    use(NEWEST)
    with pytest.raises(CameraError) as refused:
        opened(**settings)
    assert str(refused.value) == said
    assert not isinstance(refused.value, TransientError)


@pytest.mark.parametrize("error", [KeyError("SensorTimestamp"), TypeError("not a request"), AttributeError("fd")])
def test_any_exception_of_a_version_that_fits_is_one_line_and_tried_again(error: Exception, use: Use) -> None:
    """While it is opened, or read."""
    sensor = use(NEWEST)
    camera = opened()
    sensor.failing = error
    use(NEWEST, failing=error)
    for fails in (opened, lambda: camera.read(np.zeros((480, 640), np.uint8))):
        with pytest.raises(CameraLostError) as lost:
            fails()
        assert str(lost.value) == f"picamera2 {NEWEST}, libcamera v0.5.2: {type(error).__name__}: {error}"


@pytest.mark.parametrize(
    ("call", "error"),
    [
        ("create_video_configuration", KeyError("sensor")),
        ("configure", OSError(errno.ENOMEM, "Cannot allocate memory")),  # at boot, say: for the camera's buffers
        ("set_controls", IndexError("no such mode")),
        ("start", RuntimeError("busy")),
    ],
)
def test_whatever_call_fails_while_it_is_opened_is_one_line(
    call: str, error: Exception, use: Use, monkeypatch: pytest.MonkeyPatch
) -> None:
    """And what was opened by then is closed, though that fails as well: another start finds it free."""
    sensor = use(NEWEST)

    def fails(*_: object, **__: object) -> None:
        raise error

    def close() -> None:
        sensor.closed = True
        raise RuntimeError("not even configured")

    monkeypatch.setattr(sensor, call, fails)
    monkeypatch.setattr(sensor, "close", close)
    with pytest.raises(CameraLostError) as lost:
        opened()
    assert str(lost.value).startswith(f"picamera2 {NEWEST}, libcamera v0.5.2: ")
    assert str(lost.value).endswith(str(error))
    assert sensor.closed


@pytest.mark.slow
def test_what_nobody_has_foreseen_does_not_end_doctors_page(monkeypatch: pytest.MonkeyPatch) -> None:
    """As a mistake of our own."""

    def fails(*_: object, **__: object) -> None:
        raise KeyError("sensor")

    monkeypatch.setattr("ledpi.workshop.doctor.camera.open_camera", fails)
    found = {finding.name: finding for finding in examine(load_config(None, ("camera.source=simulated",)))}
    assert found["camera"].said == "could not be looked at: KeyError: 'sensor'"
    assert list(found)[-1] == "speed"
