"""Exposures so short that dark bands cut panels into pieces: squares are found by the lattice of their cells."""

from __future__ import annotations

import dataclasses
import itertools
import math

import cv2
import numpy as np
import pytest
from decode_material import (
    LENS,
    PINHOLE,
    ROW_TIME_US,
    SHORT_US,
    SPEC,
    Canvas,
    camera_info,
    flat,
    one_size,
    panel_settings,
    seen_through,
    square,
    word,
)
from evidence_reference import word_log_likelihoods

from ledpi.decode.cells import CellSamples, sample_cells
from ledpi.decode.corners.approach import NOT_STRAIGHT
from ledpi.decode.corners.sides import as_points
from ledpi.decode.evidence.believed import believed_bands
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.evidence.single_frame import single_evidence
from ledpi.decode.evidence.waves import bands_of
from ledpi.decode.finding.find import Candidate
from ledpi.decode.identify import soft
from ledpi.decode.identify.codebook import Codebook
from ledpi.decode.striped.around import rectangles_around, smallest_square_around
from ledpi.decode.striped.band_light import Bands
from ledpi.decode.striped.find_striped import StripedFinder
from ledpi.decode.striped.fitted_square import square_near
from ledpi.decode.striped.lattice import unlike_a_square
from ledpi.decode.striped.light_window import Window
from ledpi.decode.striped.steady import is_steady
from ledpi.decode.striped.striped import fitted_squares, striped_near, striped_squares
from ledpi.dictionaries import load_dictionary
from ledpi.geometry import quad_side
from ledpi.pipeline import Pipeline
from ledpi.records import BandShape, Floats, Frame, HiddenSide, Intrinsics, Quad, Rejected
from ledpi.tone import linear_light
from ledpi.trace import Trace

SMALLEST_PX = 8.0


def squares(frame: Frame) -> list[Floats]:
    """Corners of all squares in a picture."""
    finder = StripedFinder(640, 480, [SPEC], SMALLEST_PX)
    candidates, _ = finder.find(frame)
    found = striped_squares(frame, candidates, 4, [SPEC], finder.stripe_rows(frame))
    return [result.corners_px for _, result in found if isinstance(result, Quad)]


@pytest.mark.parametrize("side", [40.0, 80.0, 160.0])
def test_cells_of_one_size_end_where_their_light_does(side: float) -> None:
    """Not half a wall further out, which is 0.9 % of the side: 1.4 px of 160."""
    true = square(310.4, 240.2, side, 8)
    canvas = Canvas(exposure_us=SHORT_US)
    canvas.panel(true, word(7), phases=(0.3, 0.7), profile=one_size)
    (found,) = squares(canvas.frame())
    assert np.sqrt(np.square(found - true).mean()) < 0.12


def four_leds(u: Floats, v: Floats) -> Floats:
    """Cells with walls on a lattice, each lit by four LEDs that show through the diffuser."""
    x, y = 4 * u % 1.0, 4 * v % 1.0
    inner = np.minimum(np.abs(4 * u - np.clip(np.round(4 * u), 1, 3)), np.abs(4 * v - np.clip(np.round(4 * v), 1, 3)))
    across, down = (np.exp(-(((w % 0.5 - 0.25) / 0.12) ** 2) / 2) for w in (x, y))
    return np.asarray((0.2 + across * down) / 1.2 * (inner > 0.03))


@pytest.mark.parametrize("side", [80.0, 170.0])
def test_the_size_of_cells_that_are_dim_along_their_borders_is_less_sure(side: float) -> None:
    """Whether the light ends there, or only gets less, is not told: the deviation reaches to where the lattice ends."""
    true = square(310.4, 240.2, side, 8)
    canvas = Canvas(exposure_us=SHORT_US)
    canvas.panel(true, word(7), phases=(0.3, 0.7), profile=four_leds)
    found = fitted(canvas.frame(), true)
    off_px = (quad_side(found.corners_px.tolist()) - side) / 2
    assert abs(off_px) < 2.5 * found.size_sigma_px


def fitted(frame: Frame, near: Floats) -> Quad:
    found = square_near(frame, as_points(near), 4, [SPEC], None)
    assert isinstance(found, Quad)
    return found


def striped(corners: Floats, marker_id: int, phases: tuple[float, float], exposure_us: float = SHORT_US) -> Frame:
    canvas = Canvas(exposure_us=exposure_us)
    canvas.panel(corners, word(marker_id), phases=phases)
    return canvas.frame()


def worst_corner(found: Floats, true: Floats) -> float:
    """Of the four, in pixels; found corners may begin with any."""
    return min(float(np.linalg.norm(np.roll(found, turn, axis=0) - true, axis=1).max()) for turn in range(4))


@pytest.mark.parametrize("turn_deg", [1, 20, 45])
@pytest.mark.parametrize("side", [52, 130, 200])
@pytest.mark.parametrize("phase", [0.0, 0.4, 0.8])
def test_a_panel_in_pieces_is_one_square(side: float, turn_deg: float, phase: float) -> None:
    """At 150 µs whole rows of cells are dark; still there is the panel's square, to 0.5 % of its side, and no other."""
    true = square(310.3, 240.6, side, turn_deg)
    (found,) = squares(striped(true, 7, (phase, 3 * phase + 0.4)))
    assert worst_corner(found, true) < 0.005 * side


@pytest.mark.parametrize("lying", [False, True])
@pytest.mark.parametrize("phase", [0.0, 0.2, 0.4, 0.6, 0.8])
def test_a_panel_that_is_turned_far_away_is_found(phase: float, lying: bool) -> None:
    """By 70° about an axis that stands or lies, at 0.6 m: 60 px by 195 px; of the latter a band hides whole rows."""
    half = 0.08 * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    depth_m = 0.6 + half[:, :1] * math.sin(math.radians(70))
    away = PINHOLE.fx * half * (math.cos(math.radians(70)), 1.0) / depth_m
    true = (310.3, 240.6) + (away[:, ::-1] * (-1.0, 1.0) if lying else away)
    (found,) = squares(striped(true, 7, (phase, 3 * phase + 0.4)))
    assert worst_corner(found, true) < (1.5 if lying else 0.5)


@pytest.mark.parametrize("side", [60, 120])
def test_a_side_that_is_dark_all_along_is_found(side: float) -> None:
    """Both classes switch off where the panel begins: its first 1.5 rows of light at 60 px come a band further down."""
    true = square(310, 240, side)
    top_s = true[0, 1] * ROW_TIME_US * 1e-6
    off = (0.5 - 1250 * top_s, 0.5 - 2450 * top_s)
    (found,) = squares(striped(true, 42, off))
    assert worst_corner(found, true) < 0.005 * side


@pytest.mark.parametrize("lens", [PINHOLE, LENS])
def test_a_followed_panel_is_fitted_to_a_quarter_of_a_pixel(lens: Intrinsics) -> None:
    """From corners that are 2 % of the side off; before a lens that bends its sides, too, and beside bright walls."""
    true = square(250, 180, 110, 12)
    canvas = Canvas(exposure_us=SHORT_US, background=0.08)
    canvas.panel(true, word(7), phases=(0.2, 0.7), lens=lens if any(lens.distortion) else None)
    seen = seen_through(lens, true) if any(lens.distortion) else true
    off = 2.0 * np.array([[1, -1], [-1, 1], [1, 1], [0, -1.0]])
    (quad,) = striped_near(canvas.frame(), [seen + off], 4, [SPEC], lens)
    assert isinstance(quad, Quad)
    assert np.linalg.norm(quad.corners_px - seen, axis=1).max() < 0.25
    assert quad.corner_sigma_px < 0.1


@pytest.mark.parametrize("side", [0, 1, 2, 3])
@pytest.mark.parametrize("hidden", [0.02, 0.05, 0.1])
def test_a_side_that_something_hides_is_where_the_lattice_ends(hidden: float, side: int) -> None:
    """A dark strip before it, from corners off by a few pixels; without the light there the others show where it is."""
    true = square(310, 240, 104, 12)
    around = np.roll(true, -side, axis=0)
    down = (around[3] - around[0]) * hidden
    canvas = Canvas(exposure_us=SHORT_US)
    canvas.panel(true, word(7), phases=(0.2, 0.7))
    canvas.lamp(np.array([around[0] - 3 * down, around[1] - 3 * down, around[1] + down, around[0] + down]), 0.02)
    off = 2.0 * np.array([[1, -1], [-1, 1], [1, 1], [0, -1.0]])
    (quad,) = striped_near(canvas.frame(), [true + off], 4, [SPEC], PINHOLE)
    assert isinstance(quad, Quad)
    assert worst_corner(quad.corners_px, true) < 0.4
    assert quad.bands is not None
    assert hidden < 0.05 or quad.bands.hidden == HiddenSide(side, 0.15)
    assert quad.bands.white.tolist() == word(7).ravel().tolist()


@pytest.mark.parametrize("side_px", [20.0, 35.0, 104.0])
def test_no_side_of_a_whole_panel_is_hidden(side_px: float) -> None:
    """However small: a fit of less than all of it may be a little better by chance."""
    true = square(310.3, 240.1, side_px, 12)
    (quad,) = striped_near(striped(true, 7, (0.2, 0.7), SHORT_US), [true + 0.3], 4, [SPEC], PINHOLE)
    assert isinstance(quad, Quad)
    assert quad.bands is not None
    assert quad.bands.hidden is None


@pytest.mark.parametrize(("cells", "share"), [(4, 0.15), (5, 0.15), (6, 0.125), (7, 0.75 / 7)])
def test_of_a_hidden_side_a_quarter_of_each_cell_tells_its_class(cells: int, share: float) -> None:
    """So of small cells less is left out than may be hidden."""
    true = square(310, 240, 180, 12)
    down = (true[3] - true[0]) * 0.09
    canvas = Canvas(exposure_us=SHORT_US)
    canvas.panel(true, np.indices((cells, cells)).sum(axis=0) % 3 == 0, phases=(0.2, 0.7), profile=flat)
    canvas.lamp(np.array([true[0] - 3 * down, true[1] - 3 * down, true[1] + down, true[0] + down]), 0.02)
    (quad,) = striped_near(canvas.frame(), [true + 1.0], cells, [SPEC], PINHOLE)
    assert isinstance(quad, Quad)
    assert quad.bands is not None
    assert quad.bands.hidden == HiddenSide(0, pytest.approx(share))
    samples = sample_cells(canvas.frame(), quad, cells)
    assert isinstance(samples, CellSamples)
    assert samples.valid is not None
    told = samples.valid.mean(axis=1).reshape(cells, cells)
    assert 0.2 < told[0].min() <= told[0].max() < 0.5
    assert told[1:].min() == 1.0


def test_a_followed_panel_that_is_gone_is_not_found() -> None:
    """A wall, and a lamp in its place."""
    canvas = Canvas(exposure_us=SHORT_US)
    canvas.lamp(square(200, 240, 100, 10))
    near = [square(200, 240, 100, 10), square(450, 240, 100)]
    assert [type(result) for result in striped_near(canvas.frame(), near, 4, [SPEC])] == [Rejected, Rejected]


def test_a_lamp_is_no_striped_square() -> None:
    """A steady light of the same shape has no bands."""
    canvas = Canvas(exposure_us=SHORT_US)
    canvas.lamp(square(310, 240, 100, 10))
    assert squares(canvas.frame()) == []


def test_how_high_dark_bands_are() -> None:
    """Half a period of 1250 Hz and half a one of 2450 Hz, in rows of 33.67 µs: 11.88 + 6.06; none at 10 ms."""
    finder = StripedFinder(640, 480, [SPEC], SMALLEST_PX)
    canvas = Canvas(exposure_us=SHORT_US)
    assert finder.stripe_rows(canvas.frame()) == pytest.approx(17.94, abs=0.01)
    assert finder.stripe_rows(Canvas().frame()) == 0


def test_bands_that_bend_edges_without_cutting_panels() -> None:
    """At 640 µs both classes' contrast is a half; at 1.2 ms 1250 Hz has 2/3, 2450 Hz next to none; at 5 ms both."""
    finder = StripedFinder(640, 480, [SPEC], SMALLEST_PX)
    rows = [finder.bent_rows(Canvas(exposure_us=exposure_us).frame()) for exposure_us in (150.0, 640.0, 1200.0, 5000.0)]
    assert rows == pytest.approx([0.0, 11.88 + 6.06, 11.88, 0.0], abs=0.01)


def test_squares_whose_edges_are_bent_by_bands_are_fitted_anew() -> None:
    """At 640 µs: one that is half a pixel off, and one that was refused as not straight."""
    true = square(310.3, 240.6, 80, 12)
    frame = striped(true, 7, (0.3, 0.9), 640.0)
    off = Quad(corners_px=true + 0.5 * np.array([[1, 0], [0, 1], [-1, 0], [0, -1]]), corner_sigma_px=0.05)
    for _, fit in fitted_squares(frame, [(true + 3, off), (true + 3, NOT_STRAIGHT)], 4, [SPEC], 17.9):
        assert isinstance(fit, Quad)
        assert worst_corner(fit.corners_px, true) < 0.1


def test_of_a_square_that_seems_hidden_the_more_exact_corners_are_believed() -> None:
    """What bands do at its rim may look as if something hid it; if something does, the whole picture fits badly."""
    true = square(310.3, 240.6, 80, 12)
    frame = striped(true, 7, (0.3, 0.9), 640.0)
    hidden, guessed = (Quad(corners_px=true + 1.0, corner_sigma_px=sigma, seen_px=true) for sigma in (1e-3, 2.0))
    (_, same), (_, fit) = fitted_squares(frame, [(true, hidden), (true, guessed)], 4, [SPEC], 17.9)
    assert same is hidden
    assert isinstance(fit, Quad)
    assert worst_corner(fit.corners_px, true) < 0.1


def test_what_does_not_blink_is_not_searched_for_bands() -> None:
    """At 500 µs, of a panel and a square that is twice as bright as the wall."""
    panel, lamp = square(180, 240, 90, 12), square(450, 240, 90, 12)
    canvas = Canvas(exposure_us=500.0)
    canvas.panel(panel, word(7), phases=(0.3, 0.9))
    canvas.lamp(lamp, 0.06)
    finder = StripedFinder(640, 480, [SPEC], SMALLEST_PX)
    finder.find(frame := canvas.frame())
    candidates = [Candidate(corners=at, side_px=90.0, tolerance_px=3.0) for at in (panel, lamp)]
    assert finder.blinks(frame, candidates, 4) == [True, False]


def test_the_smallest_square_around_one_with_its_corner_cut_off() -> None:
    """It is the square again, whichever way around its outline is given."""
    outline = np.array([[0.0, 0], [10, 0], [10, 7], [7, 10], [0, 10]])
    whole = np.array([[0.0, 0], [10, 0], [10, 10], [0, 10]])
    for given in (outline, outline[::-1]):
        found = smallest_square_around(given)
        assert found is not None
        np.testing.assert_allclose(found, whole, atol=1e-9)


def test_rectangles_around_a_square_with_two_corners_cut_off() -> None:
    """Of one that is turned by 30°: it is around what is left of it, along the sides; another lies along the cuts."""
    c, s = 3**0.5 / 2, 0.5
    turned = np.array([[c, s], [-s, c]])
    left = np.array([[0, 0], [60, 0], [100, 40], [100, 100], [40, 100], [0, 60.0]]) @ turned + 300
    whole = np.array([[0, 0], [100, 0], [100, 100], [0, 100.0]]) @ turned + 300
    along, across = rectangles_around(left)
    assert worst_corner(along, whole) < 1e-6
    assert worst_corner(across, whole) > 10


@pytest.mark.parametrize(("steeper", "smoothing_rows2"), [(1.0, 0.0), (1.6, 0.0), (1.0, 0.6), (1.6, 0.6)])
def test_the_shape_of_bands_is_told(steeper: float, smoothing_rows2: float) -> None:
    """Rows that were exposed as long as was said, or for less; smoothed, as by a scaler, or not. Either way it is read.

    A band's edge is as wide as the exposure and what smooths it; which of both is which is hardly seen.
    """
    true = square(310.3, 240.6, 70, 25)
    frame = striped(true, 7, (0.3, 0.9), 160.0 / steeper)
    smoothed = blurred_down(frame, smoothing_rows2)
    pipeline = Pipeline(
        dataclasses.replace(camera_info(), exposure_us=160.0), panel_settings(), intrinsics=PINHOLE, stream=False
    )
    trace = Trace()
    decoded = pipeline.decode(dataclasses.replace(smoothed, exposure_us=160.0), trace)
    assert [marker.sighting.id for marker in decoded.markers] == [7]
    (look,) = trace.looks
    assert look.quad.bands is not None
    assert look.quad.bands.shape is not None
    assert edge_rows2(look.quad.bands.shape) == pytest.approx(
        edge_rows2(BandShape(exposure_us=160.0 / steeper, smoothing_rows2=smoothing_rows2)), rel=0.12
    )


@pytest.mark.parametrize("exposure_us", [130.0, 161.6, 270.0, 500.0])
def test_what_is_seen_of_bands_is_where_a_look_finds_them(exposure_us: float) -> None:
    """Classes of all cells, and phases to 3°: a look by square waves in these phases finds none that is later."""
    true = square(310.3, 240.6, 70, 25)
    frame = striped(true, 7, (0.3, 0.9), exposure_us)
    (quad,) = striped_near(frame, [true], 4, [SPEC])
    assert isinstance(quad, Quad)
    assert quad.bands is not None
    np.testing.assert_array_equal(quad.bands.white, word(7).ravel())
    samples, bands = sample_cells(frame, quad, 4), bands_of(quad.bands, frame, SPEC)
    assert isinstance(samples, CellSamples)
    believed = believed_bands(samples, frame, SPEC, quad.bands.white, bands)
    evidence = single_evidence(samples, frame, SPEC, believed=believed)
    assert isinstance(evidence, Evidence)
    found = word_log_likelihoods(evidence, quad.bands.white[None].astype(np.float32))[1][0]
    assert np.degrees(np.abs(np.arctan2(found[1::2], found[::2]))).max() < 3


def edge_rows2(bands: BandShape) -> float:
    """Variance of what an edge is smoothed by: of a box that is as long as the exposure, and the rest."""
    return (bands.exposure_us / ROW_TIME_US) ** 2 / 12 + bands.smoothing_rows2


def blurred_down(frame: Frame, rows2: float) -> Frame:
    """Its light smoothed along columns, by a normal curve of this variance."""
    if rows2 == 0.0:
        return frame
    light = cv2.LUT(frame.pixels, linear_light(frame.transfer, mark_saturated=False))
    light = cv2.GaussianBlur(light, (1, 9), sigmaX=1e-6, sigmaY=rows2**0.5)
    table = linear_light(frame.transfer, mark_saturated=False)
    return dataclasses.replace(frame, pixels=np.searchsorted((table[1:] + table[:-1]) / 2, light).astype(np.uint8))


@pytest.mark.parametrize("blinking", [True, False])
@pytest.mark.parametrize("side", [25, 60])
def test_patches_of_other_brightness_are_told_from_cells_that_blink(blinking: bool, side: float) -> None:
    """A panel, and the same with each cell of another gain and so quick that every exposure sees whole cycles."""
    true = square(310.3, 240.6, side, 10)
    quick = dataclasses.replace(SPEC, black_hz=1e6 / SHORT_US, white_hz=2e6 / SHORT_US)
    canvas = Canvas(exposure_us=SHORT_US)
    gains = np.random.default_rng(3).uniform(0.1, 1, (4, 4))
    canvas.panel(true, word(7), spec=SPEC if blinking else quick, gains=gains)
    window = Window.around(canvas.frame(), as_points(true[None]), 8.0)
    corners = window.within(as_points(true))
    bands = Bands.at(window, corners, 4, [SPEC])
    assert bands is not None
    assert is_steady(window, corners, 4, bands) is not blinking


def test_perspective_of_a_turned_square() -> None:
    """Seen from four sides away, turned by 60°, it is like a square; with its far side twice as short it is not."""
    c, s = 0.5, 0.75**0.5
    points = np.array([[x * c, y, 4 + x * s] for x, y in ((-0.5, -0.5), (0.5, -0.5), (0.5, 0.5), (-0.5, 0.5))])
    seen = 600 * points[:, :2] / points[:, 2:]
    drawn = np.array([[-40.0, -80], [40, -40], [40, 40], [-40, 80]])
    assert unlike_a_square(as_points(seen[None]), 600.0)[0] < 0.01
    assert unlike_a_square(as_points(drawn[None]), 600.0)[0] > 0.3


@pytest.mark.parametrize("exposure_us", [150.0, 270.0, 370.0, 500.0])
@pytest.mark.parametrize("side", [70, 150])
def test_classes_of_cells_where_one_shows_half_as_much_as_the_other(exposure_us: float, side: float) -> None:
    """At 370 µs the black class's bands are full, the white class's a tenth deep and at half the light."""
    true = square(310, 240, side, 30)
    frame = striped(true, 7, (0.3, 0.9), exposure_us)
    window = Window.around(frame, as_points(true[None]), 0.1 * side)
    bands = Bands.at(window, window.within(as_points(true)), 4, [SPEC])
    assert bands is not None
    np.testing.assert_array_equal(bands.white, word(7).ravel())
    assert bands.explained > 0.97


def test_a_square_that_has_gone_astray_is_no_larger_than_the_picture() -> None:
    """Its window is averaged down by 640 // 70 pixels at most: what bands show is averaged over as many rows."""
    window = Window.around(Canvas(exposure_us=370.0).frame(), as_points(square(310, 240, 1e7, 30)[None]), 3.0)
    assert window.shrink == 9


def test_a_panel_of_mostly_steady_cells_is_whole_once_dark_bands_are_bridged() -> None:
    """At 400 µs white cells are nearly steady; the bands that cut the black ones are 11.88 rows of 33.67 µs high."""
    frame = striped(square(310, 240, 150, 3), 7, (0.3, 0.9), 400.0)
    finder = StripedFinder(640, 480, [SPEC], SMALLEST_PX)
    through_black = np.s_[190:255, 366]  # two cells of the last column
    assert frame.pixels[through_black].min() < 60
    assert finder.bridged(frame).pixels[through_black].min() > 120


@pytest.mark.parametrize("exposure_us", [130.0, 161.6, 270.0, 370.0, 400.0, 500.0, 640.0, 1000.0, 2000.0, 5000.0])
@pytest.mark.parametrize("turn_deg", [3, 40])
def test_one_frame_is_read_at_any_exposure(exposure_us: float, turn_deg: float) -> None:
    """Panels 7 and 42, 70 px wide, from full bands to those that are a tenth deep."""
    pipeline = Pipeline(
        dataclasses.replace(camera_info(), exposure_us=exposure_us), panel_settings(), intrinsics=PINHOLE, stream=False
    )
    for marker_id in (7, 42):
        frame = striped(square(310, 240, 70, turn_deg), marker_id, (0.3, 0.9), exposure_us)
        assert [marker.sighting.id for marker in pipeline.decode(frame).markers] == [marker_id]


@pytest.mark.parametrize("phase", [0.1, 0.6])
def test_antiphase_panels_are_read_whichever_class_was_taken_for_black(phase: float) -> None:
    """A panel is its negative half a cycle later, and so it may be seen."""
    same = ("panels.phase=antiphase", "panels.black_hz=1250", "panels.white_hz=1250")
    info, settings = dataclasses.replace(camera_info(), exposure_us=SHORT_US), panel_settings(*same)
    pipeline = Pipeline(info, settings, intrinsics=PINHOLE, stream=False)
    dictionary = load_dictionary("DICT_4X4_50")
    for marker_id in dictionary.readable_ids("antiphase")[:6]:
        canvas, phases = Canvas(exposure_us=SHORT_US), (phase, phase + 0.5)
        canvas.panel(square(310, 240, 80, 20), dictionary.word(marker_id), spec=settings.spec(), phases=phases)
        assert [marker.sighting.id for marker in pipeline.decode(canvas.frame()).markers] == [marker_id]


@pytest.mark.parametrize(
    ("side", "turn_deg", "white", "phase"), [(24, 3, True, 0.2), (28, 3, True, 0.3), (27, 0, False, 0.4)]
)
def test_a_panel_of_one_class_is_no_word(side: float, turn_deg: float, white: bool, phase: float) -> None:
    """Its cells are as high as its bright bands: whole rows of them are dark, as if of the class that is dark there."""
    true = square(310.3, 240.6, side, turn_deg)
    canvas = Canvas(exposure_us=SHORT_US)
    canvas.panel(true, np.full((4, 4), white), phases=(phase, phase))
    frame, book = canvas.frame(), Codebook.build(list(range(50)), load_dictionary("DICT_4X4_50"), SPEC)
    samples = sample_cells(frame, Quad(corners_px=true, corner_sigma_px=0.05), 4)
    assert isinstance(samples, CellSamples)
    assert isinstance(soft.read_word(samples, frame, book), Rejected)


@pytest.mark.parametrize("exposure_us", [SHORT_US, 202.0])
def test_two_cells_of_a_panel_nearby_are_no_panel(exposure_us: float) -> None:
    """One of each class, side by side, is a cell off word 37, which may be corrected but is no fault here."""
    info = dataclasses.replace(camera_info(), exposure_us=exposure_us)
    pipeline = Pipeline(info, panel_settings(), intrinsics=PINHOLE, stream=False)
    halves = np.repeat([False, True], 8).reshape(4, 4)
    for seed, side in itertools.product(range(6), (60, 100)):
        canvas, phases = Canvas(exposure_us=exposure_us), np.random.default_rng(seed).random(2)
        true = square(310, 240, side, 20 + 5 * seed)
        canvas.panel(true, np.rot90(halves, seed), light=0.3, profile=flat, phases=(phases[0], phases[1]))
        assert pipeline.decode(canvas.frame(seed)).markers == ()
