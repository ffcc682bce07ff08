"""The steps of both methods as pictures: each tile shows what its step made of the frame."""

from __future__ import annotations

import json
import shutil
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from ledpi.camera.recording.writer import RecordingWriter
from ledpi.config.settings import Method
from ledpi.core.records import CameraInfo, Floats, Frame, Pixels, Rejected
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.identify.decision import Reading
from ledpi.pipeline.diagnosis.drawing import BLACK_CLASS, WHITE_CLASS
from ledpi.pipeline.pipeline import Pipeline
from ledpi.pipeline.trace import class_alone, class_given_others
from ledpi.workshop.snapshot.page import BORDER, PICTURES_TOP, WIDTH, View, view_of
from ledpi.workshop.snapshot.sources import Snapshot, take
from ledpi.workshop.snapshot.steps import CAPTION, GAP, TITLE, draw_steps, tile_width
from tests.builders.command import Run
from tests.builders.decode import (
    PINHOLE,
    ROW_TIME_US,
    SHORT_US,
    SPEC,
    Canvas,
    camera_info,
    panel_settings,
    square,
    word,
)

PLACE = square(310.3, 240.6, 150, 4)
TALL = round(tile_width(4) * 480 / 640)


def frame(*, exposure_us: float = SHORT_US, seq: int = 0) -> Frame:
    """Panel 7, and a square lamp that does not blink."""
    canvas = Canvas(exposure_us=exposure_us)
    canvas.panel(PLACE, word(7))
    canvas.lamp(square(560, 100, 60))
    return canvas.frame(seq=seq)


def taken(method: Method, seen: Frame) -> Snapshot:
    info = camera_info(exposure_us=seen.exposure_us)
    pipeline = Pipeline(info, panel_settings(), intrinsics=PINHOLE, method=method, stream=False)
    return take("a panel and a lamp", seen, pipeline, PINHOLE)


def cells(at: Callable[[Floats], Floats]) -> Floats:
    """(4, 4, 2) where `at` puts the middles of PLACE's cells."""
    u, v = np.meshgrid((np.arange(4) + 0.5) / 4, (np.arange(4) + 0.5) / 4)
    across, down = PLACE[1] - PLACE[0], PLACE[3] - PLACE[0]
    return at((PLACE[0] + u[..., None] * across + v[..., None] * down).reshape(-1, 2)).reshape(4, 4, 2)


def colours(tile: Pixels, places: Floats) -> Pixels:
    x, y = places.round().astype(int).reshape(-1, 2).T
    return np.asarray(tile[y, x].reshape(*places.shape[:-1], 3))


# ---- The paper's steps


@pytest.fixture(scope="module")
def bands() -> Snapshot:
    return taken("uemura", frame())


@pytest.fixture(scope="module")
def drawn_bands(bands: Snapshot) -> Pixels:
    return draw_steps(bands)


def tile(drawn: Pixels, letter: str) -> Pixels:
    """One of the seven, two rows of four."""
    row, column = divmod("abcdefg".index(letter), 4)
    top, left = PICTURES_TOP + row * (TALL + CAPTION + TITLE), BORDER + column * (tile_width(4) + GAP)
    return drawn[top : top + TALL, left : left + tile_width(4)]


def view(bands: Snapshot) -> View:
    """Returns what all tiles show: the panel that was read, and what is around it."""
    (read,) = (s for s in bands.trace.uemura[0].squares if not isinstance(s.result, Rejected))
    return view_of([read.framed_px], bands.frame.pixels.shape, tile_width(4))


def test_a_is_even_and_b_is_striped(bands: Snapshot, drawn_bands: Pixels) -> None:
    """To the eye the panel is a lamp; in the picture black's bands go down to nothing. Pages are of one width."""
    assert drawn_bands.shape[1:] == (WIDTH, 3)
    assert 0 <= drawn_bands.shape[0] - (PICTURES_TOP + 2 * (TALL + CAPTION) + TITLE) <= BORDER
    low, high = view(bands).place(np.array([[260.0, 190], [360.0, 290]])).astype(int)
    inside = slice(low[1], high[1]), slice(low[0], high[0])
    assert np.std(tile(drawn_bands, "a")[inside]) < 0.3 * np.std(tile(drawn_bands, "b")[inside])
    assert tile(drawn_bands, "b")[inside].min() < 20


def test_g_is_the_marker_where_the_panel_was(bands: Snapshot, drawn_bands: Pixels) -> None:
    """White where the word is 1, black where it is 0 and in the frame, white around that."""
    at, restored = view(bands), tile(drawn_bands, "g")
    np.testing.assert_array_equal(colours(restored, cells(at.place))[..., 0] > 127, word(7))
    frame_and_ground = at.place(np.array([[310.0, 240 - 94], [310, 240 - 131]]))
    np.testing.assert_array_equal(colours(restored, frame_and_ground)[:, 0] > 127, [False, True])


def test_an_empty_frame_is_shown_whole() -> None:
    """There is nothing to look at more closely."""
    canvas = Canvas(exposure_us=SHORT_US)
    canvas.light[:, :320] = 0.2
    drawn = draw_steps(taken("uemura", canvas.frame(None)))
    half = tile_width(4) // 2
    seen = tile(drawn, "b").astype(int)
    assert seen[:, : half - 1].mean() > seen[:, half + 1 :].mean() + 50


# ---- Our own method's steps


NO_CODEWORD = np.indices((4, 4)).sum(axis=0) % 2 == 0


@pytest.fixture(scope="module")
def soft() -> Snapshot:
    """Panel 7, a smaller one that shows no word, and a lamp."""
    canvas = Canvas(exposure_us=9966.32)
    canvas.panel(PLACE, word(7))
    canvas.panel(square(540, 100, 80), NO_CODEWORD)
    canvas.lamp(square(80, 400, 60))
    return taken("likelihood", canvas.frame())


def row_of(drawn: Pixels, number: int, column: int) -> Pixels:
    """A tile of a look's row; the frame and its candidates are above."""
    size, above = tile_width(4), round(tile_width(2) * 480 / 640)
    top = PICTURES_TOP + above + CAPTION + TITLE + number * (size + CAPTION + TITLE)
    left = BORDER + column * (size + GAP)
    return drawn[top : top + size, left : left + size]


def middles(size: int) -> Floats:
    along = (np.arange(4) + 0.25) / 4 * size  # off the middle, where the number stands
    x, y = np.meshgrid(along, along)
    return np.stack([x, y], axis=-1)


def test_soft_shows_what_was_read_before_what_was_not(soft: Snapshot) -> None:
    """A row of four tiles for the panel, one of three for what shows no word; near by each cell speaks for itself.

    Evidence is positive for white cells, given the other cells or of the cell alone. A lamp has no bands.
    """
    drawn = draw_steps(soft)
    places = middles(tile_width(4))
    expected = np.where(word(7)[..., None], WHITE_CLASS, BLACK_CLASS)
    np.testing.assert_array_equal(colours(row_of(drawn, 0, 3), places), expected)
    np.testing.assert_allclose(colours(row_of(drawn, 0, 2), places).astype(int), expected, atol=2)
    assert np.ptp(row_of(drawn, 1, 0).reshape(-1, 3).astype(int), axis=0).max() > 50
    assert np.ptp(row_of(drawn, 1, 3).reshape(-1, 3).astype(int), axis=0).max() == 0
    (look,) = (look for look in soft.trace.squares if isinstance(look.reading, Reading))
    assert isinstance(look.evidence, Evidence)
    turned = word(7, look.reading.quarter_turns)
    given_others = class_given_others(look.evidence, look.reading.cell_bands, turned.ravel())
    for nats in (given_others, class_alone(look.evidence)):
        np.testing.assert_array_equal(nats.reshape(4, 4) > 0, turned)
    lamp = [dropped for dropped in soft.trace.dropped if np.abs(dropped.corners_px.mean(axis=0) - (80, 400)).max() < 3]
    assert {dropped.why.reason for dropped in lamp} == {"no_bands"}


@pytest.mark.parametrize("turns", [1, 2])
def test_all_is_upright_as_in_the_frame(turns: int) -> None:
    """With whichever corner the quad begins."""
    canvas = Canvas(exposure_us=9966.32)
    canvas.panel(np.roll(PLACE, -turns, axis=0), word(7))
    drawn = draw_steps(taken("likelihood", canvas.frame()))
    expected = np.where(word(7, turns)[..., None], WHITE_CLASS, BLACK_CLASS)
    for column in (2, 3):
        seen = colours(row_of(drawn, 0, column), middles(tile_width(4))).astype(int)
        np.testing.assert_allclose(seen, expected, atol=5)


# ---- From the command line


def write_take(folder: Path, frames: int = 2) -> None:
    camera = CameraInfo(
        width=640,
        height=480,
        row_time_us=ROW_TIME_US,
        frame_length_rows=504,
        exposure_us=SHORT_US,
        transfer="srgb",
        intrinsics=PINHOLE,
    )
    with RecordingWriter(folder, camera=camera, dictionary="DICT_4X4_50", panel=SPEC) as writer:
        for seq in range(5, 5 + frames):
            writer.write(frame(seq=seq), ())


@pytest.fixture(scope="module")
def shelf(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two recordings, of two frames and of one. Only to be read."""
    folder = tmp_path_factory.mktemp("recordings")
    write_take(folder / "one", 2)
    write_take(folder / "two", 1)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("method", ["likelihood", "uemura"])
def test_decode_draws_a_picture_a_frame(ledpi: Run, shelf: Path, tmp_path: Path, method: str) -> None:
    """Named by the frame's number, in a folder that is made; what is printed is what is printed without."""
    arguments = ("decode", "--method", method, "--single-frame", shelf / "one")
    status, output, _ = ledpi(*arguments, "--steps", tmp_path / "new" / "steps")
    assert status == 0
    written = sorted((tmp_path / "new" / "steps").iterdir())
    assert [path.name for path in written] == ["000005.png", "000006.png"]
    for path in written:
        picture = cv2.imread(str(path))
        assert picture is not None
        assert picture.shape[1] == WIDTH
    with_steps, without = ([json.loads(line) for line in text.splitlines()] for text in (output, ledpi(*arguments)[1]))
    for line in with_steps + without:
        line.pop("decode_ms")
    assert with_steps == without
    assert [marker["id"] for marker in with_steps[0]["markers"]] == [7]


def test_several_recordings_have_a_folder_each(ledpi: Run, shelf: Path, tmp_path: Path) -> None:
    """Their frames' numbers may be the same. What cannot be written is one line, with the option and the folder."""
    assert ledpi("decode", "--method", "uemura", shelf, "--steps", tmp_path / "steps")[0] == 0
    written = sorted(str(path.relative_to(tmp_path / "steps")) for path in (tmp_path / "steps").rglob("*.png"))
    assert written == ["one/000005.png", "one/000006.png", "two/000005.png"]
    in_the_way = tmp_path / "steps/one/000005.png/steps"
    status, _, errors = ledpi("decode", shelf / "one", "--steps", in_the_way)
    assert status == 2
    assert errors.splitlines()[-1].startswith(f"ledpi: --steps {in_the_way}: cannot be made: ")


@pytest.mark.slow
def test_snapshot_draws_the_steps_too(ledpi: Run, shelf: Path, tmp_path: Path) -> None:
    """The same picture as decode's, of one frame."""
    out = tmp_path / "snap.png"
    arguments = ("snapshot", shelf / "one", "--frame", "6", "--method", "uemura")
    status, output, _ = ledpi(*arguments, "--steps", "--out", out)
    assert status == 0
    assert "ID 7" in output
    expected = taken("uemura", frame(seq=6))
    seen = cv2.imread(str(out))
    assert seen is not None
    np.testing.assert_array_equal(tile(np.asarray(seen), "g"), tile(draw_steps(expected), "g"))


def test_steps_are_not_drawn_over_what_they_are_drawn_from(ledpi: Run, shelf: Path, tmp_path: Path) -> None:
    """A recording's frames have the very names of the steps; a picture among others may have."""
    take, message = tmp_path / "take", "holds the pictures that are read; must be another folder"
    shutil.copytree(shelf / "one", take)
    (tmp_path / "link").symlink_to(take / "frames")
    sound = {path: path.read_bytes() for path in (take / "frames").iterdir()}
    settings = ("--set", "panels.side_m=0.16", "--set", "camera.row_time_us=33.67")
    for what in (take,), (take / "frames" / "000005.png", *settings):
        for steps in (take / "frames", tmp_path / "link"):
            status, output, errors = ledpi("decode", *what, "--steps", steps)
            assert (status, output, errors) == (2, "", f"ledpi: --steps {steps}: {message}\n")
    assert {path: path.read_bytes() for path in (take / "frames").iterdir()} == sound
