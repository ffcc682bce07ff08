"""The gain follows the panels: in closed loop with a camera that obeys two frames later."""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass, field

import numpy as np
import pytest

from ledpi.camera.gain import FIRST_GAIN, GainControl, brightest_level
from ledpi.core.records import Frame

PERIOD_NS = 16_160_000  # 509 rows of 31.75 µs
OV5647 = (1.0, 63.9375)


@dataclass
class Loop:
    """A camera with a panel of brightness `light` at gain 1, read where it is neither full nor lost in the dark."""

    control: GainControl = field(default_factory=lambda: GainControl(OV5647))
    light: float = 0.1
    in_view: bool = True
    gain: float = FIRST_GAIN
    time_ns: int = 0
    asked: list[tuple[float, float]] = field(default_factory=list)  # (seconds, gain)
    levels: list[float] = field(default_factory=list)
    _coming: deque[float] = field(default_factory=lambda: deque([FIRST_GAIN] * 2))

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 1e9 / PERIOD_NS)):
            self._coming.append(self._coming[-1])
            self.gain = self._coming.popleft()
            level = min(1.0, self.light * self.gain)
            self.levels.append(level)
            is_read = self.in_view and 0.05 < level < 1.0
            new = self.control.update(self.time_ns, self.gain, level if is_read else None)
            if new is not None:
                self.asked.append((self.time_ns * 1e-9, new))
                self._coming[-1] = new
            self.time_ns += PERIOD_NS


@pytest.mark.parametrize("light", [0.004, 0.02, 0.1, 0.3, 0.7])
def test_a_panel_is_found_and_held(light: float) -> None:
    """From 150 times brighter to dim: within two rounds of the sweep it is read, and then stays so, well exposed."""
    loop = Loop(light=light)
    loop.run(3.0)
    changes = len(loop.asked)
    loop.run(3.0)
    assert len(loop.asked) == changes
    assert 0.06 <= loop.levels[-1] <= 0.75


def test_the_gain_is_left_alone_within_bounds() -> None:
    """A robot that moves changes the light all the time, and a change costs two frames; beyond, one step is enough.

    The sensor is linear: the first frame tells the right gain. Brighter than three quarters it goes down at once.
    """
    loop = Loop(light=0.1)
    loop.run(0.5)
    for loop.light in (0.05, 0.15, 0.08):
        loop.run(0.5)
    assert loop.asked == []
    for number, loop.light in enumerate((0.24, 0.035), 1):
        loop.run(0.2)
        assert len(loop.asked) == number
        assert loop.levels[-1] == pytest.approx(0.5)


def test_a_lost_panel_is_waited_for_one_second_before_the_sweep() -> None:
    """Somebody walks by: nothing changes for a second; then every gain has its turn, each for a quarter of one."""
    loop = Loop(light=0.1)
    loop.run(1.0)
    loop.in_view = False
    loop.run(0.95)
    assert loop.asked == []
    loop.run(2.5)
    assert [gain for _, gain in loop.asked[:6]] == [8.0, 16.0, 1.0, 2.0, 4.0, 8.0]
    times = [time for time, _ in loop.asked]
    assert np.diff(times).min() >= 0.25


def test_it_is_settled_once_a_panel_is_well_exposed() -> None:
    """Not while it sweeps, nor while a step is on its way; also where the sensor can do no more."""
    loop = Loop(light=0.02)
    assert not loop.control.settled
    loop.run(1.0)
    assert loop.control.settled
    loop.in_view = False
    loop.run(0.1)
    assert not loop.control.settled


def test_the_sensor_s_limits_are_kept() -> None:
    """A panel that is too bright at the least gain: nothing is asked that the sensor cannot do."""
    loop = Loop(light=0.9)
    loop.run(4.0)
    assert all(1.0 <= gain <= 16.0 for _, gain in loop.asked)
    assert loop.gain == 1.0


def test_brightness_is_that_of_the_panel_not_of_the_lamp_beside_it() -> None:
    """Only pixels within the corners count, and the picture; of several panels the brighter one; linear light, 0..1."""
    pixels = np.full((60, 80), 255, np.uint8)
    pixels[10:30, :30] = 51
    pixels[40:50, 40:50] = 102
    frame = Frame(pixels=pixels, seq=0, row0_readout_ns=0, exposure_us=1e4, row_time_us=31.75, transfer="linear")
    near = np.array([[-20.0, 11.0], [28.0, 11.0], [28.0, 28.0], [-20.0, 28.0]])
    small = np.array([[41.0, 41.0], [48.0, 41.0], [48.0, 48.0], [41.0, 48.0]])
    assert brightest_level(frame, [near]) == pytest.approx(0.2)
    assert brightest_level(frame, [near, small]) == pytest.approx(0.4)
    assert brightest_level(frame, [np.add(small, (15, -30))]) == 1.0  # the lamp
    assert brightest_level(frame, []) is None
