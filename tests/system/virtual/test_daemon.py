"""The daemon on the real picamera2 and libcamera: rendered panels in, packets out of a pty."""

from __future__ import annotations

import gc
import json
import os
import re
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from ledpi.camera.factory import open_camera
from ledpi.cli import main
from ledpi.config.settings import Config, load_config
from ledpi.core.records import Frame, Pixels
from ledpi.daemon.daemon import Daemon
from ledpi.wire import NoFix, State
from ledpi.workshop.doctor.camera import camera as camera_findings
from tests.builders.daemon import controller, slowness
from tests.builders.virtual_panels import IDS, SETTINGS, rendered
from tests.builders.virtual_picamera2 import ROW_US, Behaviour, show, unplug
from tests.builders.waiting import limit_s

QUIET_S = 0.2  # promised until "no fix" is on the wire
RETURN_S = 2.0  # and until a camera that is there again is in use
AS_SET = tuple(part for item in SETTINGS for part in ("--set", item))


def settings(port: str = "/dev/null", max_age_ms: float = 100.0) -> Config:
    return load_config(None, (*SETTINGS, f"serial.port={port}", f"serial.max_age_ms={max_age_ms}"))


@pytest.fixture(scope="module")
def pictures() -> list[Pixels]:
    """Rendered once."""
    return rendered()


@contextmanager
def running(port: str, max_age_ms: float = 100.0) -> Iterator[Daemon]:
    """A daemon on the virtual camera, in a thread; stopped, and its error raised, at the end."""
    config = settings(port, max_age_ms)
    failed: list[BaseException] = []
    daemon = Daemon(config, open_camera(config, recover=True))

    def run() -> None:
        try:
            daemon.run()
        except BaseException as error:
            failed.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    try:
        yield daemon
    finally:
        daemon.stop()
        thread.join(limit_s())
        assert not thread.is_alive()
    if failed:
        raise failed[0]


def test_the_right_ids_arrive(behaviour: Behaviour, pictures: list[Pixels], tmp_path: Path) -> None:
    """Through picamera2, ring, decoder and serial line come the IDs that `ledpi decode` reads in the files."""
    show(tmp_path / "panels", pictures)
    files = sorted((tmp_path / "panels").glob("*.jpg"))
    given = (*SETTINGS, f"camera.exposure_us={int(314 * ROW_US)}")
    command = [sys.executable, "-c", "from ledpi.cli import main; main()", "decode", *map(str, files)]
    command += [part for item in given for part in ("--set", item)]
    lines = subprocess.run(command, capture_output=True, text=True, check=True, timeout=limit_s(30)).stdout.splitlines()
    decoded = [{marker["id"] for marker in json.loads(line)["markers"]} for line in lines]
    assert decoded == [set(IDS)] * len(files)
    # However slow the machine is: which IDs, not how soon.
    with controller(1_000_000) as line, running(line.port, 1000.0):
        line.wait_for(lambda end: len({marker.id for marker in end.markers}) == len(IDS) and len(end.markers) > 30)
    assert {marker.id for marker in line.markers} == set(IDS)


def test_no_fix_is_said_when_the_camera_is_taken_away_and_it_comes_back(
    behaviour: Behaviour, pictures: list[Pixels], tmp_path: Path
) -> None:
    """It stalls and is unplugged: within 200 ms the wire says so; plugged in again it is in use within 2 s."""
    show(tmp_path / "panels", pictures)
    with controller() as line, running(line.port):
        line.wait_for(lambda end: len(end.markers) > 5)
        unplug()
        behaviour.stalled.set()
        gone_s = time.monotonic()
        line.wait_for(lambda end: end.statuses[-1][1].state is State.CAMERA_LOST)
        said_s = next(at for at, status in line.statuses if at > gone_s and status.state is State.CAMERA_LOST)
        time.sleep(1.0)
        last = line.statuses[-1][1]
        assert (last.state, last.no_fix) == (State.CAMERA_LOST, NoFix.NO_FRAMES)
        assert max(at for at, message in line.got if message in line.markers) < said_s + 0.1
        behaviour.stalled.clear()
        show(tmp_path / "again", pictures)
        back_s = time.monotonic()
        line.wait_for(lambda end: any(at > back_s for at, message in end.got if message in end.markers))
        first_s = next(at for at, message in line.got if at > back_s and message in line.markers)
    print(f"no fix said after {said_s - gone_s:.3f} s, in use again after {first_s - back_s:.3f} s")
    assert said_s - gone_s < QUIET_S * slowness()
    assert first_s - back_s < RETURN_S * slowness()


def test_an_error_in_the_event_loop_is_recovered_from(
    behaviour: Behaviour, pictures: list[Pixels], tmp_path: Path
) -> None:
    """One failed wait: the camera is opened anew and the packets go on."""
    show(tmp_path / "panels", pictures)
    with controller() as line, running(line.port):
        line.wait_for(lambda end: len(end.markers) > 5)
        behaviour.failing = RuntimeError("Dequeue timer expired")
        line.wait_for(lambda end: any(status.state is State.CAMERA_LOST for _, status in end.statuses))
        count = len(line.markers)
        line.wait_for(lambda end: len(end.markers) > count + 10)
    assert len(behaviour.opened) == 2


def test_lost_fifty_times_nothing_is_left(behaviour: Behaviour) -> None:
    """Each time it stalls, is closed and opened again: descriptors and threads stay as many, memory as much."""
    config = settings()
    camera = open_camera(config, recover=True)
    into = np.zeros((480, 640), np.uint8)

    def read_frame() -> None:
        while not isinstance(camera.read(into), Frame):
            pass

    def lose() -> None:
        read_frame()
        behaviour.stalled.set()
        while isinstance(camera.read(into), Frame):
            pass
        behaviour.stalled.clear()
        read_frame()
        del behaviour.opened[:-1]
        gc.collect()

    for _ in range(3):
        lose()
    before = leftovers()
    for _ in range(50):
        lose()
    after = leftovers()
    camera.close()
    assert after[:2] == before[:2]
    assert (after[2] - before[2]) / 50 < into.size / 4


def command(arguments: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> str:
    """Returns what a command of ledpi prints; here, as only this process has the virtual OV5647."""
    monkeypatch.setattr("sys.argv", ["ledpi", *arguments])
    with pytest.raises(SystemExit) as ended:
        main()
    assert ended.value.code in (0, None)
    return capsys.readouterr().out


def test_a_snapshot_is_taken(
    behaviour: Behaviour,
    pictures: list[Pixels],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """One frame, read and drawn, once the gain has found the panels."""
    show(tmp_path / "panels", pictures)
    said = command(["snapshot", "--out", str(tmp_path / "look.png"), *AS_SET], monkeypatch, capsys)
    named = {int(marker_id) for marker_id in re.findall(r"ID (\d+) without a pose", said)}
    assert named
    assert named <= set(IDS)
    assert (tmp_path / "look.png").stat().st_size > 10_000


def test_a_recording_repeats_what_was_live(
    behaviour: Behaviour,
    pictures: list[Pixels],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Two seconds at full rate: frames on disk with time, exposure and gain; the replay decodes as live."""
    show(tmp_path / "panels", pictures)
    take = tmp_path / "take"
    said = command(["record", str(take), "--seconds", "2", *AS_SET], monkeypatch, capsys)
    live = [json.loads(text) for text in (take / "live.jsonl").read_text().splitlines()]
    lines = [json.loads(text) for text in (take / "frames.jsonl").read_text().splitlines()]
    assert f"{len(lines)} frames" in said
    missed = lines[-1]["seq"] - lines[0]["seq"] + 1 - len(lines)
    assert ("none lost" in said) if missed == 0 else (f"{missed} missed" in said), "a gap is told, and nothing else"
    assert {(entry["exposure_us"], entry["analogue_gain"] >= 1) for entry in lines} == {(int(314 * ROW_US), True)}
    again = [json.loads(text) for text in command(["decode", "--as-live", str(take)], monkeypatch, capsys).splitlines()]
    for result in live + again:
        del result["decode_ms"]
    assert {marker["id"] for result in live for marker in result["markers"]} == set(IDS)
    assert again == live


def test_the_doctor_finds_the_camera_well(behaviour: Behaviour, pictures: list[Pixels], tmp_path: Path) -> None:
    """Opened, tried and closed again: mode, exposure and row time are as asked."""
    show(tmp_path / "panels", pictures)
    findings, info = camera_findings(settings())
    assert [(finding.name, finding.state) for finding in findings] == [
        (name, "ok") for name in ("camera", "sensor mode", "exposure", "row time", "panels")
    ]
    assert info is not None
    assert not behaviour.opened[0].is_open


def leftovers() -> tuple[int, int, int]:
    """Open descriptors, threads, bytes of resident memory."""
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return len(os.listdir("/proc/self/fd")), threading.active_count(), pages * os.sysconf("SC_PAGE_SIZE")
