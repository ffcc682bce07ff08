"""A camera that is lost and found: what its reader sees, and when it is given up."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

import numpy as np
import pytest

from ledpi.camera import recovering
from ledpi.camera.base import Camera
from ledpi.camera.recovering import LOST, RecoveringCamera
from ledpi.core.errors import CameraError, CameraLostError
from ledpi.core.records import CameraInfo, Frame, Pixels, Rejected
from tests.builders import DEADLINE_S

INFO = CameraInfo(width=8, height=6, exposure_us=1e4, row_time_us=31.75, transfer="linear", frame_length_rows=509)
GONE = CameraLostError("picamera2: the camera delivered nothing for 0.081 s")
ABSENT = CameraLostError("picamera2: no camera found")


class Short:
    """Delivers so many frames, then fails."""

    def __init__(self, frames: int, info: CameraInfo = INFO) -> None:
        self.info, self.panel = info, None
        self.gain_limits = (1.0, 16.0)
        self.gain: float | None = None
        self.closed = 0
        self._left = frames
        self._seq = -1

    def set_gain(self, gain: float) -> None:
        self.gain = gain

    def read(self, into: Pixels) -> Frame | None:
        if self._left == 0:
            raise GONE
        self._left -= 1
        self._seq += 1
        values = {"exposure_us": 1e4, "row_time_us": 31.75, "transfer": "linear"}
        return Frame(pixels=into.view(), seq=self._seq, row0_readout_ns=time.monotonic_ns(), **values)  # type: ignore[arg-type]

    def close(self) -> None:
        self.closed += 1


def opens(*steps: Short | CameraError) -> Callable[[], Camera]:
    """One step an opening; the last one for ever."""
    waiting = list(steps)

    def open_() -> Camera:
        step = waiting.pop(0) if len(waiting) > 1 else waiting[0]
        if isinstance(step, CameraError):
            raise step
        return step

    return open_


def results(camera: RecoveringCamera, count: int) -> list[object]:
    slot = np.zeros((6, 8), np.uint8)
    got = [camera.read(slot) for _ in range(count)]
    return [result.seq if isinstance(result, Frame) else result for result in got]


@pytest.fixture(autouse=True)
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(recovering, "BACKOFF_FIRST_S", 0.001)
    monkeypatch.setattr(recovering, "BACKOFF_LAST_S", 0.002)


def test_a_lost_camera_is_closed_and_opened_again() -> None:
    """The loss is said before one that hangs is closed, each attempt is one more, and seq goes on where it was."""
    first = Short(2)
    camera = RecoveringCamera(opens(first, ABSENT, ABSENT, Short(9)))
    assert results(camera, 3) == [0, 1, LOST]
    assert first.closed == 0
    assert results(camera, 5) == [LOST, LOST, LOST, 2, 3]
    assert first.closed == 1
    assert camera.info == INFO


def test_a_camera_whose_frames_are_all_unfit_is_opened_again() -> None:
    """One at another exposure is dropped; half a second of them is a camera that has forgotten its settings."""
    unfit = Rejected(stage="capture", reason="exposure")
    first = Short(0)
    first.read = lambda into: unfit  # type: ignore[method-assign]
    camera = RecoveringCamera(opens(first, Short(9)))
    assert results(camera, recovering.UNFIT_FRAMES + 2) == [*([unfit] * (recovering.UNFIT_FRAMES - 1)), LOST, LOST, 0]
    assert first.closed == 1


def test_a_camera_that_was_never_there_is_an_error_at_once() -> None:
    """Whoever starts the daemon sees it; the service manager tries again (tests/system/test_run.py)."""
    with pytest.raises(CameraLostError, match="no camera found"):
        RecoveringCamera(opens(ABSENT))


def test_it_is_given_up_after_the_deadline(monkeypatch: pytest.MonkeyPatch) -> None:
    """Counts from the last frame, not from the last opening; the last reason is told, and for how long."""
    monkeypatch.setattr(recovering, "DEADLINE_S", 0.05)
    unfit = Short(0)
    unfit.read = lambda into: Rejected(stage="capture", reason="exposure")  # type: ignore[method-assign]
    for again, says in (
        (ABSENT, r"^picamera2: no camera found; given up after 0 s$"),
        (Short(0), f"^{GONE}; given up after 0 s$"),
        (unfit, r"unusable frames in a row: capture\.exposure; given up"),
    ):
        camera = RecoveringCamera(opens(Short(1), again))
        with pytest.raises(CameraLostError, match=says):
            results(camera, 100_000)


def test_another_camera_ends_it() -> None:
    """Its rows take another time; everything behind it was set up for the first one."""
    other = Short(9, CameraInfo(width=8, height=6, exposure_us=1e4, row_time_us=18.9, transfer="linear"))
    camera = RecoveringCamera(opens(Short(1), other))
    with pytest.raises(CameraLostError, match="another one came back"):
        results(camera, 3)
    assert other.closed == 1


def test_a_camera_that_is_back_has_the_gain_that_was_set_last() -> None:
    """Also where it was set while the camera was away."""
    first, second = Short(1), Short(9)
    camera = RecoveringCamera(opens(first, ABSENT, second))
    assert camera.gain_limits == (1.0, 16.0)
    camera.set_gain(2.0)
    results(camera, 3)
    assert first.gain == 2.0
    camera.set_gain(8.0)
    results(camera, 1)
    assert second.gain == 8.0


def test_close_ends_the_wait_between_two_attempts(monkeypatch: pytest.MonkeyPatch) -> None:
    """The daemon stops at once, although the camera is away."""
    monkeypatch.setattr(recovering, "BACKOFF_FIRST_S", 60.0)
    camera = RecoveringCamera(opens(Short(0), ABSENT))
    assert results(camera, 1) == [LOST]
    got: list[object] = []
    reader = threading.Thread(target=lambda: got.extend(results(camera, 1)))
    reader.start()
    camera.close()
    camera.close()
    reader.join(DEADLINE_S)
    assert got == [None]
