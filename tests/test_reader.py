"""What a track tells once a frame has been misunderstood: such a frame is not remembered with those that add up."""

from __future__ import annotations

import pytest
from decode_material import FRAME_ROWS, ROW_TIME_US, SPEC, Canvas, quad, reason, square, word

from ledpi.decode.cells import CellSamples, sample_cells
from ledpi.decode.evidence.memory import PanelMemory
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.identify.soft import FALSE_ID_RATE, Reading
from ledpi.decode.reader import Reader
from ledpi.decode.track import Track
from ledpi.dictionaries import load_dictionary
from ledpi.records import Floats, Frame, Rejected

NEAR, FAR = square(300.3, 200.6, 75, 8.0), square(300.3, 200.6, 36, 8.0)


def shown(seq: int, corners: Floats, marker_id: int = 7) -> Frame:
    """Frame `seq` of a panel there."""
    canvas = Canvas()
    canvas.panel(corners, word(marker_id), start_us=seq * FRAME_ROWS * ROW_TIME_US)
    return canvas.frame(seed=seq, seq=seq)


def taken(frame: Frame, corners: Floats) -> CellSamples:
    samples = sample_cells(frame, quad(corners), 4)
    assert isinstance(samples, CellSamples)
    return samples


@pytest.fixture
def reader() -> Reader:
    dictionary = load_dictionary("DICT_4X4_50")
    return Reader([Codebook.build(list(range(50)), dictionary, SPEC)], FALSE_ID_RATE)


def track_of(corners: Floats) -> Track:
    return Track.of(quad(corners), 0, (PanelMemory(SPEC),))


def read_id(reading: Reading | Rejected) -> int | str:
    return reading.id if isinstance(reading, Reading) else reason(reading)


@pytest.mark.parametrize(("corners", "frames"), [(NEAR, 3), (FAR, 6)])
def test_a_square_that_was_taken_elsewhere_once_does_not_outlast_its_frame(
    reader: Reader, corners: Floats, frames: int
) -> None:
    """Half a cell aside, as where its bezel was followed; of the far panel no frame alone could tell it."""
    track = track_of(corners)
    for seq in range(frames):
        frame = shown(seq, corners)
        outcome = reader.read(track, taken(frame, corners), frame)
    assert read_id(outcome.reading) == 7
    frame = shown(frames, corners)
    aside = corners + (corners[1] - corners[0]) / 5
    assert isinstance(reader.read(track, taken(frame, aside), frame).reading, Rejected)
    frame = shown(frames + 1, corners)
    assert read_id(reader.read(track, taken(frame, corners), frame).reading) == 7


def test_while_nothing_adds_up_each_frame_still_speaks_for_itself(reader: Reader) -> None:
    """Half of what is looked at is the wall, for six frames; then it is the panel again, and its ID is told at once."""
    track = track_of(NEAR)
    for seq in range(10):
        frame = shown(seq, NEAR)
        hidden = 3 <= seq < 9
        where = NEAR + (NEAR[1] - NEAR[0]) / 2 if hidden else NEAR
        outcome = reader.read(track, taken(frame, where), frame)
        assert isinstance(outcome.reading, Rejected) if hidden else read_id(outcome.reading) == 7


def test_of_frames_that_told_nothing_from_the_first_the_next_good_one_tells_within_eight(reader: Reader) -> None:
    """What came out from behind something was not read before, and five frames of it were of something else."""
    track = track_of(NEAR)
    for seq in range(5):
        frame = shown(seq, NEAR)
        outcome = reader.read(track, taken(frame, NEAR + (NEAR[1] - NEAR[0]) / 2), frame)
        assert isinstance(outcome.reading, Rejected)
    for seq in range(5, 13):
        frame = shown(seq, NEAR)
        outcome = reader.read(track, taken(frame, NEAR), frame)
    assert read_id(outcome.reading) == 7
