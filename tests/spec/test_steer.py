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
from evaluation.drives.robot import steered
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


def test_it_stands_before_the_panel_where_its_place_is_uncertain() -> None:
    """Both examples: 5 mm beyond the goal, then with a deviation of half a metre; once that is known it goes on."""
    for steers in (steered(), InPython()):
        steers.begin((tap_dock.GOAL, 0.0, 0.0), tap_dock.PANEL_M)
        told = []
        for n in range(400):
            deviation_m = 0.5 if 50 <= n < 300 else 0.003
            state = StateMessage(
                position_m=(tap_dock.GOAL + 0.005, 0.0), yaw_rad=0.0, velocity=(0.0, 0.0),
                deviations=(deviation_m, deviation_m, 0.001), correlations=(0.0, 0.0, 0.0), mode=Mode.ODOMETRY,
                panels=1, clock_us=20_000 * n,
            )  # fmt: skip
            steers.hear(b"\0" + encode(state, n & 0xFF), 20_000 * n)
            told.append(steers.dock(20_000 * n))
        assert {motion for motion, _ in told[51:300]} == {STAND}
        assert {motion for motion, _ in told[300:]} > {STAND}
        assert not any(docked for _, docked in told)


BOARD_CLOCK = """
#define F_CPU 16000000UL
#include <stdio.h>
#include "board.h"
volatile uint16_t TCNT1, UBRR0;
volatile uint8_t %s;
int main(void)
{
    const uint64_t at_us[] = {0, 1ull << 31, (1ull << 31) + 70000, (1ull << 32) - 1, (1ull << 32) + 7};
    for (int k = 0; k < 5; k++) {
        TCNT1 = (uint16_t)(2 * at_us[k]);
        board_overflows = (uint32_t)(2 * at_us[k] >> 16);
        printf("%%lu\\n", (unsigned long)board_now_us());
    }
}
"""
REGISTERS = "TIFR1,PIND,UDR0,UCSR0A,DDRB,DDRD,EICRA,EIMSK,TCCR0A,TCCR0B,TCCR1B,TIMSK1,UCSR0B,OCR0A,OCR0B,PORTB"
BITS = "TOV1,PD4,PD7,DDB0,DDB1,DDB4,DDD5,DDD6,ISC01,ISC00,ISC11,ISC10,INT0,INT1,COM0A1,COM0B1,WGM00,CS01,CS11"
BITS += ",TOIE1,U2X0,RXCIE0,RXEN0,TXEN0,UDRE0,PORTB1,PORTB0,PORTB4"


@needs_gcc
def test_the_board_s_clock_has_32_bits(tmp_path: Path) -> None:
    """Also after 35 minutes, with the timer of half microseconds; compiled for this machine, its registers made up."""
    headers = {
        "avr/interrupt.h": "#define ISR(v) void v(void)\n#define sei()",
        "avr/io.h": f"#include <stdint.h>\n#define _BV(b) (1 << (b))\nextern volatile uint16_t TCNT1, UBRR0;\n"
        f"extern volatile uint8_t {REGISTERS};\nenum {{{BITS}}};",
        "util/atomic.h": "#define ATOMIC_BLOCK(x) if (1)",
        "clock.c": BOARD_CLOCK % REGISTERS,
    }
    for name, text in headers.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text, encoding="ascii")
    folders = [f"-I{folder}" for folder in (tmp_path, ROOT / "firmware/drive", ROOT / "firmware/receiver")]
    subprocess.run(["gcc", "-w", *folders, "-o", tmp_path / "clock", tmp_path / "clock.c", "-lm"], check=True)
    told = subprocess.run([tmp_path / "clock"], capture_output=True, text=True, check=True).stdout.split()
    assert told == ["0", "2147483648", "2147553648", "4294967295", "7"]


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
