"""`ledpi run` as its user has it: a real process, a pty for the motor controller, recordings for a camera."""

from __future__ import annotations

import dataclasses
import os
import select
import subprocess
import sys
import threading
import time
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path

import numpy as np

from ledpi.camera.base import Camera
from ledpi.camera.recording.writer import RecordingWriter
from ledpi.camera.simulate.scene import Room, SimulatedSensor
from ledpi.camera.simulate.scenes import ov5647_lens, still_scene
from ledpi.camera.simulated import SimulatedCamera, open_simulated
from ledpi.config.settings import Config, load_config
from ledpi.core.records import CameraInfo, Frame, PanelSpec, PanelValues
from ledpi.daemon.daemon import Daemon
from ledpi.daemon.tap.server import Tap
from ledpi.wire import FixMessage, MarkerMessage, Message, Receiver, StatusMessage
from tests.builders import ROOT
from tests.builders.waiting import killed_if_late, limit_s, wait_until

LIFE_S = 180.0  # of a daemon of one test, on an idle machine
MAX_AGE_US = 100_000  # serial.max_age_ms as it is by default
COMMAND = [sys.executable, "-c", "from ledpi.cli import main; main()", "run"]
SPEC = PanelSpec(side_m=0.16, black_hz=1250.0, white_hz=2450.0)
# The simulated drive in a quarter of the pixels, at 29 frames a second: a fifth of the work of the usual camera.
SMALL = ("camera.width=320", "camera.height=240", "camera.frame_duration_us=35000")
SIMULATED = ("panels.side_m=0.16", "camera.source=simulated", *SMALL)
SIMULATED_YAML = "camera: {source: simulated, width: 320, height: 240, frame_duration_us: 35000}\n"
HOLD = "import fcntl, sys; f = open(sys.argv[1], 'r+'); {lock}; print(flush=True); sys.stdin.read()"


class Controller:
    """The other end of the line: every message, with the time at which it was read."""

    def __init__(self, max_age_us: int = MAX_AGE_US) -> None:
        self._max_age_us = max_age_us
        self._master, self._slave = os.openpty()
        tty.setraw(self._master)
        self.port = os.ttyname(self._slave)
        self.receiver = Receiver()
        self.got: list[tuple[float, Message]] = []
        self._closing = threading.Event()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._thread.start()

    def _read(self) -> None:
        while True:
            ready, _, _ = select.select([self._master], [], [], 0.02)
            if ready:
                for message in self.receiver.feed(os.read(self._master, 65536)):
                    self.hear(message)
            elif self._closing.is_set():
                return

    def hear(self, message: Message) -> None:
        self.got.append((time.monotonic(), message))

    @property
    def markers(self) -> list[MarkerMessage]:
        return [message for _, message in self.got if isinstance(message, MarkerMessage)]

    @property
    def statuses(self) -> list[tuple[float, StatusMessage]]:
        return [(at, message) for at, message in self.got if isinstance(message, StatusMessage)]

    def wait_for(self, enough: Callable[[Controller], bool]) -> None:
        wait_until(partial(enough, self))

    def close(self) -> None:
        """Reads what is still there. No pose of all that came may be older than allowed."""
        if not self._closing.is_set():
            self._closing.set()
            self._thread.join()
            os.close(self._slave)
            os.close(self._master)
            poses = [message for _, message in self.got if isinstance(message, MarkerMessage | FixMessage)]
            assert all(pose.age_us <= self._max_age_us for pose in poses)


@contextmanager
def controller(max_age_us: int = MAX_AGE_US) -> Iterator[Controller]:
    end = Controller(max_age_us)
    try:
        yield end
    finally:
        end.close()


@dataclasses.dataclass
class Ended:
    """A daemon that has run."""

    status: int
    log: list[str]
    seconds_to_end: float = 0.0


class OtherCamera:
    """The simulated camera, or another, but for what a test's own `read` makes of it."""

    def __init__(self, camera: Camera | None = None, *, paced: bool = True) -> None:
        self._camera = camera or open_simulated(load_config(None, SIMULATED), paced=paced)

    @property
    def info(self) -> CameraInfo:
        return self._camera.info

    @property
    def panel(self) -> PanelValues | None:
        return self._camera.panel

    def close(self) -> None:
        self._camera.close()


@contextmanager
def daemon_in_thread(config: Config, camera: Camera, tap: Tap | None = None) -> Iterator[Daemon]:
    """One in this process, until the block is left."""
    running = Daemon(config, camera, tap=tap)
    thread = threading.Thread(target=running.run, daemon=True)
    thread.start()
    try:
        yield running
    finally:
        running.stop()
        thread.join(limit_s())


@contextmanager
def daemon(
    *settings: str, options: tuple[str, ...] = (), command: list[str] = COMMAND, life_s: float = LIFE_S
) -> Iterator[subprocess.Popen[str]]:
    command = [*command, *options, *(part for item in settings for part in ("--set", item))]
    process = subprocess.Popen(command, cwd=ROOT, stderr=subprocess.PIPE, text=True)
    try:
        with killed_if_late(process, life_s):
            yield process
    finally:
        process.kill()
        process.communicate()


def end(process: subprocess.Popen[str], signal_number: int | None = None) -> Ended:
    """Waits for the end, after a signal if one is given."""
    started = time.monotonic()
    if signal_number is not None:
        process.send_signal(signal_number)
    _, log = process.communicate(timeout=limit_s())
    return Ended(process.returncode, log.splitlines(), time.monotonic() - started)


@contextmanager
def holder(path: Path, lock: str = "fcntl.lockf(f, fcntl.LOCK_EX)") -> Iterator[int]:
    """The number of a process that has the file open, and locked where `lock` locks it."""
    command = [sys.executable, "-c", HOLD.format(lock=lock), str(path)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        process.stdout.readline()
        yield process.pid
        process.kill()


def wait_for_log(process: subprocess.Popen[str], text: str) -> str:
    """The next line of its log that has this text."""
    return lines_until(process, text)[-1]


def lines_until(process: subprocess.Popen[str], text: str, times: int = 1) -> list[str]:
    """All further lines of its log, up to the one that has this text for the last of so many times."""
    assert process.stderr is not None
    lines: list[str] = []
    with killed_if_late(process):
        for entry in process.stderr:
            lines.append(entry)
            times -= text in entry
            if not times:
                return lines
    raise AssertionError(f"the daemon did not say {text!r}, but ended or was late; its last words: {lines[-3:]}")


def slowness() -> float:
    """Returns how many times as long as planned work takes here, doubled: so much more time a busy machine gets.

    By short sleeps, and by how much of a processor is left to who wants all of one.
    """
    started, worked = time.monotonic(), time.thread_time()
    for _ in range(20):
        time.sleep(0.005)
    slept, began = time.monotonic() - started, time.monotonic()
    while (used := time.thread_time() - worked) < 0.05:
        pass
    return 2 * max(1.0, slept / 0.1, (time.monotonic() - began) / used)


def write_recording(
    folder: Path, frames: int, *, calibrated: bool = True, plain: bool = False, rows: int = 504
) -> None:
    """Writes one of panel 7, a metre away, at rest. `plain`: before a wall without texture. `rows`: frame to frame."""
    lens = ov5647_lens()
    sensor = SimulatedSensor(intrinsics=lens, exposure_us=9966.32, row_time_us=33.67, frame_length_rows=rows)
    scene = still_scene(sensor, {7: SPEC}, "DICT_4X4_50", distance_m=1.0, angle_deg=20.0)
    if plain:
        scene = dataclasses.replace(scene, room=Room(contrast=0.0))
    camera = SimulatedCamera(scene, seed=1, paced=False, frames=frames)
    values = dataclasses.asdict(camera.info) | {"intrinsics": lens if calibrated else None}
    with RecordingWriter(folder, camera=CameraInfo(**values), dictionary="DICT_4X4_50", panel=SPEC) as writer:
        into = np.empty((480, 640), np.uint8)
        while isinstance(frame := camera.read(into), Frame):
            writer.write(frame)
