"""Where exactly a lit square's corners are: painted at known sub-pixel places, and asked back."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest
from decode_material import LENS, Canvas, diffuser, drawn, flat, reason, seen_through, square, word

from ledpi.decode.corners.approach import approach_quads
from ledpi.decode.corners.edges import refine_quads
from ledpi.records import Floats, Frame, Intrinsics, Quad, Rejected, Transfer

TOLERANCE_PX = 4.0  # how far off a finder's corners are allowed to be
OFFSETS = [0.0, 0.15, 0.35, 0.5, 0.7, 0.9]


def edges(frame: Frame, rough: Floats, lens: Intrinsics | None = None) -> Quad | Rejected:
    """The whole way from a finder's corners to exact ones."""
    (near,) = approach_quads(frame, rough[None], np.array([TOLERANCE_PX]))
    return near if isinstance(near, Rejected) else refine_quads(frame, near[None], 4, lens)[0]


def corners(frame: Frame, rough: Floats, lens: Intrinsics | None = None) -> Floats:
    found = edges(frame, rough, lens)
    assert isinstance(found, Quad), reason(found)
    return found.corners_px


def nudged(true: Floats, seed: int, by_px: float = 2.0) -> Floats:
    return np.asarray(true + np.random.default_rng(seed).uniform(-by_px, by_px, (4, 2)))


def outward(error: Floats, true: Floats) -> float:
    """How far the sides lie outside of where they are, on average."""
    away = true - true.mean(axis=0)
    away /= np.linalg.norm(away, axis=1)[:, None]
    return float((error * away).sum(axis=1).mean() / math.sqrt(2))


def rms(error: Floats) -> float:
    return float(np.sqrt(np.mean(np.square(error).sum(axis=1))))


def most_bent(straight: Floats) -> float:
    """How far LENS moves the sides off the lines between their ends, at most, from 99 points along each."""
    away = []
    for start, end in zip(straight, np.roll(straight, -1, axis=0), strict=True):
        points = seen_through(LENS, start + (end - start) * np.linspace(0, 1, 101)[:, None])
        along = (points[-1] - points[0]) / np.linalg.norm(points[-1] - points[0])
        away.append(np.abs((points - points[0]) @ [-along[1], along[0]]).max())
    return float(max(away))


def brighter_inside(u: Floats, v: Floats) -> Floats:
    """Each cell from 60 % at its rim to full light in its middle."""
    x, y = 4 * u % 1.0, 4 * v % 1.0
    to_rim = np.minimum(np.minimum(x, 1 - x), np.minimum(y, 1 - y))
    return np.asarray(0.6 + 0.8 * to_rim)


@pytest.mark.parametrize("transfer", ["linear", "srgb"])
@pytest.mark.parametrize("side", [50, 90, 160])
@pytest.mark.parametrize("offset", OFFSETS)
def test_corners_are_exact_to_a_tenth_of_a_pixel(offset: float, side: float, transfer: Transfer) -> None:
    """A blurred, noisy square anywhere between the pixels, from rough corners that are 2 px off."""
    true = square(310 + offset, 240 + 0.37 * offset, side, 7)
    canvas = Canvas(transfer=transfer)
    canvas.panel(true, word(7), profile=flat)
    assert rms(corners(canvas.frame(), nudged(true, 1)) - true) < 0.1



@pytest.mark.parametrize("blur_px", [0.4, 0.7, 1.1])
def test_brightness_that_rises_inward_does_not_pull_the_edge_in(blur_px: float) -> None:
    """The half-height of such a ramp would lie inside; over many places the sides are where they are to 0.05 px."""
    off = []
    for number, offset in enumerate(OFFSETS):
        true = square(310 + offset, 240 + 0.37 * offset, 90, 7)
        canvas = Canvas()
        canvas.panel(true, word(7), profile=brighter_inside, blur_px=blur_px)
        off.append(outward(corners(canvas.frame(number), nudged(true, number)) - true, true))
    assert abs(np.mean(off)) < 0.05


def test_a_small_panel_is_not_measured_too_small() -> None:
    """Where a cell is 7.5 px and the diffuser's fall-off begins at once: still within 0.05 px on average."""
    off = []
    for number, offset in enumerate(OFFSETS):
        true = square(310 + offset, 240 + 0.37 * offset, 30, 7)
        canvas = Canvas()
        canvas.panel(true, word(7), profile=diffuser)
        off.append(outward(corners(canvas.frame(number), nudged(true, number, 1.0)) - true, true))
    assert abs(np.mean(off)) < 0.05


@pytest.mark.parametrize(("side", "percent"), [(13, 1.5), (20, 1.5), (26, 1.0), (50, 0.3), (110, 0.1)])
def test_a_far_panels_size_is_right(side: float, percent: float) -> None:
    """Down to cells of 3.2 px, where blur, gaps and fall-off overlap: on average over places, rolls and walls."""
    off = []
    for number, offset in enumerate(OFFSETS):
        true = square(310 + offset, 240 + 0.37 * offset, side, 15 * number)
        canvas = Canvas(background=0.02 + 0.02 * number)
        canvas.panel(true, word(7), profile=diffuser)
        off.append(outward(corners(canvas.frame(number), nudged(true, number, 0.5)) - true, true))
    assert abs(2 * np.mean(off)) < percent / 100 * side


@pytest.mark.parametrize("smear_px", [3, 5])
def test_a_moving_panel_is_where_it_was_on_average(smear_px: int) -> None:
    """A robot that turns smears the picture sideways within the exposure; its upright sides become ramps."""
    true = square(310.4, 240.2, 100, 6)
    canvas = Canvas()
    canvas.panel(true, word(7))
    canvas.light = cv2.blur(canvas.light, (smear_px, 1))
    assert rms(corners(canvas.frame(), nudged(true, 1)) - true) < 0.25


@pytest.mark.parametrize("side", [26, 70])
def test_the_stated_deviation_is_the_true_one(side: float) -> None:
    """Over places, rolls, words and noise: not half of it, nor three times; panels differ more than these do."""
    rng = np.random.default_rng(side)
    squares, stated = [], []
    for number in range(16):
        true = square(*rng.uniform((250, 180), (390, 300)), side, rng.uniform(-45, 45))
        canvas = Canvas(background=rng.uniform(0.01, 0.08))
        canvas.panel(true, word(int(rng.choice([0, 7, 12, 23]))), gains=rng.uniform(0.85, 1.15, (4, 4)))
        found = edges(canvas.frame(number), nudged(true, number, 0.5))
        assert isinstance(found, Quad), reason(found)
        squares.append(np.square(found.corners_px - true).mean())
        stated.append(found.corner_sigma_px**2)
    assert 0.5 < math.sqrt(np.mean(stated) / np.mean(squares)) < 3.0


def test_cells_of_unlike_brightness_do_not_bend_the_sides() -> None:
    """LEDs differ by a third, and the wall is lit unevenly."""
    true = square(310.4, 240.2, 120, -12)
    canvas = Canvas()
    canvas.light *= np.linspace(0.5, 2.0, 480)[:, None]
    canvas.panel(true, word(12), gains=np.random.default_rng(3).uniform(0.7, 1.3, (4, 4)))
    assert rms(corners(canvas.frame(), nudged(true, 1)) - true) < 0.15


def test_an_oblique_panel_is_as_exact() -> None:
    """A trapezium half as wide as high."""
    true = np.array([[300.3, 180.6], [351.7, 192.2], [352.1, 287.4], [299.8, 301.9]])
    canvas = Canvas()
    canvas.panel(true, word(7))
    assert rms(corners(canvas.frame(), nudged(true, 1)) - true) < 0.15


def test_corners_keep_their_order() -> None:
    """Each comes out as the rough one that was nearest, clockwise from wherever those began."""
    true = square(310.3, 240.6, 80, 20)
    canvas = Canvas()
    canvas.panel(true, word(7))
    found = corners(canvas.frame(), np.roll(true, 2, axis=0))
    assert rms(found - np.roll(true, 2, axis=0)) < 0.15


def test_sides_that_the_lens_bends_are_followed() -> None:
    """Near the picture's corner: knowing the lens, the corners are exact although no side is straight."""
    straight = square(490, 350, 230, 3)
    true = seen_through(LENS, straight)
    canvas = Canvas()
    canvas.panel(straight, word(7), lens=LENS)
    frame = canvas.frame()
    with_lens = edges(frame, nudged(true, 1), LENS)
    assert isinstance(with_lens, Quad)
    assert rms(with_lens.corners_px - true) < 0.12
    assert with_lens.bend_px == pytest.approx(most_bent(straight), rel=0.2)
    assert rms(with_lens.corners_px - true) < rms(corners(frame, nudged(true, 1)) - true)


def test_without_a_lens_nothing_is_bent() -> None:
    """An uncalibrated camera is taken for a pinhole."""
    true = square(310, 240, 80)
    canvas = Canvas()
    canvas.panel(true, word(7))
    found = edges(canvas.frame(), true)
    assert isinstance(found, Quad)
    assert found.bend_px == 0.0


def test_a_saturated_panel_still_has_edges() -> None:
    """Blown-out light carries no bands; its rim is seen where clipping has moved it to, less than a pixel outward."""
    true = square(310.4, 240.2, 80, 7)
    canvas = Canvas()
    canvas.lamp(true, 1.6)
    assert rms(corners(canvas.frame(), nudged(true, 1)) - true) < 1.0


def test_noise_makes_the_edges_less_sure() -> None:
    """The stated deviation grows as the light falls to a twentieth."""
    true = square(310.4, 240.2, 80, 7)
    stated = []
    for light in (0.4, 0.02):
        canvas = Canvas(background=0.003)
        canvas.panel(true, word(7), light=light)
        found = edges(canvas.frame(), true)
        assert isinstance(found, Quad)
        stated.append(found.corner_sigma_px)
    assert stated[1] > 1.5 * stated[0] > 0


def test_a_disc_is_refused() -> None:
    """A round lamp, with the square that fits it best."""
    canvas = Canvas()
    canvas.disc(310, 240, 45)
    assert reason(edges(canvas.frame(), square(310, 240, 80))) == "edges.not_straight"


@pytest.mark.parametrize("rough", [square(310, 240, 75), np.array([[250.0, 215], [390, 215], [390, 262], [250, 262]])])
def test_a_lit_word_is_refused(rough: Floats) -> None:
    """An exit sign is bright and has corners, but no four sides."""
    letters = np.zeros((480, 640), np.uint8)
    cv2.putText(letters, "EXIT", (250, 260), cv2.FONT_HERSHEY_SIMPLEX, 2, 255, 8)
    canvas = Canvas()
    canvas.light = np.maximum(canvas.light, 0.6 / 255 * cv2.GaussianBlur(letters.astype(float), (0, 0), 0.7))
    assert reason(edges(canvas.frame(), rough)) in ("edges.not_straight", "edges.no_edge")


def test_an_even_wall_is_refused() -> None:
    """Where nothing is, noise is not taken for an edge."""
    assert reason(edges(Canvas().frame(), square(310, 240, 75))) in ("edges.not_straight", "edges.no_edge")


def test_a_square_too_small_for_edges_is_refused() -> None:
    """Seven pixels a side are fewer than the profiles across its sides need."""
    canvas = Canvas()
    canvas.panel(square(310, 240, 7), word(7), profile=flat)
    assert reason(refine_quads(canvas.frame(), square(310, 240, 7)[None], 4)[0]) == "edges.too_small"


def test_a_panel_of_four_cells_has_corners() -> None:
    """Two along a side, as dictionaries of one's own may have: its sides alone tell where it is."""
    true = square(300, 200, 100, 5)
    canvas = Canvas()
    canvas.panel(true, drawn("10/01"), profile=flat)
    (quad,) = refine_quads(canvas.frame(), nudged(true, 3, by_px=1.0)[None], 2)
    assert isinstance(quad, Quad)
    np.testing.assert_allclose(quad.corners_px, true, atol=0.3)


def test_several_squares_at_once_are_as_each_alone() -> None:
    """What one candidate leads to does not depend on the others."""
    places = [square(150.3, 150.2, 60, 5), square(420.4, 200.7, 110, -8), square(300, 400, 75)]
    canvas = Canvas()
    for place in places[:2]:
        canvas.panel(place, word(7))
    frame, tolerance = canvas.frame(), np.full(3, TOLERANCE_PX)
    rough = np.stack([nudged(place, 5) for place in places])
    together = approach_quads(frame, rough, tolerance)
    for number, result in enumerate(together):
        (alone,) = approach_quads(frame, rough[number : number + 1], tolerance[:1])
        if number == 2:
            assert reason(result) == reason(alone)
        else:
            assert isinstance(result, np.ndarray)
            assert isinstance(alone, np.ndarray)
            np.testing.assert_allclose(result, alone, atol=1e-6)
    near = np.stack(places)
    refined = refine_quads(frame, near, 4)
    for number, (one, quad) in enumerate(zip(near, refined, strict=True)):
        (alone_quad,) = refine_quads(frame, one[None], 4)
        if isinstance(quad, Quad):
            assert isinstance(alone_quad, Quad)
            np.testing.assert_allclose(quad.corners_px, alone_quad.corners_px, atol=1e-5)
        else:
            assert number == 2
            assert reason(quad) == reason(alone_quad)


def test_a_candidate_whose_sides_are_parallel_is_refused_in_silence() -> None:
    """Its sides cross nowhere; no number comes out of it, and no warning."""
    canvas = Canvas()
    canvas.lamp(square(300, 200, 60))
    flat_quad = np.array([[270.0, 200], [330, 200], [330, 200], [270, 200]])
    folded = np.array([[270.0, 170], [330, 170], [270, 170], [330, 170]])
    for rough in (flat_quad, folded):
        (found,) = approach_quads(canvas.frame(), rough[None], np.array([3.0]))
        assert isinstance(found, Rejected)
