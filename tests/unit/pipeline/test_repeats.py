"""A picture that comes again with a new time shows nothing that is so now."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from ledpi.core.records import Frame
from ledpi.pipeline.pipeline import Pipeline
from tests.builders.decode import FRAME_ROWS, PINHOLE, ROW_TIME_US, Canvas, camera_info, panel_settings, square, word

PERIOD_NS = round(1e3 * FRAME_ROWS * ROW_TIME_US)


def shown(seq: int, at: int) -> Frame:
    """Picture `seq` of panel 7 at rest, as frame `at`."""
    canvas = Canvas()
    canvas.panel(square(310.3, 240.6, 100, 4), word(7), light=0.4, start_us=seq * PERIOD_NS * 1e-3)
    return replace(canvas.frame(seq, seq=at), row0_readout_ns=10**9 + at * PERIOD_NS)


def reported(path: Pipeline, frame: Frame) -> tuple[list[int], bool]:
    """The IDs, and whether the picture was refused as one that came before."""
    decoded = path.decode(frame)
    return [m.detection.id for m in decoded.markers], "capture.repeated" in {why.key for why in decoded.rejected}


def pipeline(*, stream: bool = True) -> Pipeline:
    return Pipeline(camera_info(), panel_settings(), intrinsics=PINHOLE, stream=stream)


def test_no_pose_is_made_of_a_picture_that_came_before() -> None:
    """However often it comes; the next one that is new is read at once, as the panel is still followed."""
    path = pipeline()
    first = [reported(path, shown(seq, seq)) for seq in range(4)]
    again = [reported(path, shown(3, at)) for at in range(4, 9)]
    assert first[-1] == ([7], False)
    assert again == [([], True)] * 5
    assert reported(path, shown(9, 9)) == ([7], False)


@pytest.mark.slow
@pytest.mark.parametrize("buffers", [2, 4, 6])
def test_nor_where_a_driver_gives_its_buffers_by_turns(buffers: int) -> None:
    """A queue that nobody fills any more."""
    path = pipeline()
    for seq in range(10):
        reported(path, shown(seq, seq))
    again = [reported(path, shown(10 - buffers + at % buffers, at)) for at in range(10, 10 + 2 * buffers)]
    assert again == [([], True)] * (2 * buffers)


@pytest.mark.parametrize("pixels", [1, 640])
def test_one_that_differs_anywhere_near_a_panel_is_new(pixels: int) -> None:
    """By as little as a pixel of a row that is compared, or a row."""
    path = pipeline()
    for seq in range(4):
        reported(path, shown(seq, seq))
    frame = shown(3, 4)
    changed = frame.pixels.copy()
    changed[200, :pixels] ^= np.uint8(1)
    assert reported(path, replace(frame, pixels=changed)) == ([7], False)


def test_a_frame_that_is_alone_has_none_before_it() -> None:
    """The same picture twice is twice the same answer."""
    path = pipeline(stream=False)
    assert [reported(path, shown(3, at)) for at in (3, 4)] == [([7], False)] * 2
