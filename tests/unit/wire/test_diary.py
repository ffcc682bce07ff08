"""A recording's controller.jsonl: what the state was made of gives the same state again, to the bit."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from ledpi.config.robot import OdometrySettings
from ledpi.core.errors import RecordingError
from ledpi.pose.fix import Robot
from ledpi.state.estimator import State
from ledpi.state.inputs import Odometry
from ledpi.wire import OdometryMessage, TimeAnswer
from ledpi.wire.diary import DIARY_FILE, Entry, Frame, Look, Replay, line_of, read_diary, seen
from ledpi.wire.keeper import Asked, Heard, Keeper, Told
from tests.builders.state import SEAT, room
from tests.builders.wire import marker_pose, pose_at

MS = 1_000_000
OFFSET_NS = 123_456_789  # of the camera's clock


def keeper() -> Keeper:
    robot = Robot(base_link_from_camera=SEAT, panels=room())
    return Keeper(robot, OdometrySettings(), 115200)


def drive() -> list[Entry]:
    """Two answers, odometry of the controller and of a program, panel 3 in each second frame, and states told."""
    entries: list[Entry] = []
    for n in range(60):
        now_ns = OFFSET_NS + 20 * n * MS
        if n % 25 == 0:
            entries.append(Asked(n, now_ns - 5 * MS))
            entries.append(Heard(TimeAnswer(number=n, arrived_us=20_000 * n, left_us=20_000 * n + 7), now_ns + 3 * MS))
        said = OdometryMessage(clock_us=20_000 * n, left_100um=7 * n, right_100um=8 * n, yaw_100urad=n)
        entries.append(Heard(said, now_ns + 4 * MS))
        if n > 40:
            entries.append(Told(Odometry(t_ns=now_ns + MS, left_m=n / 3, right_m=n / 7, yaw_rad=0.1), now_ns + 5 * MS))
        entries += [Frame(n, now_ns + 6 * MS, OFFSET_NS)] if n % 2 else []
        entries.append(Look(now_ns + 8 * MS))
    return entries


def test_the_same_again_is_the_same_to_the_bit(tmp_path: Path) -> None:
    """Through the file, whose numbers are as exact as those in memory."""
    (tmp_path / DIARY_FILE).write_text("".join(line_of(entry) + "\n" for entry in drive()))
    diary = read_diary(tmp_path)
    assert diary == drive()
    pose = pose_at(0.1, np.diag([1e-5, 1e-5, 1e-4, 1e-4, 1e-4, 1e-4]))
    frames = {n: (marker_pose(3, 20 * n * MS - 30 * MS, pose=pose),) for n in range(60)}
    live, first = keeper(), {}
    for entry in diary:
        if isinstance(entry, Look):
            first[entry.t_ns] = live.at(entry.t_ns)
        elif isinstance(entry, Frame):
            live.take(seen(frames[entry.seq], OFFSET_NS, entry.now_ns))
        else:
            live.take(entry)
    replay = Replay(keeper(), diary)
    again = dict(told for seq, markers in frames.items() for told in replay.take(seq, markers))
    whole = {t_ns: state for t_ns, state in again.items() if isinstance(state, State)}
    assert len(whole) > 40
    assert whole[max(whole)].by_odometry
    for t_ns, state in whole.items():
        before = first[t_ns]
        assert isinstance(before, State)
        assert state.pose.tobytes() == before.pose.tobytes()
        assert state.covariance.tobytes() == before.covariance.tobytes()


@pytest.mark.parametrize(
    "line",
    [
        {"heard_ns": 1, "message": "status"},
        {"heard_ns": 1, "message": "time_answer", "number": 70000, "arrived_us": 0, "left_us": 0},
        {"told_ns": 1, "t_ns": 2.5},
        {"told_ns": 1, "t_ns": 2, "left_m": "3"},
        {"state": 1},
    ],
    ids=json.dumps,
)
def test_a_broken_line_is_named(tmp_path: Path, line: dict[str, object]) -> None:
    """With file and number."""
    (tmp_path / DIARY_FILE).write_text(line_of(Look(5)) + "\n" + json.dumps(line) + "\n")
    with pytest.raises(RecordingError, match=rf"{DIARY_FILE}: line 2: .*is no line of this file"):
        read_diary(tmp_path)
