"""A frame's bytes: lines with ages, and packets that the wire's own receiver reads."""

from __future__ import annotations

import json
import time
from typing import Literal

from ledpi.bridge.payload import Payload, payload_of
from ledpi.config.outputs import OutputSettings
from ledpi.wire import FixMessage, MarkerMessage, Receiver, StatusMessage
from ledpi.wire.message import State
from tests.builders.made_up_daemon import HEALTH, PANEL, decoded

COVARIANCE = [4e-6 if row == column else 0.0 for row in range(6) for column in range(6)]
PLACE = {"position_m": [1.0, 2.0, 0.5], "quaternion_wxyz": [1.0, 0.0, 0.0, 0.0]}


def payload(form: Literal["json", "wire"]) -> Payload:
    return payload_of(OutputSettings(kind="stdout", format=form))


def test_a_line_tells_its_age_and_its_unix_time() -> None:
    """30 ms after the exposure."""
    frame = decoded(3)
    line = json.loads(*payload("json").frame(frame, frame["exposed_ns"] + 30_000_000))
    assert (line["seq"], line["age_us"]) == (3, 30_000)
    assert abs(time.time_ns() - line["unix_ns"] - 30_000_000) < 2_000_000_000


def test_where_the_robot_is_between_frames_is_a_line_with_its_age() -> None:
    """20 ms after it held. Packets have no place for it."""
    state = {"type": "robot_state", "t_ns": 5_000_000_000, "position_m": [1.0, 2.0]}
    line = json.loads(*payload("json").robot(state, 5_020_000_000))
    assert (line["type"], line["position_m"], line["age_us"]) == ("robot_state", [1.0, 2.0], 20_000)
    assert payload("wire").robot(state, 5_020_000_000) == []


def test_packets_hold_the_fix_first_then_markers_each_with_its_own_age() -> None:
    """And the mirror pose, where it is not excluded."""
    frame = decoded(3)
    at_ns = frame["exposed_ns"]
    marker = PANEL | {"exposed_ns": at_ns - 2_000_000, "covariance": COVARIANCE, "alternate": PLACE}
    robot = PLACE | {"exposed_ns": at_ns - 1_000_000, "covariance": COVARIANCE, "panels_used": [7]}
    packets = payload("wire")
    messages = Receiver().feed(*packets.frame(frame | {"markers": [marker], "robot": robot}, at_ns + 10_000_000))
    fix, first, other = messages
    assert isinstance(fix, FixMessage)
    assert (fix.age_us, fix.panels_used, fix.pose.position_m) == (11_000, 1, (1.0, 2.0, 0.5))
    assert isinstance(first, MarkerMessage)
    assert (first.id, first.age_us, first.ambiguous, first.alternate) == (7, 12_000, True, False)
    assert isinstance(other, MarkerMessage)
    assert other.alternate


def test_a_pose_that_fits_no_packet_is_left_out_and_the_others_are_sent() -> None:
    """As on the serial line."""
    frame = decoded(3)
    at_ns = frame["exposed_ns"]
    far = PLACE | {"position_m": [2000.0, 0.0, 0.0], "exposed_ns": at_ns, "panels_used": []}
    markers = [PANEL | far | {"id": 9}, *frame["markers"]]
    (message,) = Receiver().feed(*payload("wire").frame(frame | {"robot": far, "markers": markers}, at_ns))
    assert isinstance(message, MarkerMessage)
    assert message.id == 7


def test_the_daemons_state_is_a_status_packet() -> None:
    """One that has ended says stopping."""
    packets = payload("wire")
    (running,) = Receiver().feed(packets.state("running", HEALTH | {"temperature_c": 50}))
    (gone,) = Receiver().feed(packets.state("no_daemon", None))
    assert isinstance(running, StatusMessage)
    assert isinstance(gone, StatusMessage)
    assert (running.state, gone.state) == (State.RUNNING, State.STOPPING)
