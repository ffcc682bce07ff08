"""Frames that wait to be recorded: bounded, in order, and the decoder waits for nobody."""

from __future__ import annotations

import time
import tracemalloc

import pytest

from ledpi.runtime.record_queue import MAX_BYTES, MAX_FRAMES, MIN_FRAMES, RecordQueue
from tests.builders.rewind import DRIVE, HEIGHT, WIDTH, Stream, later, nothing_in, numbered, stream


@pytest.fixture(scope="module")
def drive() -> Stream:
    return stream(16)


def keep(queue: RecordQueue, *seqs: int) -> None:
    for seq in seqs:
        of = numbered(seq)
        queue.keep(of, nothing_in(of), 1000 + seq)


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


def test_its_memory_is_bounded_and_there_before_the_first_frame() -> None:
    """Keeps fewer of large pictures; no frame asks for as much as a tenth of a picture."""
    assert RecordQueue(2000, 3000).frames == MIN_FRAMES
    assert RecordQueue(1232, 1640).frames * 1232 * 1640 <= MAX_BYTES
    queue = RecordQueue(HEIGHT, WIDTH)
    coming = [(of, nothing_in(of)) for of in map(numbered, range(2 * MAX_FRAMES))]
    tracemalloc.start()
    try:
        before = tracemalloc.get_traced_memory()[0]
        for of, result in coming:
            queue.keep(of, result, 0)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert queue.room == 0
    assert peak - before < HEIGHT * WIDTH / 10


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


@pytest.mark.slow
def test_keeping_costs_little_beside_decoding(drive: Stream) -> None:
    """Measured against decoding the same frames, in the same run: less than a twentieth, with room and without."""
    pipeline = drive.pipeline()
    queue = RecordQueue(*DRIVE)
    keeping, decoding = [], []
    for round_number in range(6):
        for each in drive.frames:
            of = later(each, round_number * 10**12, round_number * 1000)
            began = time.perf_counter()
            result = pipeline.decode(of)
            between = time.perf_counter()
            queue.keep(of, result, 0)
            keeping.append(time.perf_counter() - between)
            decoding.append(between - began)
    assert queue.dropped > 0
    assert sorted(keeping)[len(keeping) // 2] < sorted(decoding)[len(decoding) // 2] / 20
    kept = sorted(keeping[: queue.frames])
    assert kept[len(kept) // 2] < sorted(decoding)[len(decoding) // 2] / 20
