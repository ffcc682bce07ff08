"""The controller's clock: how exactly it is known over a busy line, and what it makes of one that is set anew."""

from __future__ import annotations

import numpy as np
import pytest

from ledpi.core.records import Rejected
from ledpi.state.clock import JUMPED, UNKNOWN, WRAP_US, ControllerClock, Trip

BYTE_S = 10 / 115200
ASK_BYTES, ANSWER_BYTES, ODOMETRY_BYTES = 12, 21, 28


def trip(asked_s: float, ahead_s: float = 0.0, *, hold_s: float = 0.01, ways_s: tuple[float, float] = (0, 0)) -> Trip:
    """An answer of a controller whose clock is ahead; `ways_s`: unseen delays there and back."""
    arrived_s = asked_s + ways_s[0]
    arrived, left = (round((t + ahead_s) * 1e6) % WRAP_US for t in (arrived_s, arrived_s + hold_s))
    answered_s = arrived_s + hold_s + ways_s[1]
    return Trip(asked_ns=round(asked_s * 1e9), arrived_us=arrived, left_us=left, answered_ns=round(answered_s * 1e9))


def errors_ms(seed: int, *, looks_every_s: float = 0.001, usb_s: float = 0.0) -> list[float]:
    """A minute of answers twice a second, up to 20 ms late; the errors from 10 s on, of both directions alike."""
    rng, clock, found = np.random.default_rng(seed), ControllerClock(), []
    rate, ahead_s = 1 + rng.uniform(-200e-6, 200e-6), rng.uniform(0, WRAP_US / 1e6)
    for k in range(120):
        asked_s = k / 2 + rng.uniform(0, 0.002)
        there_s = (
            abs(rng.normal(0, 50e-6)) + rng.exponential(0.0002) + rng.uniform(0, usb_s) + rng.uniform(0, looks_every_s)
        )
        arrived_s = asked_s + there_s
        left_s = arrived_s + rng.uniform(0, 0.020)
        behind_s = rng.uniform(0, ODOMETRY_BYTES * BYTE_S) if rng.random() < 0.3 else 0.0
        answered_s = left_s + behind_s + rng.exponential(0.0003) + rng.uniform(0, usb_s)
        arrived_us, left_us = (round((rate * t + ahead_s) * 1e6) % WRAP_US for t in (arrived_s, left_s))
        asked_ns, answered_ns = round(asked_s * 1e9), round(answered_s * 1e9)
        clock.add(Trip(asked_ns=asked_ns, arrived_us=arrived_us, left_us=left_us, answered_ns=answered_ns))
        now_s = asked_s + rng.uniform(0.1, 0.5)
        if now_s > 10:
            told_ns = clock.to_ns(round((rate * now_s + ahead_s) * 1e6) % WRAP_US, round(now_s * 1e9))
            assert isinstance(told_ns, int)
            found.append(abs(told_ns / 1e6 - 1e3 * now_s))
    return found


@pytest.mark.parametrize(
    ("line", "limit_ms"),
    [
        pytest.param({}, 1.0, id="UART"),
        pytest.param({"usb_s": 0.001}, 1.0, id="USB adapter"),
        pytest.param({"looks_every_s": 0.005}, 1.0, id="looks every 5 ms"),
        pytest.param({"usb_s": 0.016}, 2.0, id="FTDI at its 16 ms"),
    ],
)
def test_a_clock_is_known_within_a_millisecond(line: dict[str, float], limit_ms: float) -> None:
    """Twenty controllers, off by up to 200 ppm, one minute each: 95 % of all moments from 10 s on."""
    assert np.percentile([error for seed in range(20) for error in errors_ms(seed, **line)], 95) <= limit_ms


def test_a_clock_that_wraps_goes_on() -> None:
    """32 bits of µs wrap each 71 minutes."""
    clock, before_s = ControllerClock(), WRAP_US / 1e6
    for asked_s in (before_s - 0.5, before_s, before_s + 0.5):
        assert clock.add(trip(asked_s)) is None
    assert clock.to_ns(250_000, round((before_s + 0.3) * 1e9)) == pytest.approx((before_s + 0.25) * 1e9, abs=1e5)
    assert clock.to_us(round((before_s + 0.25) * 1e9)) == pytest.approx(250_000, abs=100)


def test_a_clock_that_jumps_is_refused_and_then_begun_anew() -> None:
    """One answer may be wrong. Odometry of a wrong time counts, too; nothing is known meanwhile."""
    clock = ControllerClock()
    assert clock.to_ns(0, 0) == UNKNOWN
    assert clock.add(trip(1.0)) is None
    assert clock.add(trip(1.5, ahead_s=-0.3)) == JUMPED
    assert clock.add(trip(2.0)) is None
    assert clock.to_ns(2_000_000, 2_010_000_000) == pytest.approx(2e9, abs=1e6)
    assert clock.to_ns(9_000_000, 2_010_000_000) == JUMPED
    assert [clock.add(trip(t, ahead_s=70.0)) for t in (2.5, 3.0, 3.5)] == [JUMPED, JUMPED, None]
    told_ns = clock.to_ns(73_600_000, 3_610_000_000)
    assert not isinstance(told_ns, Rejected)
    assert told_ns == pytest.approx(3.6e9, abs=1e6)


def test_an_answer_that_cannot_be_is_no_beginning() -> None:
    """It says that it left long after it came here."""
    clock = ControllerClock()
    assert clock.add(Trip(asked_ns=0, arrived_us=5, left_us=900_000, answered_ns=20_000_000)) == JUMPED
    assert clock.to_us(30_000_000) is None


def test_a_clock_is_forgotten_after_minutes_of_silence() -> None:
    """Two crystals part by 200 ppm: after three minutes by 36 ms either way."""
    clock = ControllerClock()
    clock.add(trip(1.0))
    assert clock.to_us(60_000_000_000) is not None
    assert clock.to_us(181_000_000_000) is None
