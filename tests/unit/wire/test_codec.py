"""Messages and their bytes: what is kept, what is rounded, what stops at its limit and what is refused."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from ledpi.core.errors import WireError
from ledpi.core.records import MarkerPose
from ledpi.wire import FixMessage, MarkerMessage, Message, NoFix, State, StatusMessage, WirePose
from ledpi.wire.codec import decode, encode, number_after
from ledpi.wire.message import marker_message
from tests.builders.wire import marker_pose, pose_at

STEP = 1e-4  # m or rad
NOTHING_KNOWN = StatusMessage(state=State.UNKNOWN, no_fix=NoFix.UNKNOWN)


def triples(elements: st.SearchStrategy[float]) -> st.SearchStrategy[tuple[float, float, float]]:
    return st.tuples(elements, elements, elements)


@st.composite
def unit_quaternions(draw: st.DrawFn) -> tuple[float, ...]:
    parts = draw(st.tuples(*[st.floats(-1, 1)] * 4).filter(lambda q: math.hypot(*q) > 1e-3))
    return tuple(v / math.hypot(*parts) for v in parts)


deviations = st.none() | triples(st.floats(0, 49.152))
poses = st.builds(
    WirePose,
    position_m=triples(st.floats(-838.8607, 838.8607)),
    quaternion_wxyz=unit_quaternions(),
    deviation_m=deviations,
    deviation_rad=deviations,
)
ages = st.integers(0, 0xFFFFFFFF)
markers = st.booleans().flatmap(
    lambda ambiguous: st.builds(
        MarkerMessage,
        id=st.integers(0, 65535),
        age_us=ages,
        pose=poses,
        ambiguous=st.just(ambiguous),
        alternate=st.booleans() if ambiguous else st.just(False),
    )
)
fixes = st.builds(FixMessage, age_us=ages, pose=poses, panels_used=st.integers(0, 255), map_resets=st.integers(0, 255))


def sent(message: Message) -> Message:
    """Returns what the other end reads."""
    return decode(encode(message, 1)[:-1])[1]


def assert_pose_kept(after: WirePose | None, before: WirePose | None) -> None:
    assert after is not None
    assert before is not None
    assert after.position_m == pytest.approx(before.position_m, abs=STEP / 2 + 1e-9)
    dot = sum(a * b for a, b in zip(after.quaternion_wxyz, before.quaternion_wxyz, strict=True))
    assert abs(dot) > 1 - 1e-8  # the same rotation to about 0.2 mrad, whichever sign
    for got, true in ((after.deviation_m, before.deviation_m), (after.deviation_rad, before.deviation_rad)):
        assert (got is None) == (true is None)
        for a, b in zip(got or (), true or (), strict=True):
            assert b - 1e-9 <= a <= b * 17 / 16 + STEP


@pytest.mark.slow
@given(markers | fixes)
def test_a_pose_survives_within_its_resolution(message: MarkerMessage | FixMessage) -> None:
    """Every valid pose, wherever it is and however sure; all other fields exactly."""
    after = sent(message)
    assert isinstance(after, MarkerMessage | FixMessage)
    assert_pose_kept(after.pose, message.pose)
    assert message.pose is not None
    assert replace(after, pose=message.pose) == message


A_POSE = WirePose(
    position_m=(1.0, 2.0, 3.0), quaternion_wxyz=(1.0, 0.0, 0.0, 0.0), deviation_m=None, deviation_rad=None
)


@pytest.mark.parametrize(
    "wrong",
    [
        {"position_m": (838.8608, 0.0, 0.0)},
        {"position_m": (0.0, -838.8608, math.nan)},
        {"quaternion_wxyz": (0.0, 0.0, 0.0, 0.0)},
        {"quaternion_wxyz": (1.0, 0.1, 0.0, 0.0)},
        {"deviation_m": (0.1, -0.1, 0.1)},
        {"deviation_rad": (math.nan, 0.1, 0.1)},
    ],
    ids=str,
)
def test_a_pose_that_cannot_be_told_truly_cannot_be_built(wrong: dict[str, tuple[float, ...]]) -> None:
    """Refused where it is made, so that it is never wrapped or clipped on the wire."""
    with pytest.raises(WireError):
        replace(A_POSE, **wrong)  # type: ignore[arg-type]


def test_the_two_quaternions_of_a_rotation_are_one_on_the_wire() -> None:
    """q and −q are the same rotation; the one with w ≥ 0 is sent, so that the bytes do not jump."""
    q, minus_q = (0.6, 0.0, -0.8, 0.0), (-0.6, 0.0, 0.8, 0.0)
    one, other = (
        encode(FixMessage(age_us=0, pose=replace(A_POSE, quaternion_wxyz=turn), panels_used=1), 0)
        for turn in (q, minus_q)
    )
    assert one == other
    fix = decode(other[:-1])[1]
    assert isinstance(fix, FixMessage)
    assert fix.pose.quaternion_wxyz == pytest.approx(q, abs=1 / 32767)


@pytest.mark.parametrize(
    ("build", "says"),
    [
        (lambda: FixMessage(age_us=-1, pose=A_POSE, panels_used=1), "age_us must be 0 or more, not -1"),  # two clocks
        (lambda: MarkerMessage(id=65536, age_us=0, pose=A_POSE), "id must be 0 to 65535, not 65536"),  # would wrap
        (lambda: MarkerMessage(id=1, age_us=0, pose=A_POSE, uncalibrated=True), None),  # no intrinsics, no pose
        (lambda: MarkerMessage(id=1, age_us=0, pose=A_POSE, alternate=True), None),  # no ambiguity, no alternate
    ],
)
def test_a_message_that_contradicts_itself_is_refused(build: Callable[[], Message], says: str | None) -> None:
    """Refuses it where it is made: its age, its ID, its flags."""
    with pytest.raises(WireError, match=says):
        build()


def test_what_only_grows_stops_at_its_limit() -> None:
    """Ages, counts, temperatures and deviations: the largest value that is not "unknown"."""
    hot = replace(
        NOTHING_KNOWN,
        panels_in_view=1000,
        temperature_c=300,
        uptime_s=2**40,
        frames=2**32 - 1,
        decode_p50_us=65535,
        decode_p99_us=10**6,
    )
    after = sent(hot)
    assert isinstance(after, StatusMessage)
    assert (after.panels_in_view, after.temperature_c) == (254, 127)
    assert (after.uptime_s, after.frames) == (2**32 - 2, 2**32 - 2)
    assert (after.decode_p50_us, after.decode_p99_us) == (65534, 65534)
    assert sent(replace(hot, temperature_c=-300)) == replace(after, temperature_c=-127)

    pose = replace(A_POSE, deviation_m=(49.153, 1e6, 0.0), deviation_rad=(1e300, 0.0, 0.0))
    fix = sent(FixMessage(age_us=2**40, pose=pose, panels_used=300))
    assert isinstance(fix, FixMessage)
    assert (fix.age_us, fix.panels_used) == (2**32 - 1, 255)
    assert fix.pose.deviation_m == (49.152, 49.152, 0.0)
    assert fix.pose.deviation_rad == (49.152, 0.0, 0.0)


@pytest.mark.parametrize(
    ("deviation", "on_the_wire"),
    [(0.0, 0.0), (1e-9, 0.0001), (0.0031, 0.0031), (0.00311, 0.0032), (0.0033, 0.0034), (0.0063, 0.0064)],
)
def test_a_deviation_is_rounded_up_to_the_next_step(deviation: float, on_the_wire: float) -> None:
    """Steps of 0.1 mm to 3.1 mm, of 0.2 mm to 6.2 mm, then 6.4 mm: by hand from the page's rule."""
    fix = sent(FixMessage(age_us=0, pose=replace(A_POSE, deviation_m=(deviation, 0.0, 0.0)), panels_used=1))
    assert isinstance(fix, FixMessage)
    assert fix.pose.deviation_m == (on_the_wire, 0.0, 0.0)


def test_states_of_a_newer_sender_read_as_unknown() -> None:
    """A new reason for "no fix" must not look like a broken line, and never like a fix."""
    assert (State(77), NoFix(77)) == (State.UNKNOWN, NoFix.UNKNOWN)


def test_the_numbers_go_from_65535_to_1() -> None:
    """0 would tell the receiver that the sender began anew."""
    assert [number_after(number) for number in (0, 65534, 65535)] == [1, 65535, 1]


def test_a_marker_pose_becomes_a_message_with_its_deviations() -> None:
    """Square roots of the covariance's diagonal; unknown without a covariance."""
    covariance = np.diag([0.0004, 0.0009, 0.0016, 0.01, 0.04, 0.09])
    message = marker_message(marker_pose(7, 0, pose=pose_at(0.5, covariance)), age_us=12)
    assert (message.id, message.age_us, message.ambiguous) == (7, 12, False)
    assert message.pose is not None
    assert message.pose.position_m == (0.5, 0.0, 1.0)
    assert message.pose.deviation_m == pytest.approx((0.02, 0.03, 0.04))
    assert message.pose.deviation_rad == pytest.approx((0.1, 0.2, 0.3))
    bare = marker_message(marker_pose(7, 0), age_us=0).pose
    assert bare is not None
    assert bare.deviation_m is bare.deviation_rad is None


def test_a_variance_that_is_none_leaves_the_deviations_unknown() -> None:
    """A degenerate solution: better no deviation than a wrong one. The other triple stands."""
    covariance = np.diag([0.01, np.nan, 0.01, 0.04, 0.04, 0.04])
    pose = marker_message(marker_pose(7, 0, pose=pose_at(0.5, covariance)), age_us=0).pose
    assert pose is not None
    assert pose.deviation_m is None
    assert pose.deviation_rad == pytest.approx((0.2, 0.2, 0.2))


def test_a_marker_without_a_solution_is_uncalibrated() -> None:
    """An ID, and no pose."""
    whole = marker_pose(7, 0)
    bare = MarkerPose(detection=whole.detection, mid_exposure_ns=0, solution=None, alternate=None)
    message = marker_message(bare, age_us=0)
    assert message.uncalibrated
    assert message.pose is None


def test_an_ambiguous_marker_has_two_messages() -> None:
    """Both say that they are ambiguous; one says that it is the alternate."""
    marker = marker_pose(7, 0, ambiguous=True)
    likelier, other = (marker_message(marker, age_us=0, alternate=alternate) for alternate in (False, True))
    assert (likelier.ambiguous, likelier.alternate) == (True, False)
    assert (other.ambiguous, other.alternate) == (True, True)
    assert other.pose is not None
    assert other.pose.position_m == (-1.0, 0.0, 1.0)
