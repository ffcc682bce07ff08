"""What is read of painted frames, from the picture to the ID and the corners: panels as people build and hang them."""

from __future__ import annotations

import dataclasses
import itertools
import math
from itertools import product

import cv2
import numpy as np
import pytest

from ledpi.core.records import Decoded, Floats, Frame, Intrinsics
from ledpi.markers.dictionaries import load_dictionary
from ledpi.pipeline.pipeline import Pipeline
from tests.builders.decode import (
    FRAME_ROWS,
    LENS,
    PINHOLE,
    ROW_TIME_US,
    SHORT_US,
    TRUE_10_MS_US,
    Canvas,
    Profile,
    bare,
    camera_info,
    diffuser,
    flat,
    one_size,
    panel_settings,
    seen_through,
    square,
    word,
)

PERIOD_US = FRAME_ROWS * ROW_TIME_US
EXPOSURES_US = [130.0, 161.6, 270.0, 370.0, 500.0, 640.0, 1000.0, 2000.0, 5000.0, TRUE_10_MS_US]


def pipeline(exposure_us: float, *, stream: bool = False, lens: Intrinsics = PINHOLE) -> Pipeline:
    return Pipeline(camera_info(exposure_us=exposure_us), panel_settings(), intrinsics=lens, stream=stream)


def read(frame: Frame, lens: Intrinsics = PINHOLE) -> Decoded:
    """A frame by itself."""
    return pipeline(frame.exposure_us, lens=lens).decode(frame)


def ids(decoded: Decoded) -> list[int]:
    return [marker.sighting.id for marker in decoded.markers]


def farthest_px(decoded: Decoded, true: Floats) -> float:
    """Of the one panel's corners, which are in its own order."""
    (marker,) = decoded.markers
    return float(np.linalg.norm(marker.sighting.corners_px - true, axis=1).max())


def painted(
    true: Floats, exposure_us: float, *, marker_id: int = 7, profile: Profile = diffuser, seed: int = 0
) -> Frame:
    canvas = Canvas(exposure_us=exposure_us)
    black, white = np.random.default_rng(seed).random(2)
    canvas.panel(true, word(marker_id), profile=profile, phases=(black, white))
    return canvas.frame(seed)


@pytest.mark.parametrize("exposure_us", EXPOSURES_US)
@pytest.mark.parametrize("turn_deg", [3, 40])
def test_one_frame_is_read_at_any_exposure(exposure_us: float, turn_deg: float) -> None:
    """Panels 7 and 42, 70 px wide, from full bands to those that are a tenth deep."""
    for marker_id in (7, 42):
        canvas, true = Canvas(exposure_us=exposure_us), square(310, 240, 70, turn_deg)
        canvas.panel(true, word(marker_id), phases=(0.3, 0.9))
        decoded = read(canvas.frame())
        assert ids(decoded) == [marker_id]
        assert farthest_px(decoded, true) < 0.35


@pytest.mark.parametrize("exposure_us", [SHORT_US, 300.0, TRUE_10_MS_US])
@pytest.mark.parametrize("profile", [flat, one_size, bare])
@pytest.mark.parametrize("side", [90.0, 130.0, 220.0])
def test_however_cells_are_lit(side: float, profile: Profile, exposure_us: float) -> None:
    """Evenly to the panel's edge, with walls between them only, and as spots with next to no light between."""
    true = square(310.3, 240.6, side, 33)
    decoded = read(painted(true, exposure_us, profile=profile, seed=2))
    assert ids(decoded) == [7]
    assert farthest_px(decoded, true) < max(0.35, 0.005 * side)


@pytest.mark.parametrize(
    ("side", "exposure_us"),
    [*product((50, 100, 200, 400), (SHORT_US, TRUE_10_MS_US)), (16, TRUE_10_MS_US), (25, TRUE_10_MS_US)],
)
def test_panels_of_any_size_are_read(side: float, exposure_us: float) -> None:
    """From 6 m (where a short exposure shows too little) to half the picture; far ones from eight frames."""
    true, path = square(310.3, 236.6, side, 8), pipeline(exposure_us, stream=True)
    for seq in range(8 if side < 100 else 1):
        canvas = Canvas(exposure_us=exposure_us)
        canvas.panel(true, word(7), start_us=seq * PERIOD_US)
        decoded = path.decode(canvas.frame(seq, seq=seq))
    assert ids(decoded) == [7]


@pytest.mark.parametrize("exposure_us", [SHORT_US, TRUE_10_MS_US])
@pytest.mark.parametrize("yaw_deg", [60, 75])
@pytest.mark.parametrize("roll_deg", [0, 45, 90])
def test_oblique_panels_are_read(roll_deg: float, yaw_deg: float, exposure_us: float) -> None:
    """Seen from the side at 0.6 m, 16 cm wide, rolled by any angle."""
    turned = square(0, 0, 0.16, roll_deg)
    depth_m = 0.6 + turned[:, :1] * math.sin(math.radians(yaw_deg))
    true = (310.3, 240.6) + 640 * turned * (math.cos(math.radians(yaw_deg)), 1.0) / depth_m
    decoded = read(painted(true, exposure_us, seed=1))
    assert ids(decoded) == [7]
    assert farthest_px(decoded, true) < 0.55


@pytest.mark.parametrize("exposure_us", [SHORT_US, TRUE_10_MS_US])
def test_a_panel_behind_a_lens_is_read(exposure_us: float) -> None:
    """In the picture's corner, where it bends the sides."""
    straight = square(500, 370, 170, 12)
    canvas = Canvas(exposure_us=exposure_us)
    canvas.panel(straight, word(7), lens=LENS)
    decoded = read(canvas.frame(), LENS)
    assert ids(decoded) == [7]
    assert farthest_px(decoded, seen_through(LENS, straight)) < 0.25


def test_several_panels_are_read() -> None:
    """Near and far ones in one frame, and neighbours with half a cell of wall between them."""
    canvas = Canvas()
    canvas.panel(square(120, 130, 160, 7), word(7))
    canvas.panel(square(350, 110, 80, -5), word(23))
    canvas.panel(square(440, 110, 80, -5), word(12))
    canvas.panel(square(400, 350, 60, 30), word(42))
    assert sorted(ids(read(canvas.frame()))) == [7, 12, 23, 42]


@pytest.mark.parametrize("exposure_us", [SHORT_US, 300.0, TRUE_10_MS_US])
@pytest.mark.parametrize("dead", [(0, 0), (0, 3), (1, 2), (3, 1)])
def test_a_panel_with_a_dead_cell_is_read(dead: tuple[int, int], exposure_us: float) -> None:
    """At a corner, along a side, or within; and it is where its other cells are."""
    true, gains = square(310.3, 236.6, 100, 28), np.ones((4, 4))
    gains[dead] = 0.0
    canvas = Canvas(exposure_us=exposure_us)
    canvas.panel(true, word(7), gains=gains, phases=(0.3, 0.7))
    decoded = read(canvas.frame())
    assert ids(decoded) == [7]
    assert farthest_px(decoded, true) < 0.5


@pytest.mark.parametrize("exposure_us", [SHORT_US, 300.0, TRUE_10_MS_US])
@pytest.mark.parametrize("share", [0.04, 0.08, 0.12])
@pytest.mark.parametrize("side", [60.0, 120.0])
def test_a_panel_with_a_hidden_side_is_read(side: float, share: float, exposure_us: float) -> None:
    """Something dark before a strip along its left side; the ID is asked for, from at most four frames."""
    true, path = square(310.4, 240.2, side, 8), pipeline(exposure_us, stream=True)
    for seq in range(4):
        canvas = Canvas(exposure_us=exposure_us)
        canvas.panel(true, word(7), start_us=seq * PERIOD_US, phases=(0.3, 0.7))
        canvas.lamp(hiding(true, share), 0.0)
        decoded = path.decode(canvas.frame(seq, seq=seq))
    assert ids(decoded) == [7]


@pytest.mark.parametrize("exposure_us", [SHORT_US, TRUE_10_MS_US])
@pytest.mark.parametrize("share", [0.04, 0.08, 0.12])
def test_a_stream_has_the_corners_of_a_panel_with_a_hidden_side(share: float, exposure_us: float) -> None:
    """Where the panel ends, not what is seen of it: to half a pixel of 100."""
    true, path = square(310.4, 240.2, 100, 40), pipeline(exposure_us, stream=True)
    for seq in range(5):
        canvas = Canvas(exposure_us=exposure_us)
        canvas.panel(true, word(7), start_us=seq * PERIOD_US, phases=(0.3, 0.7))
        canvas.lamp(hiding(true, share), 0.0)
        decoded = path.decode(canvas.frame(seq, seq=seq))
    assert farthest_px(decoded, true) < 0.5


def hiding(true: Floats, share: float) -> Floats:
    """What hides so much of a panel's left side."""
    (a, b, c, d) = true
    out, up = 0.3 * (a - b), 0.2 * (a - d)
    upper, lower = a + share * (b - a), d + share * (c - d)
    return np.array([a + out + up, upper + up, lower - up, d + out - up])


@pytest.mark.parametrize("around", [0.1, 0.2, 0.3])
@pytest.mark.parametrize("profile", [diffuser, flat])
def test_a_panel_in_a_bright_frame_is_read_where_it_is(profile: Profile, around: float) -> None:
    """A steady frame with a quarter to three quarters of the cells' light, a twentieth of the side wide."""
    true = square(310.4, 240.2, 100, 13)
    canvas = Canvas()
    canvas.lamp(square(310.4, 240.2, 110, 13), around)
    canvas.panel(true, word(7), profile=profile)
    decoded = read(canvas.frame())
    assert ids(decoded) == [7]
    assert farthest_px(decoded, true) < 0.6


def test_a_panel_that_sheets_touch_is_read_where_it_is() -> None:
    """One as bright as the rim of its cells to the left, a brighter one below: to a hundredth."""
    true = square(310.4, 240.2, 110)
    canvas = Canvas(exposure_us=SHORT_US)
    canvas.lamp(square(310.4 - 105, 240.2, 100), 0.28)
    canvas.lamp(square(310.4, 240.2 + 105, 100), 0.6)
    canvas.panel(true, word(7))
    decoded = read(canvas.frame())
    assert ids(decoded) == [7]
    assert farthest_px(decoded, true) < 1.1


def test_a_dim_panel_in_a_bright_room_is_read() -> None:
    """What is next to the panel decides, not what is brightest in the picture."""
    canvas = Canvas(background=0.05)
    canvas.light += np.linspace(0, 0.1, 640)
    canvas.lamp(square(520, 150, 150), 0.95)
    canvas.panel(square(200, 240, 80), word(7), light=0.15)
    assert ids(read(canvas.frame())) == [7]


@pytest.mark.parametrize(("steeper", "smoothing_px"), [(1.0, 0.0), (1.6, 0.0), (1.0, 0.8), (1.6, 0.8)])
def test_bands_of_another_shape_are_read(steeper: float, smoothing_px: float) -> None:
    """Rows that were exposed as long as was said, or for less; smoothed, as by a scaler, or not."""
    frame = painted(square(310.3, 240.6, 70, 25), 160.0 / steeper, seed=3)
    pixels = cv2.GaussianBlur(frame.pixels, (1, 9), 1e-6, None, smoothing_px) if smoothing_px else frame.pixels
    assert ids(read(dataclasses.replace(frame, exposure_us=160.0, pixels=pixels))) == [7]


@pytest.mark.parametrize("phase", [0.1, 0.6])
def test_antiphase_panels_are_read_whichever_class_was_taken_for_black(phase: float) -> None:
    """A panel is its negative half a cycle later, and so it may be seen."""
    settings = panel_settings("panels.phase=antiphase", "panels.black_hz=1250", "panels.white_hz=1250")
    path = Pipeline(camera_info(exposure_us=SHORT_US), settings, intrinsics=PINHOLE, stream=False)
    dictionary = load_dictionary("DICT_4X4_50")
    for marker_id in (0, 1, 2, 4, 5, 6):
        canvas, phases = Canvas(exposure_us=SHORT_US), (phase, phase + 0.5)
        canvas.panel(square(310, 240, 80, 20), dictionary.word(marker_id), spec=settings.spec(), phases=phases)
        assert ids(path.decode(canvas.frame())) == [marker_id]


@pytest.mark.parametrize("exposure_us", [SHORT_US, TRUE_10_MS_US])
@pytest.mark.parametrize("profile", [diffuser, bare])
def test_a_panel_is_followed(profile: Profile, exposure_us: float) -> None:
    """Twelve frames at half a metre a second or so: from the second on it is read in each."""
    path, read_ids = pipeline(exposure_us, stream=True), []
    for seq in range(12):
        canvas, true = Canvas(exposure_us=exposure_us), square(250 + 5 * seq, 240.2, 110, 30)
        canvas.panel(true, word(7), profile=profile, start_us=seq * PERIOD_US)
        decoded = path.decode(canvas.frame(seq, seq=seq))
        read_ids.append(ids(decoded))
    assert read_ids[1:] == [[7]] * 11
    assert farthest_px(decoded, true) < 0.3


@pytest.mark.parametrize("exposure_us", [SHORT_US, TRUE_10_MS_US])
def test_a_panel_among_many_steady_squares_is_read_in_a_stream(exposure_us: float) -> None:
    """Sixty of them: each frame looks at a few, and the panel has its turn within eight frames."""
    path, read_ids = pipeline(exposure_us, stream=True), []
    for seq in range(8):
        canvas = Canvas(exposure_us=exposure_us)
        for x, y in itertools.product(range(40, 640, 62), range(40, 480, 66)):
            if math.dist((x, y), (310, 240)) > 90:
                canvas.lamp(square(x, y, 24, x % 30), 0.5)
        canvas.panel(square(310.3, 240.6, 80, 12), word(7), start_us=seq * PERIOD_US)
        read_ids.append(ids(path.decode(canvas.frame(seq, seq=seq))))
    assert [7] in read_ids


# ---- What is not read


@pytest.mark.parametrize("exposure_us", [SHORT_US, 202.0])
def test_two_cells_of_a_panel_nearby_are_no_panel(exposure_us: float) -> None:
    """One of each class, side by side, is a cell off word 37, which may be corrected but is no fault here."""
    path, halves = pipeline(exposure_us), np.repeat([False, True], 8).reshape(4, 4)
    for seed, side in itertools.product(range(6), (60, 100)):
        canvas, phases = Canvas(exposure_us=exposure_us), np.random.default_rng(seed).random(2)
        true = square(310, 240, side, 20 + 5 * seed)
        canvas.panel(true, np.rot90(halves, seed), light=0.3, profile=flat, phases=(phases[0], phases[1]))
        assert path.decode(canvas.frame(seed)).markers == ()


@pytest.mark.parametrize("exposure_us", [SHORT_US, 300.0, TRUE_10_MS_US])
@pytest.mark.parametrize("columns", [(0, 2), (1, 3), (0, 3)])
def test_columns_of_a_panel_are_none(columns: tuple[int, int], exposure_us: float) -> None:
    """The others are dark: two or three columns are no panel, turned away by however much."""
    lit = np.zeros((4, 4))
    lit[:, columns[0] : columns[1]] = 1.0
    for seed in range(4):
        canvas, phases = Canvas(exposure_us=exposure_us), np.random.default_rng(seed).random(2)
        canvas.panel(square(310.3, 240.6, 130, 9 * seed), word(7), gains=lit, phases=(phases[0], phases[1]))
        assert read(canvas.frame(seed)).markers == ()


@pytest.mark.parametrize("exposure_us", [SHORT_US, 640.0, TRUE_10_MS_US])
def test_lamps_discs_and_signs_are_no_panels(exposure_us: float) -> None:
    """A square, a round one, one with panes, and a lit word, none of which blinks."""
    panes = np.random.default_rng(2).uniform(0.3, 1.0, (4, 4))
    letters = np.zeros((480, 640), np.uint8)
    cv2.putText(letters, "EXIT", (60, 420), cv2.FONT_HERSHEY_SIMPLEX, 2, 255, 8)
    for seed in range(4):
        canvas = Canvas(exposure_us=exposure_us)
        canvas.lamp(square(120, 120, 100, 11 * seed), 0.4)
        canvas.disc(320, 120, 45)
        canvas.lamp(
            square(500, 140, 110, 7), 0.4, profile=lambda u, v: panes[(4 * v).astype(int) % 4, (4 * u).astype(int) % 4]
        )
        canvas.light = np.maximum(canvas.light, 0.6 / 255 * cv2.GaussianBlur(letters.astype(float), (0, 0), 0.7))
        assert read(canvas.frame(seed)).markers == ()


@pytest.mark.parametrize("exposure_us", [SHORT_US, TRUE_10_MS_US])
def test_a_panel_that_is_gone_is_not_read(exposure_us: float) -> None:
    """After four frames of it a lamp is in its place."""
    true, path = square(310.4, 240.2, 100, 10), pipeline(exposure_us, stream=True)
    seen = []
    for seq in range(8):
        canvas = Canvas(exposure_us=exposure_us)
        if seq < 4:
            canvas.panel(true, word(7), start_us=seq * PERIOD_US)
        else:
            canvas.lamp(true, 0.4, profile=diffuser)
        seen.append(ids(path.decode(canvas.frame(seq, seq=seq))))
    assert seen == [[7]] * 4 + [[]] * 4
