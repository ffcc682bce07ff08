"""The row time that frame intervals tell: literal times, right and misreported."""

from __future__ import annotations

import numpy as np
import pytest

from ledpi.core.records import CameraInfo, Frame
from ledpi.core.shutter import RowClock

INFO = CameraInfo(width=640, height=480, exposure_us=9999.0, row_time_us=33.67, transfer="srgb", frame_length_rows=504)
REPORTED_NS = 16_969_680  # 504 rows of 33.67 µs
TRUE_NS = 16_002_000  # 504 rows of 31.75 µs


def clock(period_ns: int, frames: int = 6, *, jitter_ns: float = 0.0) -> RowClock:
    found, rng = RowClock(INFO), np.random.default_rng(1)
    for seq in range(frames):
        found.add(seq, 1_000_000_000 + seq * period_ns + round(jitter_ns * rng.standard_normal()))
    return found


def test_a_driver_that_is_right_is_believed() -> None:
    """Frames as long as reported: nothing is corrected, to the last bit."""
    assert clock(REPORTED_NS).ratio == 1.0
    assert clock(REPORTED_NS).corrected(INFO) is INFO


def test_a_misreported_row_time_shows_in_the_intervals() -> None:
    """A driver that believes in 55 MHz where 58.333 MHz run: rows and exposure are 5.7 % shorter."""
    found = clock(TRUE_NS).corrected(INFO)
    assert found.row_time_us == pytest.approx(31.75)
    assert found.exposure_us == pytest.approx(9999.0 * 31.75 / 33.67)
    # A frame by its own exposure, which may differ from the configured one.
    frame = Frame(
        pixels=np.zeros((480, 640), np.uint8),
        seq=7,
        row0_readout_ns=1,
        exposure_us=2000.0,
        row_time_us=33.67,
        transfer="srgb",
    )
    of_frame = clock(TRUE_NS).corrected(frame)
    assert (of_frame.seq, of_frame.row0_readout_ns) == (7, 1)
    assert of_frame.row_time_us == pytest.approx(31.75)
    assert of_frame.exposure_us == pytest.approx(2000.0 * 31.75 / 33.67)


def test_two_intervals_are_not_enough() -> None:
    """One late frame would look like a slow row."""
    assert clock(TRUE_NS, frames=3).ratio == 1.0
    assert clock(TRUE_NS, frames=4).ratio != 1.0


def test_gaps_do_not_count() -> None:
    """Frames that were lost leave a gap in `seq`, takes one in time; neither is a long row."""
    found = RowClock(INFO)
    for seq in (0, 1, 2, 5, 6, 7, 9):
        found.add(seq, 1_000_000_000 + seq * TRUE_NS)
    for seq in range(10, 14):
        found.add(seq, 9_000_000_000 + seq * TRUE_NS)
    assert found.ratio == pytest.approx(31.75 / 33.67, rel=1e-4)


def test_a_period_that_does_not_follow_from_the_rows_is_left_alone() -> None:
    """25 ms for 504 rows of 33.67 µs would be rows half as long again: no driver is that wrong."""
    assert clock(25_000_000).ratio == 1.0


def test_late_frames_are_no_misreport_at_any_time() -> None:
    """0.2 ms of jitter: of a hundred streams seven begin with intervals that agree by chance, and are off together."""
    rng = np.random.default_rng(1)
    ever_off = 0
    for _ in range(100):
        found, seen = RowClock(INFO), []
        for seq in range(20):
            found.add(seq, 1_000_000_000 + seq * REPORTED_NS + round(2e5 * rng.standard_normal()))
            seen.append(found.ratio)
        ever_off += seen != [1.0] * 20
    assert ever_off <= 1


def test_a_camera_of_unknown_frame_length_cannot_be_checked() -> None:
    """A V4L2 camera does not tell it."""
    found = RowClock(CameraInfo(width=640, height=480, exposure_us=9999.0, row_time_us=33.67, transfer="srgb"))
    for seq in range(10):
        found.add(seq, 1_000_000_000 + seq * TRUE_NS)
    assert found.ratio == 1.0
