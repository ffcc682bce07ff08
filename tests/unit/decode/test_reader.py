"""A track outlasts a frame that was misunderstood: such a frame is not remembered with those that add up."""

from __future__ import annotations

import pytest

from ledpi.core.dictionaries import load_dictionary
from ledpi.core.records import Floats, Frame, Rejected
from ledpi.decode.evidence.light import LightWeigher
from ledpi.decode.history import History, Identity
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.identify.decision import FALSE_ID_RATE
from ledpi.decode.reader import Reader
from ledpi.decode.states import READ_EVERY, State
from tests.builders.decode import FRAME_ROWS, ROW_TIME_US, SHORT_US, SPEC, TRUE_10_MS_US, Canvas, reason, square, word
from tests.builders.samples import observed

NEAR, FAR, FARTHER = (square(300.3, 200.6, side, 8.0) for side in (75, 36, 20))


def panel_frame(seq: int, corners: Floats, marker_id: int = 7, exposure_us: float = TRUE_10_MS_US) -> Frame:
    """Frame `seq` of a panel there."""
    canvas = Canvas(exposure_us=exposure_us)
    canvas.panel(corners, word(marker_id), start_us=seq * FRAME_ROWS * ROW_TIME_US)
    return canvas.frame(seed=seq, seq=seq)


CODEBOOK = Codebook.build(list(range(50)), load_dictionary("DICT_4X4_50"), SPEC)


def reader_at(false_id_rate: float) -> Reader:
    return Reader([CODEBOOK], LightWeigher(4, None), false_id_rate)


@pytest.fixture
def reader() -> Reader:
    return reader_at(FALSE_ID_RATE)


def read_id(identity: Identity | Rejected) -> int | str:
    return identity.reading.id if isinstance(identity, Identity) else reason(identity)


def further(reader: Reader, history: History, frame: Frame, where: Floats) -> tuple[History, Identity | Rejected]:
    """The history once a frame was looked at there, and what it was read as."""
    outcome = reader.read(history, observed(frame, where))
    return outcome.history, outcome.identity


@pytest.mark.parametrize(("corners", "frames"), [(NEAR, 3), (FAR, 6)])
def test_a_square_that_was_taken_elsewhere_once_does_not_outlast_its_frame(
    reader: Reader, corners: Floats, frames: int
) -> None:
    """Half a cell aside, as where its bezel was followed; of the far panel no frame alone could tell it."""
    history = History.empty((SPEC,))
    for seq in range(frames):
        history, read = further(reader, history, panel_frame(seq, corners), corners)
    assert read_id(read) == 7
    aside = corners + (corners[1] - corners[0]) / 5
    history, read = further(reader, history, panel_frame(frames, corners), aside)
    assert isinstance(read, Rejected)
    history, read = further(reader, history, panel_frame(frames + 1, corners), corners)
    assert read_id(read) == 7


def test_frames_are_kept_only_where_frequencies_are_searched_for(reader: Reader) -> None:
    """Else their sum is enough: a track would be ten times as large."""
    searching = Reader([CODEBOOK], LightWeigher(4, None), FALSE_ID_RATE, search_frequencies=True)
    for each, kept in ((reader, False), (searching, True)):
        history = History.empty((SPEC,))
        for seq in range(5):
            history, _ = further(each, history, panel_frame(seq, NEAR), NEAR)
        assert bool(history.search.observations) is kept


def test_while_nothing_adds_up_each_frame_still_speaks_for_itself(reader: Reader) -> None:
    """Half of what is looked at is the wall, for six frames; then it is the panel again, and its ID is told at once."""
    history = History.empty((SPEC,))
    for seq in range(10):
        hidden = 3 <= seq < 9
        where = NEAR + (NEAR[1] - NEAR[0]) / 2 if hidden else NEAR
        history, read = further(reader, history, panel_frame(seq, NEAR), where)
        assert isinstance(read, Rejected) if hidden else read_id(read) == 7


def test_of_frames_that_told_nothing_from_the_first_the_next_good_one_tells_within_eight(reader: Reader) -> None:
    """It came out from behind something, was not read before, and five frames of it were of something else."""
    history = History.empty((SPEC,))
    for seq in range(5):
        history, read = further(reader, history, panel_frame(seq, NEAR), NEAR + (NEAR[1] - NEAR[0]) / 2)
        assert isinstance(read, Rejected)
    for seq in range(5, 13):
        history, read = further(reader, history, panel_frame(seq, NEAR), NEAR)
    assert read_id(read) == 7


def test_a_frame_that_tells_nothing_is_left_out_of_what_was_known(reader: Reader) -> None:
    """Three frames have shown a panel; a fourth was taken most of a cell aside, in the fifth it is there again."""
    history = History.empty((SPEC,))
    for seq in range(3):
        history, _ = further(reader, history, panel_frame(seq, NEAR), NEAR)
    doubted, _ = further(reader, history, panel_frame(3, NEAR), NEAR + (NEAR[1] - NEAR[0]) / 5)
    assert doubted.memories is history.memories
    assert (doubted.state, doubted.last, doubted.identity) == (State.DOUBTED, history.last, None)
    told, _ = further(reader, doubted, panel_frame(4, NEAR), NEAR)
    assert told.state is State.READ
    assert told.identity is not None


@pytest.mark.parametrize(("marker_id", "still"), [(7, 7), (8, "identify.not_in_dictionary")])
def test_what_was_read_stays_so_by_less_than_a_first_reading_asks_for(marker_id: int, still: int | str) -> None:
    """So noise does not make it come and go. Three frames leave panel 7 30 nats, of 43 that are asked for.

    Had they been read as another one before, nothing would be told.
    """
    reader, strict = reader_at(1e-3), reader_at(1e-20)
    history = History.empty((SPEC,))
    for seq in range(2):
        frame = panel_frame(seq, FARTHER)
        history = reader.read(history, observed(frame, FARTHER)).history
    assert history.identity is not None
    last = history.identity._replace(reading=history.identity.reading._replace(id=marker_id))
    frame = panel_frame(2, FARTHER)
    due = history._replace(last=last, frames_in_state=READ_EVERY)
    assert read_id(strict.read(due, observed(frame, FARTHER)).identity) == still
    unread = history._replace(state=State.UNREAD, last=None)
    assert read_id(strict.read(unread, observed(frame, FARTHER)).identity) == "identify.not_in_dictionary"


@pytest.mark.parametrize(("side", "each"), [(75, 4), (36, 9)])
def test_a_panel_that_is_clear_is_compared_by_a_ninth_of_its_samples(reader: Reader, side: float, each: int) -> None:
    """Twelve along a cell are four, once two frames have shown that these would confirm it; small cells keep all."""
    where, history = square(300.3, 200.6, side, 8.0), History.empty((SPEC,))
    for seq in range(6):
        history, read = further(reader, history, panel_frame(seq, where), where)
    assert read_id(read) == 7
    mean = history.memories[0].mean
    assert mean is not None
    assert mean.each == each


def test_a_panel_that_is_compared_by_fewer_samples_is_still_told_from_another(reader: Reader) -> None:
    """In the very frame that shows the other one."""
    history = History.empty((SPEC,))
    for seq in range(12):
        history, _ = further(reader, history, panel_frame(seq, NEAR), NEAR)
    history, read = further(reader, history, panel_frame(12, NEAR, marker_id=23), NEAR)
    assert read_id(read) == 23


@pytest.mark.slow
@pytest.mark.parametrize("exposure_us", [SHORT_US, 252.5])
def test_deep_bands_of_few_pixels_add_up_as_faint_ones_do(reader: Reader, exposure_us: float) -> None:
    """A far panel is read in each frame; another one in its place ends that at once, and is read by the next frame."""
    history, ids = History.empty((SPEC,)), []
    for seq in range(11):
        frame = panel_frame(seq, FAR, 7 if seq < 9 else 12, exposure_us)
        history, read = further(reader, history, frame, FAR)
        ids.append(read_id(read))
    assert ids[:9] == [7] * 9
    assert 7 not in ids[9:]
    assert ids[10] == 12
