"""The queue for the line. Times are given, so every order is exact."""

from __future__ import annotations

import itertools
from collections import Counter
from dataclasses import replace

import numpy as np
import pytest

from ledpi.core.records import Decoded, Pose
from ledpi.wire import FixMessage, MarkerMessage, Message, Mode, NoFix, State, StateMessage, StatusMessage, TimeAsk
from ledpi.wire.outbox import STATUS_PERIOD_NS, Outbox
from tests.builders.wire import decoded, marker_pose, pose_at, robot_fix

MS = 1_000_000
FRAME_NS = 16 * MS
RUNNING = StatusMessage(state=State.RUNNING, no_fix=NoFix.NONE)


def outbox_with_status_sent(at_ns: int = 0) -> Outbox:
    """An outbox with 100 ms of patience whose next status is due one period after `at_ns`."""
    outbox = Outbox(max_age_ms=100.0)
    assert isinstance(outbox.take(at_ns), StatusMessage)
    return outbox


def frame(*marker_ids: int, at_ns: int, fix: bool = False, ambiguous: bool = False) -> Decoded:
    markers = (marker_pose(marker_id, at_ns, ambiguous=ambiguous) for marker_id in marker_ids)
    return decoded(*markers, robot=robot_fix(at_ns) if fix else None)


def label(message: Message | None) -> str | int | None:
    """`fix`, `status`, a marker's ID."""
    match message:
        case MarkerMessage():
            return message.id
        case FixMessage():
            return "fix"
        case StatusMessage():
            return "status"
    return None


def largest_gap(order: list[str | int | None]) -> int:
    """Steps from one status to the next, at most."""
    places = [place for place, sent in enumerate(order) if sent == "status"]
    return max(b - a for a, b in itertools.pairwise(places))


def test_the_fix_goes_first_then_the_status_then_the_markers() -> None:
    """Whatever the order in which they came."""
    outbox = Outbox(max_age_ms=100.0)
    outbox.put(frame(3, 7, at_ns=0, fix=True))
    assert [label(outbox.take(1 * MS)) for _ in range(5)] == ["fix", "status", 3, 7, None]


def test_the_state_and_the_question_for_the_clock_go_first() -> None:
    """The newest state, and none that is too old; what the port did not take is the next. A question each 0.5 s."""
    one, two = (StateMessage(mode=Mode.NONE, map_resets=n) for n in (1, 2))
    outbox = Outbox(max_age_ms=100.0, asks=True)
    outbox.put_state(one, 0)
    outbox.put_state(two, 0)
    outbox.put(frame(at_ns=0, fix=True))
    assert outbox.take(1 * MS) == two
    outbox.put_back()
    assert [outbox.take(1 * MS), outbox.take(1 * MS)] == [two, TimeAsk(number=1)]
    outbox.put_back()
    assert outbox.take(2 * MS) == TimeAsk(number=2)
    assert [label(outbox.take(3 * MS)) for _ in range(3)] == ["fix", "status", None]
    outbox.put_state(one, 3 * MS)
    assert label(outbox.take(104 * MS)) is None
    assert outbox.idle_ns(162 * MS) == 1 * MS  # to the status
    assert label(outbox.take(163 * MS)) == "status"
    assert outbox.take(502 * MS) == TimeAsk(number=3)


def test_states_take_every_second_packet_at_most() -> None:
    """A line that is too short even for them carries fixes, heartbeats and markers all the same."""
    outbox = Outbox(max_age_ms=100.0)
    sent: Counter[str] = Counter()
    for n in range(400):
        outbox.put_state(StateMessage(mode=Mode.NONE), n * 40 * MS)
        outbox.put(frame(7, at_ns=n * 40 * MS, fix=True))
        message = outbox.take(n * 40 * MS)
        assert message is not None
        sent[message.name] += 1
    assert sent["state"] == 200
    assert sent["fix"] > 100
    assert sent["status"] > 40


def test_a_status_that_is_due_waits_for_one_fix_at_most() -> None:
    """A line that carries fewer packets than there are fixes still carries a heartbeat."""
    outbox = outbox_with_status_sent()
    order = []
    for n in range(100):
        now_ns = n * 20 * MS  # room for one packet in 20 ms
        outbox.put(frame(7, at_ns=now_ns, fix=True))
        order.append(label(outbox.take(now_ns)))
    assert set(order) == {"fix", "status"}
    assert largest_gap(order) * 20 * MS <= STATUS_PERIOD_NS + 20 * MS


def test_a_newer_pose_replaces_one_that_waits() -> None:
    """The receiver gets the newest; the older ones are counted."""
    outbox = outbox_with_status_sent()
    for n in range(4):
        outbox.put(frame(7, at_ns=n * FRAME_NS, fix=True))
    now_ns = 3 * FRAME_NS + 5 * MS
    fix, _, marker = outbox.take(now_ns), outbox.take(now_ns), outbox.take(now_ns)
    assert isinstance(fix, FixMessage)
    assert isinstance(marker, MarkerMessage)
    assert fix.age_us == marker.age_us == 5000
    assert outbox.take(now_ns) is None
    assert outbox.replaced == 6


def test_on_a_short_line_every_marker_has_its_turn() -> None:
    """Three panels, room for one packet a frame: they take turns."""
    outbox = outbox_with_status_sent()
    order = []
    for n in range(9):
        outbox.put(frame(1, 2, 3, at_ns=n * MS))
        order.append(label(outbox.take(n * MS)))
    assert order == [1, 2, 3] * 3


def test_a_pose_that_has_become_too_old_is_not_sent() -> None:
    """100 ms is the limit, and just below 100 ms is sent."""
    outbox = outbox_with_status_sent()
    outbox.put(frame(7, at_ns=0, fix=True))
    outbox.put(frame(8, at_ns=2 * MS))
    assert label(outbox.take(101 * MS)) == 8
    assert outbox.take(101 * MS) is None
    assert outbox.stale == 2


def test_a_pose_that_is_put_back_is_the_next_with_its_new_age() -> None:
    """A fix, and then a marker, ahead of those that have waited behind it."""
    outbox = outbox_with_status_sent()
    outbox.put(frame(3, 7, at_ns=0, fix=True))
    assert label(outbox.take(1 * MS)) == "fix"
    outbox.put_back()
    again = outbox.take(5 * MS)
    assert isinstance(again, FixMessage)
    assert again.age_us == 5000
    assert [label(outbox.take(6 * MS)) for _ in range(2)] == ["status", 3]
    outbox.put_back()
    assert [label(outbox.take(7 * MS)) for _ in range(3)] == [3, 7, None]
    assert outbox.replaced == 0


def test_a_pose_that_is_put_back_does_not_hide_a_newer_one() -> None:
    """Nor does an alternate come back of which the newer frame knows nothing."""
    outbox = outbox_with_status_sent()
    outbox.put(frame(7, at_ns=0, fix=True, ambiguous=True))
    assert [label(outbox.take(MS)) for _ in range(4)] == ["fix", "status", 7, 7]
    outbox.put(frame(7, at_ns=FRAME_NS, fix=True))
    outbox.put_back()
    fix, marker = outbox.take(FRAME_NS + MS), outbox.take(FRAME_NS + MS)
    assert isinstance(fix, FixMessage)
    assert isinstance(marker, MarkerMessage)
    assert (fix.age_us, marker.age_us, marker.alternate) == (1000, 1000, False)
    assert outbox.take(FRAME_NS + MS) is None


def test_a_fix_that_was_put_back_is_none_that_was_sent() -> None:
    """The status claims what the receiver has, and nothing else."""
    outbox = outbox_with_status_sent()
    outbox.set_status(RUNNING)
    outbox.put(frame(at_ns=0, fix=True))
    assert label(outbox.take(MS)) == "fix"
    outbox.put_back()
    outbox.clear()
    status = outbox.take(2 * MS)
    assert isinstance(status, StatusMessage)
    assert status.no_fix is NoFix.STALE


def test_a_message_is_true_for_a_millisecond_and_until_it_is_too_old() -> None:
    """A status has no age, and a state with the controller's time says its own."""
    outbox = outbox_with_status_sent()
    state = StateMessage(mode=Mode.NONE, t_ns=3 * MS)
    assert outbox.latest_ns(state, 5 * MS) == 103 * MS
    assert outbox.latest_ns(replace(state, clock_us=1), 5 * MS) is None
    outbox.put(frame(7, at_ns=0))
    young = outbox.take(5 * MS)
    outbox.put_back()
    old = outbox.take(99 * MS + 500_000)
    assert young is not None
    assert old is not None
    assert outbox.latest_ns(young, 5 * MS) == 6 * MS
    assert outbox.latest_ns(old, 99 * MS + 500_000) == 100 * MS
    assert outbox.latest_ns(RUNNING, 0) is None


def test_the_age_is_measured_on_the_hosts_clock() -> None:
    """The camera's clock runs 7 s behind; mid-exposure is at 1 ms of it."""
    outbox = Outbox(max_age_ms=100.0)
    outbox.put(decoded(robot=robot_fix(1 * MS), host_offset_ns=7000 * MS))
    fix = outbox.take(7013 * MS)
    assert isinstance(fix, FixMessage)
    assert fix.age_us == 12_000


def test_a_pose_from_the_future_is_refused() -> None:
    """The clocks disagree, so its age is not known, so it is not sent."""
    outbox = outbox_with_status_sent()
    outbox.put(frame(7, at_ns=10 * MS, fix=True))
    assert outbox.take(9 * MS) is None
    assert outbox.refused == 2


@pytest.mark.parametrize("x", [900.0, np.nan, np.inf])
def test_a_pose_that_does_not_fit_is_refused_and_the_next_one_is_sent(x: float) -> None:
    """Counted, not raised: one bad pose must not stop the stream."""
    outbox = outbox_with_status_sent()
    bad: Pose = pose_at(x)
    outbox.put(decoded(marker_pose(7, 0, pose=bad), marker_pose(8, 0)))
    assert label(outbox.take(1 * MS)) == 8
    assert outbox.refused == 1


def test_an_ambiguous_marker_is_sent_with_its_alternate() -> None:
    """Two packets, the likelier pose first; until a newer frame excludes it."""
    outbox = outbox_with_status_sent()
    outbox.put(frame(7, at_ns=0, ambiguous=True))
    sent = [outbox.take(1 * MS) for _ in range(2)]
    assert [isinstance(one, MarkerMessage) and (one.ambiguous, one.alternate) for one in sent] == [
        (True, False),
        (True, True),
    ]
    outbox.put(frame(7, at_ns=1 * MS, ambiguous=True))
    outbox.put(frame(7, at_ns=2 * MS))
    only = outbox.take(3 * MS)
    assert isinstance(only, MarkerMessage)
    assert not only.ambiguous
    assert outbox.take(3 * MS) is None


def test_the_status_comes_every_period_and_says_what_was_set() -> None:
    """Starting, until something is set."""
    outbox = Outbox(max_age_ms=100.0)
    first = outbox.take(0)
    assert isinstance(first, StatusMessage)
    assert (first.state, first.no_fix) == (State.STARTING, NoFix.NOT_RUNNING)
    outbox.set_status(replace(first, frames=60))
    assert outbox.idle_ns(10 * MS) == STATUS_PERIOD_NS - 10 * MS
    assert outbox.take(STATUS_PERIOD_NS - 1) is None
    second = outbox.take(STATUS_PERIOD_NS)
    assert second == replace(first, frames=60)


def test_a_new_reason_is_said_at_once() -> None:
    """The camera is lost: the controller is not left to wait for the next heartbeat. New counts alone can wait."""
    outbox = outbox_with_status_sent()
    outbox.set_status(replace(RUNNING, no_fix=NoFix.NO_MAP))
    assert label(outbox.take(1 * MS)) == "status"
    outbox.set_status(replace(RUNNING, no_fix=NoFix.NO_MAP, frames=1))
    assert outbox.take(2 * MS) is None
    outbox.set_status(replace(RUNNING, state=State.CAMERA_LOST, no_fix=NoFix.NO_FRAMES, frames=1))
    said = outbox.take(3 * MS)
    assert isinstance(said, StatusMessage)
    assert (said.state, said.no_fix) == (State.CAMERA_LOST, NoFix.NO_FRAMES)


def test_a_status_follows_the_first_fix() -> None:
    """A receiver that heard "no panel" hears right after the fix that there is one; later fixes bring no status."""
    outbox = outbox_with_status_sent()
    outbox.set_status(replace(RUNNING, no_fix=NoFix.NO_PANEL))
    assert label(outbox.take(1 * MS)) == "status"
    outbox.put(frame(at_ns=0, fix=True))
    fix, status = outbox.take(20 * MS), outbox.take(24 * MS)
    assert isinstance(fix, FixMessage)
    assert isinstance(status, StatusMessage)
    assert status.no_fix is NoFix.NONE
    outbox.put(frame(at_ns=16 * MS, fix=True))
    assert [label(outbox.take(36 * MS)) for _ in range(2)] == ["fix", None]


def test_a_fix_that_was_refused_is_not_claimed() -> None:
    """It does not fit a packet: what was set stays said."""
    outbox = outbox_with_status_sent()
    bad = replace(robot_fix(0), map_from_base_link=pose_at(900.0))
    outbox.put(decoded(robot=bad))
    outbox.set_status(RUNNING)
    status = outbox.take(1 * MS)
    assert isinstance(status, StatusMessage)
    assert status.no_fix is NoFix.STALE


def test_a_lost_camera_is_said_in_spite_of_a_young_fix() -> None:
    """There will be no other."""
    outbox = outbox_with_status_sent()
    outbox.put(frame(at_ns=0, fix=True))
    assert [label(outbox.take(1 * MS)) for _ in range(2)] == ["fix", "status"]
    outbox.set_status(replace(RUNNING, state=State.CAMERA_LOST, no_fix=NoFix.NO_FRAMES))
    status = outbox.take(2 * MS)
    assert isinstance(status, StatusMessage)
    assert status.no_fix is NoFix.NO_FRAMES


def test_a_status_that_is_nearly_due_follows_a_pose() -> None:
    """At 60 fps it never goes alone, when it could be on the line as the next frame's poses get ready."""
    outbox = outbox_with_status_sent()
    followed_by = []
    for n in range(1, 60):
        now_ns = n * FRAME_NS
        assert outbox.idle_ns(now_ns - 1) > 0
        outbox.put(frame(7, at_ns=now_ns))
        sent = [label(outbox.take(now_ns + i * 4 * MS)) for i in range(2)]
        assert sent[0] == 7
        followed_by.append(sent[1])
    assert set(followed_by) == {None, "status"}
    assert largest_gap(followed_by) * FRAME_NS <= STATUS_PERIOD_NS


def test_a_status_never_claims_a_fix_that_is_gone() -> None:
    """The daemon said "there is a fix" and then fell silent: after max_age_ms the heartbeat says stale."""
    outbox = Outbox(max_age_ms=100.0)
    outbox.set_status(RUNNING)
    outbox.put(frame(at_ns=0, fix=True))
    assert label(outbox.take(0)) == "fix"
    fresh, later = outbox.take(0), outbox.take(STATUS_PERIOD_NS)
    assert isinstance(fresh, StatusMessage)
    assert isinstance(later, StatusMessage)
    assert (fresh.no_fix, later.no_fix) == (NoFix.NONE, NoFix.STALE)


def test_a_status_counts_the_poses_that_never_went_out() -> None:
    """One replaced, one too old."""
    outbox = Outbox(max_age_ms=100.0)
    outbox.put(frame(7, at_ns=0, fix=True))
    outbox.put(frame(at_ns=90 * MS, fix=True))
    assert label(outbox.take(150 * MS)) == "fix"
    assert label(outbox.take(150 * MS)) == "status"
    assert outbox.take(150 * MS) is None
    status = outbox.take(400 * MS)
    assert isinstance(status, StatusMessage)
    assert status.packets_dropped == 2


def test_clearing_forgets_all_poses_and_makes_a_status_due() -> None:
    """A port that is back gets a heartbeat first, and nothing that waited for it."""
    outbox = outbox_with_status_sent()
    outbox.put(frame(3, 7, at_ns=0, fix=True))
    outbox.clear()
    assert [label(outbox.take(1 * MS)) for _ in range(2)] == ["status", None]
    assert outbox.replaced == 3
