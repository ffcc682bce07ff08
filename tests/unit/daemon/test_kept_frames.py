"""Frames that are kept, the last seconds and those that wait to be recorded: the decoder waits for nobody."""

from __future__ import annotations

import math
import time
import tracemalloc
from dataclasses import replace
from itertools import pairwise

import pytest

from ledpi.daemon.kept_frames import (
    MAX_BYTES,
    MAX_FRAMES,
    MIN_FRAMES,
    MIN_QUEUED,
    MOST_MISSED,
    SPARE,
    FrameBuffers,
    KeptFrame,
    RecordQueue,
    RewindRing,
)
from tests.builders.rewind import DRIVE, HEIGHT, PERIOD_NS, WIDTH, Stream, later, nothing_in, numbered, stream

PLENTY = 400 * HEIGHT * WIDTH


@pytest.fixture(scope="module")
def drive() -> Stream:
    return stream(31)


def ring_of(seconds: float, most_bytes: int = PLENTY) -> RewindRing:
    return RewindRing(HEIGHT, WIDTH, PERIOD_NS * 1e-6, seconds, most_bytes)


def keep(ring: FrameBuffers, *seqs: int) -> None:
    for seq in seqs:
        of = numbered(seq)
        ring.keep(of, nothing_in(of), 1000 + seq)


def seqs(kept: list[KeptFrame]) -> list[int]:
    return [each.frame.seq for each in kept]


def test_what_was_kept_is_taken_from_its_first_frame() -> None:
    """In order, each with its budget and its picture."""
    ring = ring_of(2.0)
    keep(ring, *range(30))
    kept = ring.take()
    assert seqs(kept) == list(range(30))
    assert [each.search_budget for each in kept] == [1000 + seq for seq in range(30)]
    assert all((ring.picture_of(each).pixels == each.frame.seq).all() for each in kept)


def test_the_oldest_go() -> None:
    """A second more stays than was asked for: in that, whoever decodes it again finds and reads the panels."""
    ring = ring_of(2.0)
    keep(ring, *range(400))
    kept = ring.take()
    assert kept[-1].frame.seq == 399
    long_ns = kept[-1].frame.row0_readout_ns - kept[0].frame.row0_readout_ns
    assert 3.0e9 - PERIOD_NS <= long_ns <= 3.0e9 + PERIOD_NS
    assert all(b - a == 1 for a, b in pairwise(seqs(kept)))


def test_it_says_how_many_seconds_are_kept() -> None:
    """From the first frame to the last one: none of nothing, and none once they are taken."""
    ring = ring_of(2.0)
    empty_s = ring.kept_s
    keep(ring, *range(61))
    kept_s = ring.kept_s
    ring.take()
    assert (empty_s, kept_s, ring.kept_s) == (0.0, pytest.approx(60 * PERIOD_NS * 1e-9), 0.0)


def test_what_is_taken_once_is_not_taken_again() -> None:
    """The next recording begins where the one before has ended."""
    ring = ring_of(2.0)
    keep(ring, *range(30))
    first = ring.take()
    assert ring.take() == []
    keep(ring, *range(30, 60))
    second = ring.take()
    assert second[0].frame.seq == 30
    assert {each.slot for each in first}.isdisjoint(each.slot for each in second)


def test_a_picture_that_is_being_written_stays() -> None:
    """The ring goes on with the room that is left, without a gap, and with more as it is given back."""
    ring = ring_of(2.0)
    keep(ring, *range(400))
    taken = ring.take()
    for given, each in enumerate(taken):
        keep(ring, 400 + 2 * given, 401 + 2 * given)
        assert (ring.picture_of(each).pixels == each.frame.seq % 256).all()
        ring.give_back(each)
    after = ring.take()
    assert len(after) > 100
    assert all(b - a == 1 for a, b in pairwise(seqs(after)))


def test_where_all_is_being_written_it_begins_again() -> None:
    """A frame that found no room is no part of the next recording, which begins after it."""
    ring = ring_of(2.0)
    keep(ring, *range(400))
    taken = ring.take()
    seq = 400
    while ring.room:
        keep(ring, seq, seq + 1)
        taken += ring.take()
        seq += 2
    keep(ring, seq)
    assert ring.take() == []
    for each in taken:
        ring.give_back(each)
    keep(ring, *range(seq + 1, seq + 20))
    after = ring.take()
    assert seqs(after) == list(range(seq + 1, seq + 20))


def test_time_that_runs_backward_ends_what_is_kept() -> None:
    """A camera that was opened anew may count anew; no recording holds both."""
    ring = ring_of(2.0)
    keep(ring, *range(100, 130))
    keep(ring, *range(20))
    kept = ring.take()
    assert seqs(kept) == list(range(20))


def test_memory_holds_as_much_as_it_may() -> None:
    """Keeps what fits, where a minute does not; pictures and results count."""
    most = 40 * HEIGHT * WIDTH
    ring = ring_of(60.0, most)
    keep(ring, *range(200))
    kept = ring.take()
    assert MIN_FRAMES < ring.frames < 40
    assert ring.frames * HEIGHT * WIDTH + sum(each.side_bytes for each in kept) <= most
    assert len(kept) >= ring.frames - SPARE


def test_many_panels_shorten_it_and_take_no_more_memory(drive: Stream) -> None:
    """Results of a picture full of panels: fewer are kept, so fewer seconds are."""
    markers = next(decoded.markers for decoded in drive.live if decoded.markers)[:1] * 20
    most = 100 * HEIGHT * WIDTH
    ring = ring_of(60.0, most)
    for seq in range(300):
        of = numbered(seq)
        ring.keep(of, replace(nothing_in(of), markers=markers), 0)
    kept = ring.take()
    assert ring.frames * HEIGHT * WIDTH + sum(each.side_bytes for each in kept) <= most
    assert 0 < len(kept) < 0.75 * ring.frames - SPARE


def test_too_little_memory_keeps_nothing() -> None:
    """And hinders nothing."""
    ring = ring_of(10.0, 3 * HEIGHT * WIDTH)
    keep(ring, *range(10))
    assert ring.frames == 0
    assert ring.take() == []


def test_rooms_are_touched_beside_frames_that_come() -> None:
    """So that memory is there before a frame needs it; what is kept stays as it is."""
    ring = ring_of(1.0)
    for number in range(ring.frames):
        ring.touch()
        if number % 4 == 0:
            keep(ring, number // 4)
    kept = ring.take()
    assert seqs(kept) == list(range(math.ceil(ring.frames / 4)))
    assert all((ring.picture_of(each).pixels == each.frame.seq).all() for each in kept)


# ---- Frames that wait to be recorded


def rest(queue: RecordQueue) -> list[int]:
    """Returns what is in it, once it is closed; each has its own picture and budget."""
    queue.close()
    seqs = []
    while (kept := queue.next(0.0)) is not None:
        assert (queue.picture_of(kept).pixels == kept.frame.seq % 256).all()
        assert kept.search_budget == 1000 + kept.frame.seq
        seqs.append(kept.frame.seq)
    return seqs


def test_it_gives_what_comes_in_order() -> None:
    """From the first frame on."""
    queue = RecordQueue(HEIGHT, WIDTH)
    keep(queue, 5, 6, 7)
    first = queue.next(time.monotonic() + 60)
    assert first is not None
    assert first.frame.seq == 5
    assert rest(queue) == [6, 7]


def test_what_finds_no_room_is_dropped_and_counted() -> None:
    """The newest go, so what waits has no gap; with room again there is one, in order."""
    queue = RecordQueue(HEIGHT, WIDTH)
    keep(queue, *range(MAX_FRAMES + 10))
    assert queue.dropped == 10
    oldest = queue.next(time.monotonic() + 60)
    assert oldest is not None
    queue.give_back(oldest)
    keep(queue, 200)
    assert rest(queue) == [*range(1, MAX_FRAMES), 200]
    assert queue.dropped == 10


def test_what_the_diary_has_of_a_dropped_frame_comes_with_the_next() -> None:
    """Odometry is not lost with a picture; but where a disk hangs, no more than a minute's is kept."""
    queue = RecordQueue(HEIGHT, WIDTH)
    keep(queue, *range(MAX_FRAMES))
    for seq, diary in ((100, ("old",) * MOST_MISSED), (101, ("101",)), (102, ("102",))):
        if seq == 102:
            queue.give_back(queue.next(time.monotonic() + 60) or pytest.fail("is empty"))
        queue.keep(numbered(seq), replace(nothing_in(numbered(seq)), diary=diary), 0)
    lines = [kept.decoded.diary for _ in range(MAX_FRAMES) if (kept := queue.next(0.0)) is not None]
    assert lines == [*[()] * (MAX_FRAMES - 1), (*("old",) * (MOST_MISSED - 1), "101", "102")]


def test_after_the_end_nothing_is_taken() -> None:
    """Nor counted: it is no part of the recording."""
    queue = RecordQueue(HEIGHT, WIDTH)
    keep(queue, *range(10))
    queue.close()
    keep(queue, *range(10, 20))
    assert rest(queue) == list(range(10))
    assert queue.dropped == 0


def test_time_ends_it_also_while_frames_wait() -> None:
    """One that is never empty would never end; what waits is still taken."""
    queue = RecordQueue(HEIGHT, WIDTH)
    keep(queue, *range(10))
    assert queue.next(time.monotonic() - 1.0) is not None
    keep(queue, *range(10, 20))
    assert rest(queue) == list(range(1, 10))


def test_time_that_runs_backward_ends_it() -> None:
    """A camera that was opened anew may count anew; no recording holds both."""
    queue = RecordQueue(HEIGHT, WIDTH)
    keep(queue, *range(100, 110), *range(20))
    assert rest(queue) == list(range(100, 110))


def test_what_is_abandoned_is_counted() -> None:
    """The daemon ends, and has no time for it."""
    queue = RecordQueue(HEIGHT, WIDTH)
    keep(queue, *range(10))
    assert queue.next(time.monotonic() + 60) is not None
    queue.abandon()
    assert queue.dropped == 9


def test_memory_is_bounded_and_there_before_the_first_frame() -> None:
    """Fewer of large pictures wait; no frame asks for as much as a tenth of a picture, with room or without."""
    assert RecordQueue(2000, 3000).frames == MIN_QUEUED
    assert RecordQueue(1232, 1640).frames * 1232 * 1640 <= MAX_BYTES
    for kept in (RecordQueue(HEIGHT, WIDTH), ring_of(0.5)):
        coming = [(of, nothing_in(of)) for of in map(numbered, range(2 * MAX_FRAMES))]
        tracemalloc.start()
        try:
            before = tracemalloc.get_traced_memory()[0]
            for of, result in coming:
                kept.keep(of, result, 0)
            peak = tracemalloc.get_traced_memory()[1]
        finally:
            tracemalloc.stop()
        assert peak - before < HEIGHT * WIDTH / 10


def test_keeping_costs_little_beside_decoding(drive: Stream) -> None:
    """Measured against decoding the same frames, in the same run: less than a twentieth, in each of both."""
    pipeline = drive.pipeline()
    both = RewindRing(*DRIVE, PERIOD_NS * 1e-6, 0.5, PLENTY), RecordQueue(*DRIVE)
    keeping, decoding = [], []
    for round_number in range(2):
        for each in drive.frames:
            of = later(each, round_number * 10**12, round_number * 1000)
            began = time.perf_counter()
            result = pipeline.decode(of)
            between = time.perf_counter()
            for kept in both:
                kept.keep(of, result, 0)
            keeping.append((time.perf_counter() - between) / 2)
            decoding.append(between - began)
    assert sorted(keeping)[len(keeping) // 2] < sorted(decoding)[len(decoding) // 2] / 20
