"""The example that drives: in closed loop on this machine, and its programs on an emulated microcontroller."""

from __future__ import annotations

import math
import re
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from evaluation.drives.docking import Docking, dock
from examples import tap_dock
from examples.tap_robot import STAND, Seen
from ledpi.wire import Mode, OdometryMessage, Receiver, StateMessage
from ledpi.wire.codec import FROM_CONTROLLER, encode
from tests.builders import ROOT
from tests.builders.receiver import needs_gcc
from tests.builders.simavr import CLOCK_HZ, emulate, needs_simavr

BAUD = 115200


class InPython:
    """The example on the tap, that is told what the bytes of a line say."""

    def begin(self, goal: tuple[float, float, float], panel_m: float) -> None:
        self._receiver, self._state, self._steering = Receiver(), dict[str, Any](t_ns=0), tap_dock.dock()
        assert (goal, panel_m) == ((tap_dock.GOAL, 0.0, 0.0), tap_dock.PANEL_M)
        next(self._steering)

    def hear(self, line: bytes, now_us: int) -> None:
        (said,) = self._receiver.feed(line)
        assert isinstance(said, StateMessage)
        self._state = {"mode": "none" if said.mode is Mode.NONE else "odometry", "contested": said.contested}
        self._state |= {"t_ns": 1000 * (said.clock_us or 0), "position_m": said.position_m, "yaw_rad": said.yaw_rad}
        self._state |= {"velocity": said.velocity, "covariance": np.diag(said.deviations or np.zeros(3)).ravel() ** 2}

    def dock(self, now_us: int) -> tuple[tuple[float, float], bool]:
        seen = Seen(self._state, 1000 * now_us)
        try:
            return self._steering.send(seen) if seen.is_known() else STAND, False
        except StopIteration:
            return STAND, True


@needs_gcc
@pytest.mark.parametrize(
    ("seed", "asked", "steers"),
    [
        pytest.param(8, Docking(), None, id="gyro"),
        pytest.param(15, Docking(gyro=False), None, id="wheels: the panel leaves the view", marks=pytest.mark.slow),
        pytest.param(15, Docking(gyro=False), InPython(), id="the program on the tap", marks=pytest.mark.slow),
        pytest.param(5, Docking(dead_band_m_s=0.04), None, id="dead band", marks=pytest.mark.slow),
        pytest.param(1, Docking(side_share=0.01), None, id="side_m 1 % off", marks=pytest.mark.slow),
    ],
)
def test_it_docks(seed: int, asked: Docking, steers: InPython | None) -> None:
    """Within 10 mm and 1.5°, and does not touch the wall; `evaluation.drives` does it from a hundred starts."""
    done = dock(seed, asked, steers)
    assert not done.touched
    assert math.hypot(*done.error[:2]) < 0.010
    assert abs(math.degrees(done.error[2])) < 1.5


@needs_gcc
def test_a_cut_line_stops_it() -> None:
    """At full speed: the motors are told so within 0.3 s of the last state."""
    done = dock(8, Docking(cut_s=2.0))
    assert 2.0 < done.moving_s < 2.3


@pytest.fixture(scope="module")
def programs() -> Path:
    """The folder, built without a warning."""
    folder = ROOT / "firmware" / "drive"
    subprocess.run(["make", "-C", str(folder)], check=True, capture_output=True)
    return folder


STATES_S = [0.1 + 0.02 * n for n in range(10)]
LAST_BYTE_S = STATES_S[-1] + 41 * 10 / BAUD


@pytest.mark.slow
@needs_simavr
@pytest.mark.parametrize(
    ("program", "yaw_rad", "contested", "ahead"),
    [
        pytest.param("dock", 0.0, False, (True, True), id="to the panel"),
        pytest.param("go_to", 3.0, False, (True, False), id="turns right: the point is behind on that side"),
        pytest.param("dock", 0.0, True, None, id="another pose is possible"),
    ],
)
def test_it_drives_a_microcontroller(
    program: str, yaw_rad: float, contested: bool, ahead: tuple[bool, bool] | None, programs: Path, tmp_path: Path
) -> None:
    """While states come the motors are on, in the right direction; within 0.3 s of the last they are off, for good."""
    state = StateMessage(
        position_m=(-1.5, 0.1), yaw_rad=yaw_rad, velocity=(0.0, 0.0), deviations=(0.01, 0.01, 0.01),
        correlations=(0.0, 0.0, 0.0), mode=Mode.ODOMETRY, panels=1, contested=contested,
    )  # fmt: skip
    arrivals = [(at_s, b"\0" + encode(state, n)) for n, at_s in enumerate(STATES_S)]
    told = emulate(programs / f"{program}.hex", 0.8, work=tmp_path, arrivals=arrivals, baud=BAUD)
    edges_s = (told.edges["PB1"] / CLOCK_HZ).tolist()
    if ahead is None:
        assert edges_s == []
    else:
        on_s, off_s = edges_s
        assert STATES_S[0] < on_s < STATES_S[0] + 0.05
        assert LAST_BYTE_S < off_s < LAST_BYTE_S + 0.3
        middle = round((on_s + 0.05) * CLOCK_HZ)
        assert (told.is_high("PB0", middle), told.is_high("PB4", middle)) == ahead
    receiver = Receiver(FROM_CONTROLLER)
    odometry = [m for m in receiver.feed(told.said) if isinstance(m, OdometryMessage)]
    assert (receiver.counters.bad, receiver.counters.lost) == ({}, 0)
    assert len(odometry) == pytest.approx(39, abs=2)


@needs_simavr
def test_it_takes_less_than_600_bytes(programs: Path) -> None:
    """Receiver, queue, and all of the steering."""
    for name in ("dock", "go_to"):
        command = ["avr-size", str(programs / f"{name}.elf")]
        table = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
        _, data, bss = (int(number) for number in re.findall(r"\d+", table[1])[:3])
        assert 0 < data + bss <= 600
