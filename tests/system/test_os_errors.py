"""Refusals of the operating system once the daemon runs: it goes on, or ends with status 1, for another to start."""

from __future__ import annotations

import errno
import glob
import os
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any, ClassVar

import cv2
import numpy as np
import pytest

from ledpi.camera.factory import open_camera
from ledpi.camera.recovering import RecoveringCamera
from ledpi.config.settings import SerialSettings, load_config
from ledpi.core.errors import CameraLostError
from ledpi.core.linux import who_holds
from ledpi.daemon.daemon import Daemon
from ledpi.wire import State
from ledpi.wire.line import SerialLine
from ledpi.wire.publisher import Publisher
from tests.builders.daemon import COMMAND, SIMULATED, controller, daemon, end, holder, write_recording
from tests.builders.wire import decoded_now

REFUSALS = [errno.EIO, errno.EMFILE]
each_refusal = pytest.mark.parametrize("code", REFUSALS, ids=lambda code: errno.errorcode[code])


def refusal(code: int) -> OSError:
    return OSError(code, os.strerror(code))


# ---- The decoder, and what has no worker: status 1

# In front of the daemon: after some frames, what it calls is refused.
REFUSE = """
import importlib, itertools, os
calls, owner = itertools.count(), importlib.import_module({module!r})
for name in {names!r}:
    outer, owner = owner, getattr(owner, name)
def refused(*arguments, **options):
    if next(calls) >= {after}:
        raise OSError({code}, os.strerror({code}))
    return owner(*arguments, **options)
setattr(outer, name, refused)
"""


def refusing(module: str, *names: str, code: int, after: int = 3) -> list[str]:
    return [*COMMAND[:2], REFUSE.format(module=module, names=names, code=code, after=after) + COMMAND[2], *COMMAND[3:]]


@pytest.mark.slow
def test_refused_to_the_decoder_it_ends_with_status_1() -> None:
    """The worker and the reason are named, and not standard output; the controller gets its last word."""
    command = refusing("ledpi.pipeline.pipeline", "Pipeline", "decode", code=errno.EIO)
    with controller() as line, daemon(*SIMULATED, f"serial.port={line.port}", command=command) as process:
        ended = end(process)
        line.close()
    assert ended.status == 1
    assert ended.log[-1] == f"ledpi: decode: [Errno {errno.EIO}] Input/output error"
    assert line.statuses[-1][1].state is State.STOPPING


@pytest.mark.slow
def test_refused_to_the_main_thread_it_ends_with_status_1() -> None:
    """It has no part of its own that could be begun anew."""
    command = refusing("ledpi.daemon.health", "read_processor", code=errno.EMFILE, after=2)
    with daemon(*SIMULATED, "serial.port=nothing", command=command) as process:
        ended = end(process)
    assert ended.status == 1
    assert ended.log[-1] == f"ledpi: [Errno {errno.EMFILE}] Too many open files"


# ---- The camera: opened again


class Device:
    """cv2.VideoCapture on a device that is there as long as its file is; shows a recording's pictures."""

    pictures: ClassVar[list[Any]] = []
    vanishes_when_opened = False

    def __init__(self, path: str, backend: int) -> None:
        self._path = Path(path)
        if Device.vanishes_when_opened:
            self._path.unlink(missing_ok=True)
            Device.vanishes_when_opened = False
        self._values: dict[int, float] = {}
        self._count = 0

    def isOpened(self) -> bool:  # noqa: N802
        return self._path.exists()

    def set(self, key: int, value: float) -> bool:
        self._values[key] = value
        return True

    def get(self, key: int) -> float:
        return time.monotonic() * 1e3 - 17 if key == cv2.CAP_PROP_POS_MSEC else self._values.get(key, 0.0)

    def read(self, buffer: object) -> tuple[bool, Any]:
        time.sleep(0.017)
        self._count += 1
        return self._path.exists(), Device.pictures[self._count % len(Device.pictures)]

    def release(self) -> None:
        pass


@pytest.mark.slow
def test_a_v4l2_node_that_vanishes_is_used_again_when_it_is_back(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where it vanishes once more, between the look at it and its opening."""
    write_recording(tmp_path / "take", 30)
    pictures = sorted((tmp_path / "take/frames").iterdir())
    monkeypatch.setattr(Device, "pictures", [cv2.imread(str(path), cv2.IMREAD_GRAYSCALE) for path in pictures])
    monkeypatch.setattr(cv2, "VideoCapture", Device)
    node = tmp_path / "video0"
    node.touch()
    settings = ("panels.side_m=0.16", "camera.row_time_us=33.67", f"camera.source=v4l2:{node}")
    with controller() as line:
        config = load_config(None, (*settings, f"serial.port={line.port}"))
        running = Daemon(config, open_camera(config, recover=True))
        thread = threading.Thread(target=running.run, daemon=True)
        thread.start()
        line.wait_for(lambda end: len(end.markers) > 5)
        node.unlink()
        line.wait_for(lambda end: end.statuses[-1][1].state is State.CAMERA_LOST)
        monkeypatch.setattr(Device, "vanishes_when_opened", True)
        node.touch()
        line.wait_for(lambda end: not Device.vanishes_when_opened)
        assert not node.exists()
        seen = len(line.markers)
        time.sleep(1.0)  # for two more attempts
        node.touch()
        line.wait_for(lambda end: len(end.markers) > seen + 5)
        running.stop()
        thread.join()


class Refusing:
    """A camera whose every call is refused."""

    def __init__(self, inner: Any, code: int) -> None:
        self.info, self.panel, self.gain_limits = inner.info, None, (1.0, 16.0)
        self._code = code

    def read(self, into: object) -> None:
        raise refusal(self._code)

    def set_gain(self, gain: float) -> None:
        raise refusal(self._code)

    def close(self) -> None:
        raise refusal(self._code)


@each_refusal
def test_a_camera_that_is_refused_everything_is_replaced(code: int) -> None:
    """Its reading, its gain, its closing, and then an opening: the next one delivers."""
    config = load_config(None, SIMULATED)
    good = open_camera(config)
    steps: list[Any] = [Refusing(good, code), refusal(code), good]

    def open_next() -> Any:
        step = steps.pop(0)
        if isinstance(step, OSError):
            raise step
        return step

    camera = RecoveringCamera(open_next)
    camera.set_gain(2.0)
    into = np.zeros((240, 320), np.uint8)
    results = [camera.read(into) for _ in range(4)]
    assert [getattr(result, "key", "frame") for result in results] == ["camera.lost"] * 3 + ["frame"]
    camera.close()


@each_refusal
def test_what_is_refused_as_a_camera_is_opened_is_a_lost_camera(code: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """Whatever library it was refused to."""

    def refused(*_: object) -> None:
        raise refusal(code)

    monkeypatch.setattr(cv2, "VideoCapture", refused)
    config = load_config(None, ("panels.side_m=0.16", "camera.row_time_us=30", "camera.source=v4l2:/dev/null"))
    with pytest.raises(CameraLostError, match=f"^v4l2:/dev/null: {os.strerror(code)}$"):
        open_camera(config)


# ---- Who holds the camera: told as far as it can be seen


def test_a_device_that_vanishes_while_its_holder_is_sought_hides_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """/dev/media* changes while cameras come and go: what was listed may be gone when it is looked at."""
    device = tmp_path / "media0"
    device.touch()
    monkeypatch.setattr(glob, "glob", lambda pattern: [str(tmp_path / "media9"), str(device)])
    with holder(device) as pid:
        said = who_holds(str(tmp_path / "media*"))
    assert said is not None
    assert f"(process {pid})" in said


@each_refusal
def test_a_holder_that_cannot_be_sought_is_none(code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """It is a hint beside the error, and must not become another one."""
    (tmp_path / "media0").touch()

    def refused(*_: object, **__: object) -> None:
        raise refusal(code)

    with monkeypatch.context() as patch:
        patch.setattr(os, "stat", refused)
        patch.setattr(os, "readlink", refused)
        assert who_holds(str(tmp_path / "media*")) is None


# ---- The publisher: the port is opened again


@each_refusal
@pytest.mark.parametrize("call", ["busy_ns", "first_byte_ns", "write"])
def test_a_publisher_that_is_refused_something_opens_its_port_again(
    call: str, code: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whichever call it is, and in whichever thread: the pose that comes next arrives."""
    real, refused = getattr(SerialLine, call), threading.Event()

    def once(line: SerialLine, *arguments: object) -> object:
        if armed.is_set() and not refused.is_set():
            refused.set()
            raise refusal(code)
        return real(line, *arguments)

    armed = threading.Event()
    monkeypatch.setattr(SerialLine, call, once)
    with controller() as line:
        publisher = Publisher(SerialSettings(port=line.port))
        publisher.start()
        line.wait_for(lambda end: bool(end.statuses))
        armed.set()
        publisher.publish(decoded_now(3))
        line.wait_for(lambda _: publisher.counters.opened >= 2)
        publisher.publish(decoded_now(7))
        line.wait_for(lambda end: any(marker.id == 7 for marker in end.markers))
        assert publisher.failure is None
        publisher.stop()


@each_refusal
def test_a_port_that_cannot_be_asked_for_room_is_lost(code: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the port's name, as any other loss of it."""

    def refused(*_: object) -> None:
        raise refusal(code)

    with controller() as line:
        publisher = Publisher(SerialSettings(port=line.port))
        with monkeypatch.context() as patch:
            patch.setattr("ledpi.wire.line.select", SimpleNamespace(select=refused))
            publisher.start()
            line.wait_for(lambda _: publisher.counters.error is not None)
            assert publisher.counters.error == f"{line.port}: lost: {os.strerror(code).lower()}"
            publisher.stop()
