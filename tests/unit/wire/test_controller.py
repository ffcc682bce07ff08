"""A controller's messages become odometry on our clock."""

from __future__ import annotations

import dataclasses

import pytest

from ledpi.core.records import Rejected
from ledpi.state.clock import UNKNOWN
from ledpi.state.inputs import Odometry
from ledpi.wire import OdometryMessage, TimeAnswer
from ledpi.wire.keeper import UNASKED, Controller

MS = 1_000_000
AHEAD_US = 0xFFFF0000  # of its clock: it wraps after 65 ms


def agreed() -> Controller:
    """One that was asked at our time 0, took the question in 1.04 ms later and answered at once; at 115200 baud."""
    controller = Controller(115200)
    controller.note_asked(7, 0)
    stamp_us = AHEAD_US + 1042
    assert controller.take(TimeAnswer(number=7, arrived_us=stamp_us, left_us=stamp_us), 2_865_000) is None
    return controller


@pytest.mark.parametrize("baud", [9600, 38400, 115200])
def test_a_board_that_is_quicker_than_its_baud_rate_is_believed(baud: int) -> None:
    """Itself the USB device: a millisecond there, one back, whatever the rate; its clock is known to half of both."""
    controller = Controller(baud)
    for n in range(5):
        stamp_us = (AHEAD_US + 500_000 * n + 1000) % 2**32
        controller.note_asked(n, 500 * MS * n)
        answer = TimeAnswer(number=n, arrived_us=stamp_us, left_us=stamp_us)
        assert controller.take(answer, (500 * n + 2) * MS) is None
    told = controller.take(said(2010, 0, 0), 2015 * MS)
    assert isinstance(told, Odometry)
    assert told.t_ns == pytest.approx(2010 * MS, abs=MS)


def said(t_ms: int, left: int, right: int, **flags: bool) -> OdometryMessage:
    clock_us = (AHEAD_US + 1000 * t_ms) % 2**32
    return OdometryMessage(clock_us=clock_us, left_100um=left, right_100um=right, yaw_100urad=None, **flags)


def test_odometry_comes_on_our_clock_and_does_not_wrap() -> None:
    """Both the clock and a total wrap between two messages: 2 and 3 mm of way, 100 ms apart."""
    controller = agreed()
    one = controller.take(said(10, 2**31 - 10, -5), 15 * MS)
    two = controller.take(said(110, -(2**31) + 10, 25), 120 * MS)
    assert isinstance(one, Odometry)
    assert isinstance(two, Odometry)
    assert (one.t_ns, two.t_ns) == (pytest.approx(10 * MS, abs=MS / 10), pytest.approx(110 * MS, abs=MS / 10))
    assert (one.totals, two.totals) == ((0.0, 0.0, None), (pytest.approx(0.002), pytest.approx(0.003), None))


def test_a_message_without_a_total_loses_no_way() -> None:
    """The next that has it goes on: 2 and 3 mm of way over three messages, of which the second tells a gyro alone."""
    controller = agreed()
    gyro = dataclasses.replace(said(20, 0, 0), left_100um=None, right_100um=None, yaw_100urad=70)
    told = [controller.take(message, 40 * MS) for message in (said(10, 0, 0), gyro, said(30, 20, 30))]
    ways = [of.totals[:2] for of in told if isinstance(of, Odometry)]
    assert ways == [(0.0, 0.0), (None, None), (pytest.approx(0.002), pytest.approx(0.003))]


def test_totals_that_begin_anew_leave_no_step() -> None:
    """The flag says so, for which the estimator begins anew, too."""
    controller = agreed()
    one, two = controller.take(said(10, 9000, 9000), 15 * MS), controller.take(said(30, 0, 0, restarted=True), 35 * MS)
    assert isinstance(one, Odometry)
    assert isinstance(two, Odometry)
    assert (two.restarted, two.left_m) == (True, one.left_m)


def test_what_cannot_be_used_is_counted() -> None:
    """Odometry before the clock is known, an answer to no question, an answer that comes twice."""
    fresh = Controller(115200)
    answer = TimeAnswer(number=7, arrived_us=0, left_us=0)
    told = [fresh.take(said(10, 0, 0), 15 * MS), fresh.take(answer, 15 * MS), agreed().take(answer, 15 * MS)]
    assert told == [UNKNOWN, UNASKED, UNASKED]
    assert all(isinstance(each, Rejected) for each in told)
