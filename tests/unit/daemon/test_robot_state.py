"""The ear of the daemon's state: whatever a controller sends, nothing breaks, and what is not used is counted."""

from __future__ import annotations

import random
import threading
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from ledpi.config.settings import load_config
from ledpi.core.geometry import transform
from ledpi.core.records import Rejected
from ledpi.daemon.robot_state import Now, RobotState
from ledpi.pose.fix import Robot
from ledpi.wire import Mode, OdometryMessage, StatusMessage, TimeAnswer
from ledpi.wire.codec import encode
from ledpi.wire.message import NoFix, State
from tests.builders.state import SEAT, room
from tests.builders.waiting import limit_s, wait_until
from tests.builders.wire import controller_vectors, decoded, marker_pose, pose_at

CONFIG = load_config(None, ("panels.side_m=0.16", "odometry.source=serial", "serial.port=/dev/null"))


def odometry(clock_us: int, way_100um: int) -> bytes:
    said = OdometryMessage(clock_us=clock_us, left_100um=way_100um, right_100um=way_100um, yaw_100urad=0)
    return encode(said, 1)


@contextmanager
def running(state: RobotState) -> Iterator[None]:
    thread = threading.Thread(target=state.run, daemon=True)
    thread.start()
    yield
    state.stop()
    thread.join(limit_s())
    assert not thread.is_alive()


def test_what_a_controller_sends_wrong_is_counted_and_nothing_else() -> None:
    """Noise, echoes, odometry without a clock, a clock that jumps, totals that leap; meanwhile it says: no state."""
    rejected, told = Counter[str](), list[Now]()

    def reject(why: Rejected) -> None:
        rejected[why.key] += 1

    state = RobotState(CONFIG, Robot(base_link_from_camera=SEAT, panels=room()), 7, told.append, reject)
    state.opened()
    state.heard(b"\0" + odometry(10_000, 0), 20_000_000)  # before it has answered
    flipped = bytearray(controller_vectors()[0].frame)
    flipped[9] ^= 1
    echo = encode(StatusMessage(state=State.RUNNING, no_fix=NoFix.NONE), 2)
    state.heard(bytes(flipped) + echo, 30_000_000)
    state.asked(1, 40_000_000)
    state.heard(encode(TimeAnswer(number=1, arrived_us=41_042, left_us=41_042), 3), 42_900_000)
    for n in range(5):
        state.heard(odometry(60_000 + 20_000 * n, 0 if n < 3 else 90_000), (62 + 20 * n) * 1_000_000)  # by 9 m at once
    state.heard(odometry(9_000_000, 90_000), 170_000_000)
    state.heard(random.Random(5).randbytes(20_000), 180_000_000)
    with running(state):
        wait_until(lambda: len(told) > 2)
    damaged = rejected.pop("line.damaged")
    assert damaged > 20
    assert rejected == {"clock.unknown": 1, "line.unknown": 1, "state.odometry_leap": 1, "clock.jumped": 1}
    assert {now.message.mode for now in told} == {Mode.NONE}
    assert {now.message.map_resets for now in told} == {7}


def test_of_a_controller_that_floods_no_more_is_taken_than_is_of_use() -> None:
    """A thousand messages a second: one in 5 ms. One that says what the next one cannot is taken in any case."""
    rejected = Counter[str]()
    robot = Robot(base_link_from_camera=SEAT, panels=room())
    state = RobotState(CONFIG, robot, 0, lambda now: None, lambda why: rejected.update([why.key]))
    stream = b"".join(odometry(1000 * n - 500_000 & 0xFFFFFFFF, n) for n in range(1000))  # its clock wraps
    slipped = OdometryMessage(clock_us=499_500, left_100um=0, right_100um=0, yaw_100urad=0, slipping=True)
    state.heard(b"\0" + stream + encode(slipped, 1), 20_000_000)
    assert rejected == {"state.too_often": 800}


def test_a_failure_of_the_estimator_begins_it_anew(caplog: pytest.LogCaptureFixture) -> None:
    """A look whose numbers overflow, twice, and a listener that fails: all are counted, the journal has the first.

    Then a panel gives a state.
    """
    rejected, told = Counter[str](), list[Now]()

    def reject(why: Rejected) -> None:
        rejected[why.key] += 1

    def see(variance: float) -> None:
        pose = pose_at(0.1, variance * np.eye(6))
        state.see(decoded(marker_pose(3, time.monotonic_ns() - 1_000_000, pose=pose)))

    def tell(now: Now) -> None:
        told.append(now)
        if len(told) == 1:
            raise ValueError("a listener")

    state = RobotState(CONFIG, Robot(base_link_from_camera=SEAT, panels=room()), 0, tell, reject)
    with running(state):
        see(1e308)
        see(1e308)
        wait_until(lambda: rejected["state.failed"] == 3)
        see(1e-5)
        wait_until(lambda: told[-1].message.mode is Mode.PANELS)
    assert [record.getMessage().split()[0] for record in caplog.records] == ["state_failed"]


def test_a_place_that_fits_no_packet_is_told_as_none() -> None:
    """A kilometre from the map's origin: it is counted, and the line is not silent."""
    far = {i: replace(panel, map_from_marker=transform(np.eye(3), np.array([1000.0, 0, 0])) @ panel.map_from_marker)
           for i, panel in room().items()}  # fmt: skip
    rejected, told = Counter[str](), list[Now]()
    state = RobotState(
        CONFIG, Robot(base_link_from_camera=SEAT, panels=far), 0, told.append, lambda why: rejected.update([why.key])
    )
    with running(state):
        state.see(decoded(marker_pose(3, time.monotonic_ns() - 1_000_000, pose=pose_at(0.1, 1e-5 * np.eye(6)))))
        wait_until(lambda: rejected["state.out_of_range"] > 2)
        before = len(told)
        wait_until(lambda: len(told) > before + 2)
    assert {now.message.mode for now in told} == {Mode.NONE}
