"""A panel ends where lines say if no row or column beside it blinks as those within it do."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from decode_material import FRAME_ROWS, LENS, PINHOLE, ROW_TIME_US, Canvas, quad, seen_through, square, word
from samples_material import bands_of, samples_of

from ledpi.config import PanelSettings
from ledpi.decode.belief import Belief
from ledpi.decode.history import History, Shown
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.identify.ends import Ends
from ledpi.decode.identify.soft import Reading, read_word
from ledpi.dictionaries import load_dictionary
from ledpi.records import Floats, Frame, Intrinsics, Rejected, ToldBy

SPEC = PanelSettings(side_m=0.16).spec()
BOOK = Codebook.build(list(range(50)), load_dictionary("DICT_4X4_50"), SPEC)
PERIOD_US = FRAME_ROWS * ROW_TIME_US
TRUE = square(310.4, 240.2, 100.0, 13)  # 1 m


def touched(
    true: Floats = TRUE, light: float = 0.4, lens: Intrinsics | None = None, panel_light: float = 0.4
) -> Frame:
    """A panel, and a window and a sheet along two of its sides."""
    canvas = Canvas()
    across = true[[1, 2]].mean(axis=0) - true[[0, 3]].mean(axis=0)
    canvas.lamp(true - across, light)
    canvas.lamp(true + across, 0.6)
    canvas.panel(true, word(7), lens=lens, light=panel_light)
    return canvas.frame()


def ends(frame: Frame, at: Floats, shown: Floats, lens: Intrinsics | None = None) -> bool:
    samples = samples_of(frame, at, lens)
    seen = Ends.of(SPEC).after(frame, quad(at), samples, lens)
    return seen.are_where_told(shown, frame.row0_readout_ns)


@pytest.mark.parametrize("light", [0.0, 0.3, 0.9, 4.0])
@pytest.mark.parametrize("first", range(4))
def test_a_panel_ends_where_it_does(light: float, first: int) -> None:
    """Beside something dark, as bright, brighter, or saturated; whichever of its corners comes first."""
    frame, at = touched(light=light), np.roll(TRUE, -first, axis=0)
    assert ends(frame, at, bands_of(frame, at, BOOK))


def test_it_does_so_behind_a_lens() -> None:
    """In the picture's corner its rows are bent, and so are those beside it."""
    straight = square(130.4, 120.2, 100.0, 13)
    canvas = Canvas()
    canvas.panel(straight, word(7), lens=LENS)
    frame, at = canvas.frame(), seen_through(LENS, straight)
    assert ends(frame, at, bands_of(frame, at, BOOK), LENS)


@pytest.mark.parametrize("row", range(4))
@pytest.mark.parametrize("up", [True, False])
def test_a_lattice_a_row_aside_does_not(row: int, up: bool) -> None:
    """On any of the four sides; whether what it has for its last row is taken for cells of the first class or is not
    told at all."""
    frame = touched()
    at, shown = np.roll(TRUE, -row, axis=0), bands_of(frame, np.roll(TRUE, -row, axis=0), BOOK).reshape(4, 4, -1)
    down = (at[3] - at[0]) / 4
    of_aside = np.concatenate([shown[:1], shown[:-1]]) if up else np.concatenate([0 * shown[:1], shown[:-1]])
    assert not ends(frame, at - down, of_aside.reshape(16, -1))


@pytest.mark.parametrize("corner", [(0, 0), (2, 1), (0, 2), (1, 1)])
def test_a_lattice_of_half_the_rows_does_not(corner: tuple[int, int]) -> None:
    """Two by two cells of a near panel, each taken for four: all within it blinks, and so does what is beside."""
    true = square(310.4, 240.2, 220.0, 13)
    frame = touched(true)
    shown = bands_of(frame, true, BOOK).reshape(4, 4, -1)
    x, y = corner
    across, down = (true[1] - true[0]) / 4, (true[3] - true[0]) / 4
    at = true[0] + x * across + y * down + np.array([0 * across, 2 * across, 2 * across + 2 * down, 2 * down])
    of_half = shown[y : y + 2, x : x + 2].repeat(2, axis=0).repeat(2, axis=1)
    assert not ends(frame, at, of_half.reshape(16, -1))


def test_at_the_pictures_border_no_end_is_seen() -> None:
    """A row may be beyond it."""
    true = square(54.0, 240.2, 100.0)
    frame = touched(true)
    assert not ends(frame, true, bands_of(frame, true, BOOK))


@pytest.mark.parametrize("first", range(4))
@pytest.mark.parametrize("lens", [None, PINHOLE])
def test_what_is_in_the_picture_of_a_row_tells_for_the_row(first: int, lens: Intrinsics | None) -> None:
    """Two whole cells of the row to the left; whichever corner comes first. Not if they are another panel's."""
    true = square(74.0, 240.2, 100.0, 36)
    frame, at = touched(true), np.roll(true, -first, axis=0)
    assert ends(frame, at, bands_of(frame, at, BOOK), lens)
    canvas = Canvas()
    canvas.panel(true - true[1] + true[0], word(12))
    canvas.panel(true, word(7))
    beside = canvas.frame()
    assert not ends(beside, at, bands_of(beside, at, BOOK), lens)


@pytest.mark.parametrize(("x", "told"), [(72.0, False), (172.0, True)])
def test_what_is_in_the_picture_of_a_row_must_hold_enough_by_itself(x: float, told: bool) -> None:
    """Two cells, of a panel so dim that the weakest of its rows has log odds of 50 to 70."""
    true = square(x, 240.2, 100.0, 36)
    frame = touched(true, panel_light=0.18)
    assert ends(frame, true, bands_of(frame, true, BOOK)) is told


def far_frames(true: Floats) -> list[Frame]:
    """At 3 m, 16.97 ms apart: the first and eleven more."""
    frames = []
    for n in range(12):
        canvas = Canvas()
        canvas.panel(true, word(7), start_us=n * PERIOD_US)
        frames.append(replace(canvas.frame(n, seq=n), row0_readout_ns=round(1e9 + 1e3 * n * PERIOD_US)))
    return frames


def ends_after(frames: list[Frame], at: Floats, shown: Floats) -> list[bool]:
    seen, told = Ends.of(SPEC), []
    for frame in frames:
        samples = samples_of(frame, at)
        seen = seen.after(frame, quad(at), samples, None)
        told.append(seen.are_where_told(shown, frames[0].row0_readout_ns))
    return told


def test_far_away_it_takes_several_frames_to_tell() -> None:
    """In one frame the rows' log odds are too small; they add up."""
    true = square(310.4, 240.2, 34.0, 13)
    told = ends_after(far_frames(true), true, bands_of(touched(), TRUE, BOOK))
    assert not told[0]
    assert told[-1]


def test_however_many_frames_a_lattice_a_row_aside_does_not_end() -> None:
    """What it takes for its last row never blinks, and that beside its first does."""
    true = square(310.4, 240.2, 34.0, 13)
    down = (true[3] - true[0]) / 4
    shown = np.roll(bands_of(touched(), TRUE, BOOK).reshape(4, 4, -1), -1, axis=0).reshape(16, -1)
    assert not any(ends_after(far_frames(true), true + down, shown))


@pytest.mark.parametrize("last", [True, False])
def test_a_frame_in_which_a_row_is_out_of_sight_begins_anew(last: bool) -> None:
    """Else what is within would have been seen in more frames than what is beside. Frames after that tell."""
    true, border = square(310.4, 240.2, 34.0, 13), square(20.0, 240.2, 34.0)
    frames, shown = far_frames(true), bands_of(touched(), TRUE, BOOK)
    seen = Ends.of(SPEC)
    for at, frame in zip([true] * 11 + [border] if last else [border] + [true] * 11, frames, strict=True):
        seen = seen.after(frame, quad(at), samples_of(frame, at), None)
    assert seen.are_where_told(shown, frames[0].row0_readout_ns) is not last


def test_what_lines_told_first_is_asked_where_it_ends_whatever_tells_it_later() -> None:
    """Dark walls in a larger lattice may look like sides in a later frame. (Of a new square, sides are believed.)"""
    frame, down = touched(), (TRUE[3] - TRUE[0]) / 4
    by_sides, lattice = quad(TRUE + down), samples_of(frame, TRUE + down)
    reading = read_word(samples_of(frame, TRUE), frame, BOOK)
    assert isinstance(reading, Reading)
    aside = reading._replace(cell_bands=np.roll(reading.cell_bands.reshape(4, 4, -1), -1, axis=0).reshape(16, -1))
    told_first: tuple[ToldBy, ...] = ("lines", "sides")
    for first in told_first:
        history, shown = History.of((SPEC,)).after(lattice, frame)[0], Shown(group=0, reading=aside)
        belief = Belief(4, None, stream=True)
        believed = belief.where(frame, replace(by_sides, told_by=first), lattice, history, shown)
        assert isinstance(believed.place, Rejected) == (first == "lines")
        if first == "lines":
            assert isinstance(belief.where(frame, by_sides, lattice, believed.history, shown).place, Rejected)
