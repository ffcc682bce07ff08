"""The hand-over between the capture thread and the decode worker."""

from __future__ import annotations

import itertools
import random
import threading
import time

import numpy as np
import pytest

from ledpi.core.records import Frame, Pixels
from ledpi.daemon.ring import FrameRing

WAIT_S = 10.0  # generous: a test that needs it has failed


def frame_in(slot: Pixels, seq: int) -> Frame:
    """Fills a slot with one value and makes the frame that a camera would return."""
    slot[...] = seq % 251
    return Frame(
        pixels=slot.view(),
        seq=seq,
        row0_readout_ns=seq,
        exposure_us=10000.0,
        row_time_us=33.67,
        transfer="linear",
    )


def publish(ring: FrameRing, *seqs: int) -> None:
    for seq in seqs:
        ring.publish(frame_in(ring.acquire(), seq))


def taken(ring: FrameRing) -> int | None:
    frame = ring.take(0.0)
    return None if frame is None else frame.seq


def counted(ring: FrameRing) -> tuple[int, int, int]:
    counters = ring.counters()
    return counters.published, counters.taken, counters.dropped


def test_the_reader_gets_the_newest_frame() -> None:
    """Gets the last of three frames published before it comes, and the others are counted."""
    ring = FrameRing(2, 3)
    publish(ring, 1, 2, 3)
    assert taken(ring) == 3
    assert counted(ring) == (3, 1, 2)


def test_the_pixels_are_the_writer_s_own() -> None:
    """No copy: what the reader sees is the memory that the camera filled, and it cannot write there."""
    ring = FrameRing(2, 3)
    slot = ring.acquire()
    ring.publish(frame_in(slot, 5))
    frame = ring.take(0.0)
    assert frame is not None
    assert frame.pixels.__array_interface__["data"][0] == slot.__array_interface__["data"][0]
    with pytest.raises(ValueError, match="read-only"):
        frame.pixels[0, 0] = 1


def test_a_slot_in_the_reader_s_hands_is_never_given_to_the_writer() -> None:
    """However many frames come, the one being read keeps its pixels, until it is released."""
    ring = FrameRing(2, 3)
    publish(ring, 7)
    frame = ring.take(0.0)
    assert frame is not None
    for seq in range(8, 40):
        assert not np.may_share_memory(ring.acquire(), frame.pixels)
        publish(ring, seq)
        assert (frame.pixels == 7).all()
    ring.release()
    given = []
    for seq in range(40, 44):
        given.append(np.may_share_memory(ring.acquire(), frame.pixels))
        publish(ring, seq)
    assert any(given)


def test_a_slot_is_always_writable() -> None:
    """A frame marks its own pixels read-only; the slot under it can be filled again, by any way in."""
    ring = FrameRing(2, 3)
    for seq in range(10):
        slot = ring.acquire()
        assert slot.flags.writeable
        assert slot.flags.c_contiguous
        slot[...] = 0
        marked = Frame(  # the array itself, not a view of it
            pixels=slot, seq=seq, row0_readout_ns=0, exposure_us=1.0, row_time_us=1.0, transfer="srgb"
        )
        ring.publish(marked)


def test_pixels_elsewhere_are_refused() -> None:
    """A frame that is not in the slot would be a copy, or another's memory."""
    ring = FrameRing(2, 3)
    with pytest.raises(ValueError, match=r"view of the slot that acquire\(\) gave"):
        ring.publish(frame_in(np.zeros((2, 3), np.uint8), 0))
    old = ring.acquire()
    publish(ring, 1)
    with pytest.raises(ValueError, match=r"view of the slot that acquire\(\) gave"):
        ring.publish(frame_in(old, 2))


def test_close_wakes_a_waiting_reader() -> None:
    """A reader that waits for ever is let go at once when the ring closes."""
    ring = FrameRing(2, 3)
    got: list[Frame | None] = []
    reader = threading.Thread(target=lambda: got.append(ring.take(WAIT_S)))
    reader.start()
    time.sleep(0.05)  # so that it waits, most likely
    start = time.monotonic()
    ring.close()
    reader.join(WAIT_S)
    assert got == [None]
    assert time.monotonic() - start < WAIT_S / 2
    assert ring.closed


def test_the_last_frame_before_close_is_still_read() -> None:
    """At the end of a recording its last frame is not lost."""
    ring = FrameRing(2, 3)
    publish(ring, 1)
    ring.close()
    ring.close()
    assert (taken(ring), taken(ring)) == (1, None)


def test_threads_at_random_paces_see_whole_frames_in_order() -> None:
    """Real threads, random pauses: each frame read stays whole, they come in order, and all are counted."""
    ring, frames = FrameRing(48, 64), 3000
    torn: list[int] = []
    order: list[int] = []

    def write() -> None:
        pace = random.Random(1)
        for seq in range(frames):
            ring.publish(frame_in(ring.acquire(), seq))
            if pace.random() < 0.1:
                time.sleep(pace.random() * 1e-4)
        ring.close()

    def read() -> None:
        pace = random.Random(2)
        while True:
            frame = ring.take(WAIT_S)
            if frame is None:
                return
            order.append(frame.seq)
            if pace.random() < 0.3:
                time.sleep(pace.random() * 3e-4)
            if (frame.pixels != frame.seq % 251).any():
                torn.append(frame.seq)
            if pace.random() < 0.5:
                ring.release()

    threads = [threading.Thread(target=write), threading.Thread(target=read)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join(WAIT_S)
        assert not thread.is_alive()
    assert torn == []
    assert all(earlier < later for earlier, later in itertools.pairwise(order))
    assert order[-1] == frames - 1
    assert counted(ring) == (frames, len(order), frames - len(order))
