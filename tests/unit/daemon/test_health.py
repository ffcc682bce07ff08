"""Health: counters since the start, and how long the recent frames took."""

from __future__ import annotations

import threading

import pytest

from ledpi.core.records import Decoded, MarkerPose, Rejected
from ledpi.daemon.health import RECENT, Health, Totals
from ledpi.daemon.ring import RingCounters
from tests.builders.wire import marker_pose, publisher_counters

NO_BANDS = Rejected(stage="identify", reason="no_bands")
TRUNCATED = Rejected(stage="capture", reason="truncated")


def frame(
    *, find_ms: float = 1.0, soft_ms: float = 0.0, markers: tuple[MarkerPose, ...] = (), rejected: int = 0, seq: int = 0
) -> Decoded:
    return Decoded(
        seq=seq,
        row0_readout_ns=1000 + seq,
        host_offset_ns=50,
        markers=markers,
        robot=None,
        rejected=(NO_BANDS,) * rejected,
        stage_ms={"find": find_ms, "identify": soft_ms},
    )


def seen(count: int) -> tuple[MarkerPose, ...]:
    return tuple(marker_pose(marker_id, 0) for marker_id in range(count))


def totals(health: Health) -> Totals:
    health.refresh()
    return health.totals(RingCounters(published=0, taken=0, dropped=0), publisher_counters())


def test_at_first_there_is_nothing() -> None:
    """No times are invented for frames that have not come."""
    snapshot = totals(Health())
    assert (snapshot.decoded, snapshot.markers, snapshot.in_view, snapshot.rejected) == (0, 0, 0, {})
    assert snapshot.times_ms == {}


def test_frames_and_markers_are_counted() -> None:
    """In all; and in view is what the newest frame shows."""
    health = Health()
    for count in (2, 3, 1):
        health.add(frame(markers=seen(count)))
    snapshot = totals(health)
    assert (snapshot.decoded, snapshot.markers, snapshot.in_view) == (3, 6, 1)


def test_rejections_are_counted_by_stage_and_reason() -> None:
    """Those of the decoder, and those before it."""
    health = Health()
    health.add(frame(rejected=2))
    health.reject(TRUNCATED)
    health.add(frame(rejected=1))
    health.reject(TRUNCATED)
    assert totals(health).rejected == {"identify.no_bands": 3, "capture.truncated": 2}
    assert totals(health).decoded == 2


def test_times_are_the_median_and_the_slowest_in_a_hundred() -> None:
    """Takes 201 frames of 1 to 201 ms, in whatever order: 101 is in the middle, and 2 are longer than 199."""
    health = Health()
    for number in range(201):
        health.add(frame(find_ms=1.0 + number * 100 % 201, soft_ms=0.0))
    assert totals(health).times_ms["decode"] == (101, pytest.approx(199.5, abs=0.6))


def test_stages_have_times_of_their_own() -> None:
    """In the order of the path."""
    health = Health()
    for find_ms, soft_ms in ((1.0, 9.0), (3.0, 7.0), (2.0, 8.0)):
        health.add(frame(find_ms=find_ms, soft_ms=soft_ms))
    times = totals(health).times_ms
    assert list(times.items()) == [("decode", (10.0, 10.0)), ("find", (2.0, 3.0)), ("identify", (8.0, 9.0))]


def test_times_are_of_the_recent_frames_only() -> None:
    """A slow start is forgotten; counters are not."""
    health = Health()
    for _ in range(50):
        health.add(frame(find_ms=100.0))
    for _ in range(RECENT):
        health.add(frame(find_ms=2.0))
    assert totals(health).times_ms["decode"] == (2.0, 2.0)
    assert totals(health).decoded == RECENT + 50


def test_a_snapshot_stays_as_it_was() -> None:
    """Does not change with what is counted later."""
    health = Health()
    health.add(frame(rejected=1))
    before = totals(health)
    health.add(frame(rejected=1))
    assert before.rejected == {"identify.no_bands": 1}
    assert before.decoded == 1


def test_threads_lose_no_count() -> None:
    """The capture and the decode thread write at once, while a third one reads."""
    health = Health()

    def write() -> None:
        for _ in range(2000):
            health.reject(TRUNCATED)
            health.add(frame())

    threads = [threading.Thread(target=write) for _ in range(2)]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        snapshot = totals(health)
        assert snapshot.rejected.get("capture.truncated", 0) - snapshot.decoded in (-2, -1, 0, 1, 2)
    for thread in threads:
        thread.join()
    assert totals(health).decoded == 4000
    assert totals(health).rejected == {"capture.truncated": 4000}
