"""`ledpi run`: a real process, a pty for the motor controller, and what comes out at its other end."""

from __future__ import annotations

import dataclasses
import logging
import os
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
import pytest

from evaluation.speed.latency import measure
from ledpi.camera.simulated import open_simulated
from ledpi.config.settings import Config, load_config
from ledpi.core.errors import CameraError
from ledpi.core.records import Frame, Pixels
from ledpi.daemon.daemon import Daemon
from ledpi.wire import NoFix, State, StatusMessage
from tests.builders.command import complaint as one_complaint
from tests.builders.command import in_process
from tests.builders.daemon import (
    ROOT,
    SIMULATED,
    Controller,
    Ended,
    OtherCamera,
    controller,
    daemon,
    end,
    slowness,
    write_recording,
)
from tests.builders.waiting import limit_s

alone = pytest.mark.alone  # it tells how late a daemon is: no other test may take the processor meanwhile

LONG_MS = 10_000  # no pose grows too old, however busy the machine is
END_S = 3.0  # for the end after a signal: 1 s is promised, a busy machine gets more
HEALTH = re.compile(r"INFO \d+ frames/s, \d+ decoded/s, \d+ markers/s, \d+ in view; dropped \d+ of \d+; ms: .*; pac")


# ---- A paced run on the simulated camera, ended by SIGTERM


@dataclasses.dataclass
class Run:
    """The results of a run of some seconds."""

    controller: Controller
    ended: Ended


@pytest.fixture(scope="module")
def drive() -> Iterator[Run]:
    """The simulated drive, from the first marker on for 2.5 s."""
    with controller() as line, daemon(*SIMULATED, f"serial.port={line.port}") as process:
        line.wait_for(lambda c: bool(c.markers))
        time.sleep(2.5)
        ended = end(process, signal.SIGTERM)
        line.close()
        yield Run(line, ended)


@alone
def test_sigterm_ends_it_soon_and_well(drive: Run) -> None:
    """Exit status 0, no traceback, and a summary as its last line."""
    assert drive.ended.status == 0
    assert drive.ended.seconds_to_end < END_S * slowness()
    assert not any("Traceback" in line for line in drive.ended.log)
    assert re.match(r"INFO ended: \d+ frames, \d+ dropped, \d+ decoded, \d+ markers", drive.ended.log[-1])


@alone
def test_the_last_word_is_stopping(drive: Run) -> None:
    """The controller knows that no more will come."""
    last = drive.controller.got[-1][1]
    assert isinstance(last, StatusMessage)
    assert (last.state, last.no_fix) == (State.STOPPING, NoFix.NOT_RUNNING)


@alone
def test_the_right_ids_are_sent_and_no_others(drive: Run) -> None:
    """Panels 7 and 23 stand in that scene; no packet was damaged or lost."""
    assert {marker.id for marker in drive.controller.markers} == {7, 23}
    counters = drive.controller.receiver.counters
    assert (counters.bad, counters.skipped, counters.lost) == ({}, {}, 0)


@alone
def test_poses_are_of_this_scene(drive: Run) -> None:
    """Between 0.5 and 3 m ahead, nearer to the line of sight than to the side; quaternions of length 1.

    A mirror pose, which is told beside the other while it is not excluded, may be farther, and says how sure it is.
    """
    for marker in drive.controller.markers:
        assert marker.pose is not None
        assert not marker.uncalibrated
        x, y, z = marker.pose.position_m
        assert 0.5 < z < 3.0 or marker.alternate
        assert max(abs(x), abs(y)) < 0.5 * z
        assert np.linalg.norm(marker.pose.quaternion_wxyz) == pytest.approx(1.0, abs=1e-3)


@alone
def test_ages_are_plausible(drive: Run) -> None:
    """At least half of the exposure and the read-out below the panel, at most what the configuration allows."""
    ages_ms = [marker.age_us / 1000 for marker in drive.controller.markers]
    assert min(ages_ms) > 5.0
    assert max(ages_ms) <= 100.0


@alone
def test_the_heartbeat_comes_five_times_a_second(drive: Run) -> None:
    """From the first status to the last, with room for a busy machine: none is more than half a second late."""
    gaps_s = np.diff([at for at, _ in drive.controller.statuses])
    assert np.median(gaps_s) <= 0.2
    assert gaps_s.max() < 0.35 * slowness()


@alone
def test_the_heartbeat_says_how_it_goes(drive: Run) -> None:
    """Running; without a map there is no fix, and that is why; panels are in view, frames and markers are counted.

    On a busy machine the decoder may be behind at times, and says so.
    """
    running = [status for _, status in drive.controller.statuses if status.state is State.RUNNING]
    assert running
    said = {status.no_fix for status in running}
    assert NoFix.NO_MAP in said
    assert said <= {NoFix.NO_MAP, NoFix.BEHIND}
    assert max(status.panels_in_view or 0 for status in running) == 2
    first, last = running[0], running[-1]
    assert (last.frames or 0) > (first.frames or 0) > 0
    assert (last.markers or 0) > 0
    assert (last.decode_p50_us or 0) > 0
    assert (last.decode_p99_us or 0) >= (last.decode_p50_us or 0)


@alone
def test_a_line_each_second_says_how_it_goes(drive: Run) -> None:
    """Frames, markers, what was dropped, stage times, packets, and the port."""
    health = [line for line in drive.ended.log if HEALTH.match(line)]
    assert len(health) >= 2
    assert "port open" in health[-1]
    assert "find" in health[-1]
    assert "identify" in health[-1]


# ---- Recordings


@pytest.mark.slow
def test_a_bad_frame_is_counted_and_skipped(tmp_path: Path) -> None:
    """In the middle of a recording: it is named once, all others are decoded, and the run ends well."""
    write_recording(tmp_path / "take", 8)
    picture = tmp_path / "take/frames/000004.png"
    picture.write_bytes(picture.read_bytes()[:3000])
    with controller() as line:
        settings = (f"camera.source=recording:{tmp_path / 'take'}", f"serial.port={line.port}")
        with daemon(*settings, options=("--unpaced",)) as process:
            ended = end(process)
    assert ended.status == 0
    warned = [
        entry for entry in ended.log if "WARN" in entry and "serial_shared" not in entry
    ]  # the test holds the port
    assert [entry for entry in ended.log if str(picture) in entry] == warned
    assert len([entry for entry in ended.log if str(picture) in entry]) == 1
    assert "ended: 7 frames, 0 dropped, 7 decoded, 7 markers" in ended.log[-1]
    assert "capture.truncated 1" in ended.log[-1]


@pytest.mark.slow
@alone
def test_without_a_lens_ids_are_sent_flagged_uncalibrated(tmp_path: Path) -> None:
    """No poses; the heartbeat and a warning say why."""
    write_recording(tmp_path / "take", 20, calibrated=False)
    with controller(max_age_us=1000 * LONG_MS) as line:
        settings = (f"camera.source=recording:{tmp_path / 'take'}", f"serial.port={line.port}")
        settings = (*settings, f"serial.max_age_ms={LONG_MS}")
        with daemon(*settings, options=("--frames", "1000000")) as process:
            line.wait_for(lambda c: any(status.no_fix is NoFix.UNCALIBRATED for _, status in c.statuses))
            line.wait_for(lambda c: bool(c.markers))
            ended = end(process, signal.SIGTERM)
        line.close()
        assert ended.status == 0
        assert any("camera.intrinsics is not set" in entry for entry in ended.log)
        assert {(marker.id, marker.pose, marker.uncalibrated) for marker in line.markers} == {(7, None, True)}
        running = [status.no_fix for _, status in line.statuses if status.state is State.RUNNING]
        assert set(running) <= {NoFix.UNCALIBRATED, NoFix.BEHIND}  # where the machine is busy


@pytest.mark.slow
def test_a_short_soak(tmp_path: Path) -> None:
    """300 frames through the whole daemon, unpaced. One that kept its frames would grow by 60 MB; 1 MiB is allowed."""
    command = [sys.executable, "-m", "evaluation.endurance.soak", "--frames", "300"]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=limit_s(30))
    assert done.returncode == 0, done.stdout + done.stderr
    assert "300 frames in" in done.stdout
    assert "0 dropped, 300 decoded" in done.stdout


@pytest.mark.slow
@alone
def test_a_pose_leaves_once_it_is_decoded() -> None:
    """Frame ready → first byte takes no longer than decoding and 1 ms; of a busy machine the quicker quarter counts.

    `evaluation/speed/latency.py` asks that of the 99th percentile, on a machine that has nothing else to do.
    """
    latency = measure(0.4 * slowness(), frames=60, warm_up=20)
    assert latency.packets > 8
    assert latency.p25 <= slowness() * (latency.decode_p50 + 1.0)


# ---- What cannot run


def complaint(
    arguments: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], folder: Path
) -> str:
    """The one line on standard error of a run that ended with status 2."""
    monkeypatch.chdir(folder)
    monkeypatch.setattr(logging, "basicConfig", lambda **_: None)  # pytest's own handlers stay
    return one_complaint(in_process(monkeypatch, capsys, "run")(*arguments))


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ([], "or /etc/ledpi/config.yaml; `ledpi config init` writes one"),
        (["--set", "panels.side_m=1", "--set", "camera.source=recording:gone"], "gone/recording.yaml: is missing"),
        (["--set", "camera.source=simulated", "--set", "camera.intrinsics=gone.yaml"], "gone.yaml: cannot be read"),
        (
            ["--set", "panels.side_m=1", "--unpaced"],
            "--frames, --unpaced: only for camera.source: simulated or recording:PATH, not picamera2",
        ),
        (["--set", "panels.side_m=1", "--set", "camera.source=v4l2:/dev/null"], "camera.row_time_us: must be a number"),
    ],
)
def test_what_cannot_run_is_reported_in_one_line(
    arguments: list[str],
    message: str,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    """The key or the file, what is wrong, and what would be right; exit status 2, and nothing has started."""
    assert message in complaint(arguments, monkeypatch, capsys, tmp_path)


@pytest.mark.parametrize(
    ("source", "status"),
    [("v4l2:/dev/video99", 1), ("v4l2:/dev/null", 2), ("v4l2:", 2), ("webcam", 2), ("recording:gone", 2)],
)
def test_a_camera_that_may_come_is_status_1_and_a_source_that_cannot_be_right_2(
    source: str,
    status: int,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
) -> None:
    """A service manager tries again after 1; 2 is for a person. The help says so."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(logging, "basicConfig", lambda **_: None)
    given = ("--set", "panels.side_m=1", "--set", "camera.row_time_us=30", "--set", f"camera.source={source}")
    ended, output, errors = in_process(monkeypatch, capsys, "run")(*given)
    assert (ended, output, len(errors.splitlines())) == (status, "", 1)
    _, told, _ = in_process(monkeypatch, capsys, "run")("--help")
    assert "1: the camera is absent" in " ".join(told.split())


# ---- The daemon without its command line


class Failing(OtherCamera):
    """A camera that delivers three frames of the simulator and then fails."""

    def __init__(self, failure: Exception) -> None:
        super().__init__(paced=False)
        self._failure, self._frames = failure, 0
        self.closed = False

    def read(self, into: Pixels) -> Frame | None:
        self._frames += 1
        if self._frames > 3:
            raise self._failure
        return self._camera.read(into)

    def close(self) -> None:
        self.closed = True


def config(port: str) -> Config:
    return load_config(None, (*SIMULATED, f"serial.port={port}"))


@pytest.mark.parametrize("failure", [CameraError("the camera was unplugged"), ZeroDivisionError("a bug")])
def test_a_failing_camera_ends_the_daemon_with_its_error(failure: Exception) -> None:
    """Whatever stops a worker is raised where the daemon runs, soon; the controller gets its last word."""
    with controller() as line:
        settings = config(line.port)
        camera = Failing(failure)
        started = time.monotonic()
        with pytest.raises(type(failure), match=str(failure)):
            Daemon(settings, camera).run()
        assert time.monotonic() - started < 10
        line.close()
        assert camera.closed
        last = line.got[-1][1]
        assert isinstance(last, StatusMessage)
        assert last.state is State.STOPPING


def test_a_failing_publisher_ends_the_daemon_with_its_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """A daemon that decodes and sends nothing must not look alive to its service manager."""

    def broken(*_: object) -> bytes:
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr("ledpi.wire.publisher.encode", broken)
    with controller() as line:
        settings = config(line.port)
        running = Daemon(settings, open_simulated(settings, paced=True))
        rescue = threading.Timer(20, running.stop)
        rescue.start()
        with pytest.raises(ZeroDivisionError, match="a bug"):
            running.run()
        rescue.cancel()


def test_an_exposure_that_hides_the_bands_is_warned_of(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """20 ms hold 25 cycles of 1250 Hz and 49 of 2450: nothing is left. With 10 ms there is nothing to say."""
    settings = load_config(None, (*SIMULATED, f"serial.port={tmp_path}/none", "camera.exposure_us=20000"))
    Daemon(settings, open_simulated(settings, paced=False))
    (warning,) = (record.getMessage() for record in caplog.records if record.levelno == logging.WARNING)
    assert warning.startswith("camera.exposure_us: 19968 µs are near a null of 1250 and 2450 Hz: ")
    caplog.clear()
    settings = config(str(tmp_path / "none"))
    Daemon(settings, open_simulated(settings, paced=False))
    assert not caplog.records


def test_an_exposure_that_the_camera_cannot_do_is_warned_of(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """10 µs are asked for; the sensor exposes for four rows at least."""
    settings = load_config(None, (*SIMULATED, f"serial.port={tmp_path}/none", "camera.exposure_us=10"))
    Daemon(settings, open_simulated(settings, paced=False))
    said = "camera.exposure_us: the camera exposes for 135 µs, where 10 µs were asked for"
    assert said in [record.getMessage() for record in caplog.records]


def test_a_stop_before_the_start_counts(tmp_path: Path) -> None:
    """A signal that comes while the camera is still being set up is not forgotten."""
    settings = config(str(tmp_path / "no-port"))
    running = Daemon(settings, open_simulated(settings, paced=True))
    running.stop()
    started = time.monotonic()
    running.run()
    assert time.monotonic() - started < END_S * slowness()


def test_a_signal_cannot_lock_the_daemon_up(tmp_path: Path) -> None:
    """A handler runs between any two lines of what waits, also inside an Event, whose lock is then held."""
    settings = config(str(tmp_path / "no-port"))
    running = Daemon(settings, open_simulated(settings, paced=True))
    interrupted: list[int] = []

    def handler(frame: FrameType, event: str, _: Any) -> Any:
        if event == "line":
            interrupted.append(frame.f_lineno)
            running.stop()
        return handler

    def watch(frame: FrameType, event: str, _: Any) -> Any:
        return handler if frame.f_code is threading.Event.wait.__code__ else None

    def run() -> None:
        sys.settrace(watch)
        running.run()

    waiting = threading.Thread(target=run, daemon=True)
    waiting.start()
    waiting.join(limit_s())
    assert not waiting.is_alive()
    assert len(set(interrupted)) >= 3
