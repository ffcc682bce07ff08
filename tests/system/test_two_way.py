"""The line both ways: a controller on a pty answers for its clock, tells its wheels, and hears where the robot is."""

from __future__ import annotations

import json
import os
import threading
import time
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from ledpi.camera.simulate.trajectory import Gliding
from ledpi.config.settings import load_config
from ledpi.wire import Mode, OdometryMessage, Receiver, StateMessage, TimeAnswer, TimeAsk
from ledpi.wire.codec import encode
from ledpi.wire.diary import Frame as FrameMark
from ledpi.wire.diary import read_diary
from tests.builders.command import in_process
from tests.builders.daemon import daemon_in_thread
from tests.builders.driving import MAP, Drive, tap_of
from tests.builders.tap import reach
from tests.builders.waiting import limit_s, wait_until

SPEED_M_S = 0.1
AHEAD_US, RATE = 4_294_000_000, 1.0001  # of the controller's clock: it wraps within the first second
GLIDE = Gliding(start=np.eye(4), velocity_m_s=np.array([0.0, 0.0, SPEED_M_S]))


class Wheels:
    """The controller. Its clock is fast, and it answers only when it looks, each 5 ms."""

    def __init__(self) -> None:
        self._master, slave = os.openpty()
        os.set_blocking(self._master, False)
        self._slave, self.port = slave, os.ttyname(slave)
        self._receiver, self._sequence = Receiver(), 0
        self.states: list[tuple[float, StateMessage]] = []  # with the time at which each came
        self.told_s = 0.0  # the last odometry
        self.silent = False
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def clock_us(self, t_s: float) -> int:
        return round(RATE * t_s * 1e6 + AHEAD_US) % 2**32

    def holds_s(self, at_s: float, state: StateMessage) -> float:
        """When a state holds that came at a time."""
        assert state.clock_us is not None
        late_us = (self.clock_us(at_s) - state.clock_us + 2**31) % 2**32 - 2**31
        return at_s - late_us / RATE / 1e6

    def _run(self) -> None:
        due_s = time.monotonic()
        while not self._ends.wait(0.005):
            try:
                heard = self._receiver.feed(os.read(self._master, 4096))
            except BlockingIOError:
                heard = []
            now_s = time.monotonic()
            for message in heard:
                if isinstance(message, StateMessage):
                    self.states.append((now_s, message))
                elif isinstance(message, TimeAsk):
                    stamp = self.clock_us(now_s)
                    self._say(
                        TimeAnswer(number=message.number, arrived_us=stamp, left_us=self.clock_us(time.monotonic()))
                    )
            if now_s >= due_s and not self.silent:
                due_s, self.told_s = now_s + 0.02, now_s
                way = round(SPEED_M_S * now_s * 1e4) % 2**31
                self._say(
                    OdometryMessage(clock_us=self.clock_us(now_s), left_100um=way, right_100um=way, yaw_100urad=0)
                )

    def _say(self, message: OdometryMessage | TimeAnswer) -> None:
        os.write(self._master, b"\0" + encode(message, self._sequence))
        self._sequence = self._sequence % 0xFFFF + 1

    def close(self) -> None:
        self._ends.set()
        self._thread.join()
        os.close(self._slave)
        os.close(self._master)


def test_the_controller_hears_where_it_is(tmp_path: Path) -> None:
    """Beside the panels, without them for two seconds, and then without odometry: each state says what it rests on.

    It is compared with the simulated drive at the time at which it says that it holds, on the controller's own clock.
    """
    (tmp_path / "markers.yaml").write_text(MAP)
    wheels, drive = Wheels(), Drive(GLIDE)
    keys = ("panels.side_m=0.16", f"map={tmp_path}/markers.yaml", f"serial.port={wheels.port}", "tap.socket=null")
    keys += ("rewind.seconds=0", "odometry.source=serial", "serial.max_age_ms=2000")
    try:
        with daemon_in_thread(load_config(None, keys), drive):
            began_s = time.monotonic()
            wait_until(partial(has_state, wheels, Mode.ODOMETRY, began_s, panels=2))
            assert wheels.states[0][1].mode is Mode.NONE  # and not silence
            seen_s = time.monotonic() + 1.0
            wait_until(partial(has_state, wheels, Mode.ODOMETRY, seen_s))
            drive.dark = True
            dark_s = time.monotonic() + 2.0
            wait_until(partial(has_state, wheels, Mode.ODOMETRY, dark_s))
            assert_near(wheels, drive, since_s=seen_s - 0.5, until_s=dark_s)
            _, last = wheels.states[-1]
            assert last.panel_age_ms is not None
            assert last.panel_age_ms > 1500
            assert last.way_m == pytest.approx(SPEED_M_S * last.panel_age_ms / 1e3, abs=0.03)
            wheels.silent = True
            wait_until(partial(has_state, wheels, Mode.NONE, wheels.told_s + 0.1))
    finally:
        wheels.close()


@pytest.mark.slow
def test_a_recording_gives_the_same_states(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A program on the tap is the controller. What it was told live, `ledpi decode` says again of the last seconds."""
    (tmp_path / "markers.yaml").write_text(MAP)
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    drive = Drive(GLIDE)
    keys = ("panels.side_m=0.16", f"map={tmp_path}/markers.yaml", f"tap.socket={tmp_path}/tap.sock")
    live: dict[int, dict[str, Any]] = {}
    config = load_config(None, (*keys, "rewind.seconds=60", "odometry.source=tap"))
    with tap_of(config) as tap, daemon_in_thread(config, drive, tap=tap), reach(tmp_path / "tap.sock") as client:
        assert "odometry" in client.hello["may"]
        told = 0
        for line in client.lines(tick_s=0.02):
            t_ns = time.monotonic_ns()
            if line["type"] == "robot_state":
                live[line["t_ns"]] = line
                told += line["mode"] == "odometry"
                client.send("odometry", t_ns=t_ns, yaw_rad=0.0, **dict.fromkeys(("left_m", "right_m"), 1e-10 * t_ns))
            if told > 100:
                break
        path = client.ask("save", limit_s())["path"]
    status, output, errors = in_process(monkeypatch, capsys, "decode")("--as-live", "--set", keys[1], path)
    assert (status, errors) == (0, "")
    (offset_ns,) = {entry.host_offset_ns for entry in read_diary(Path(path)) or () if isinstance(entry, FrameMark)}
    again = [line["state"] for line in map(json.loads, output.splitlines()) if line["state"] is not None]
    again = [state for state in again if state["t_ns"] + offset_ns in live]
    assert sum(state["mode"] == "odometry" for state in again) > 20
    for state in again:
        same = live[state["t_ns"] + offset_ns]
        assert [same[key] for key in NUMBERS] == [state[key] for key in NUMBERS]


NUMBERS = ("mode", "position_m", "yaw_rad", "covariance", "velocity", "way_m", "panels", "moved", "relocalisations")


def has_state(wheels: Wheels, mode: Mode, since_s: float, panels: int = 0) -> bool:
    newer = (state for at_s, state in wheels.states[-50:] if at_s > since_s)
    return any(state.mode is mode and state.clock_us is not None and state.panels >= panels for state in newer)


def assert_near(wheels: Wheels, drive: Drive, since_s: float, until_s: float) -> None:
    """Within 3 deviations and a bit, at the time at which each holds."""
    compared = [(at_s, state) for at_s, state in wheels.states if since_s < at_s < until_s]
    assert len(compared) > 20
    for at_s, state in compared:
        assert state.position_m is not None
        assert state.deviations is not None
        holds_s = wheels.holds_s(at_s, state)
        assert holds_s == pytest.approx(at_s, abs=0.5)  # a busy machine may be late
        true_m = SPEED_M_S * (holds_s - drive.began_ns * 1e-9), 0.0
        errors_m = np.abs(np.array(state.position_m) - true_m)
        assert (errors_m < 3 * np.array(state.deviations[:2]) + 0.001).all()
        assert errors_m[0] < 0.03
