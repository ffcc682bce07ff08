"""A panel's corners are painted at known sub-pixel places, and asked back; and what is no panel is refused."""

from __future__ import annotations

import math

import cv2
import numpy as np
import pytest

from ledpi.core.records import Floats, Frame, Intrinsics, PanelSpec, Quad, Rejected, Transfer
from ledpi.decode.locate import Locator
from tests.builders.decode import (
    LENS,
    SHORT_US,
    SPEC,
    TRUE_10_MS_US,
    Canvas,
    Profile,
    bare,
    diffuser,
    flat,
    one_size,
    reason,
    seen_through,
    square,
    word,
)

OFFSETS = [0.0, 0.15, 0.35, 0.5, 0.7, 0.9]


def located(frame: Frame, near: Floats, lens: Intrinsics | None = None, cells: int = 4) -> Quad:
    found = Locator(cells, (SPEC,), lens).localise(frame, near)
    assert isinstance(found, Quad), reason(found)
    return found


def variance_px2(found: Quad) -> float:
    """Variance of a corner's coordinate, in the mean."""
    assert found.covariance_px2 is not None
    return float(np.trace(found.covariance_px2)) / 8


def nudged(true: Floats, seed: int, by_px: float = 2.0) -> Floats:
    return np.asarray(true + np.random.default_rng(seed).uniform(-by_px, by_px, (4, 2)))


def error_of(found: Quad, true: Floats) -> Floats:
    """(4, 2) in the order of the true corners, whichever of them the found ones begin with."""
    return min((np.roll(found.corners_px, turn, axis=0) - true for turn in range(4)), key=rms)


def outward(error: Floats, true: Floats) -> float:
    """Distance by which the sides lie outside of where they are, on average."""
    away = true - true.mean(axis=0)
    away /= np.linalg.norm(away, axis=1)[:, None]
    return float((error * away).sum(axis=1).mean() / math.sqrt(2))


def rms(error: Floats) -> float:
    """Root of the mean square of the corners' distances."""
    return float(np.sqrt(np.mean(np.square(error).sum(axis=1))))


def test_a_lattice_half_a_cell_off_is_not_taken_for_a_hidden_side() -> None:
    """In any of 24 directions: all but one at most are found where they are, as the lattice beside it fits better."""
    true, far = square(300, 240, 80), 0
    canvas = Canvas()
    canvas.panel(true, word(7))
    frame = canvas.frame()
    for turn in np.arange(24) * (2 * math.pi / 24):
        found = Locator(4, (SPEC,), None).localise(frame, true + 9.5 * np.array([math.cos(turn), math.sin(turn)]))
        far += isinstance(found, Quad) and rms(error_of(found, true)) > 1.0
    assert far <= 1


def test_a_lattice_a_whole_cell_off_is_not_taken_for_a_panel_with_a_dark_side() -> None:
    """Before a wall a third as bright, its light passes for four dim cells: the lattice beside them fits better."""
    true = square(300, 240, 100, 20)
    canvas = Canvas(background=0.1)
    canvas.panel(true, word(7))
    a_cell = (true[1] - true[0]) / 4
    found = Locator(4, (SPEC,), None).localise(canvas.frame(), true - a_cell)
    assert isinstance(found, Quad)
    assert rms(error_of(found, true)) < 0.1


@pytest.mark.parametrize("transfer", ["linear", "srgb"])
@pytest.mark.parametrize("side", [50, 160, 300])
@pytest.mark.parametrize("offset", OFFSETS[:3:2])
def test_corners_are_exact_to_a_tenth_of_a_pixel(offset: float, side: float, transfer: Transfer) -> None:
    """A blurred, noisy panel anywhere between the pixels, from rough corners that are 2 px off; of 300 px nearly."""
    true = square(310 + offset, 240 + 0.37 * offset, side, 7)
    canvas = Canvas(transfer=transfer)
    canvas.panel(true, word(7))
    assert rms(error_of(located(canvas.frame(), nudged(true, 1)), true)) < (0.1 if side < 300 else 0.16)


@pytest.mark.parametrize("profile", [flat, one_size, bare])
@pytest.mark.parametrize("exposure_us", [SHORT_US, 640.0, TRUE_10_MS_US])
def test_however_cells_are_lit(exposure_us: float, profile: Profile) -> None:
    """Evenly, with walls between them only, as spots; LEDs differ by a third, and the wall is lit unevenly."""
    true = square(310.4, 240.2, 110, 20)
    canvas = Canvas(exposure_us=exposure_us)
    canvas.light *= np.linspace(0.5, 2.0, 480)[:, None]
    canvas.panel(true, word(7), profile=profile, gains=np.random.default_rng(3).uniform(0.7, 1.3, (4, 4)))
    assert rms(error_of(located(canvas.frame(), nudged(true, 1)), true)) < 0.35


@pytest.mark.parametrize(
    "true",
    [
        np.array([[300.3, 180.6], [351.7, 192.2], [352.1, 287.4], [299.8, 301.9]]),
        square(52, 240, 100),
    ],
    ids=["oblique", "two pixels from the picture's border"],
)
def test_wherever_it_stands_it_is_as_exact(true: Floats) -> None:
    canvas = Canvas()
    canvas.panel(true, word(7))
    assert rms(error_of(located(canvas.frame(), true + 1.0), true)) < 0.15


@pytest.mark.parametrize(("side", "percent"), [(13, 1.5), (20, 1.5), (26, 1.0), (50, 0.3), (110, 0.2)])
def test_a_far_panels_size_is_right(side: float, percent: float) -> None:
    """Down to cells of 3.2 px, where blur, gaps and fall-off overlap: on average over places, rolls and walls."""
    off = []
    for number, offset in enumerate(OFFSETS):
        true = square(310 + offset, 240 + 0.37 * offset, side, 15 * number)
        canvas = Canvas(background=0.02 + 0.02 * number)
        canvas.panel(true, word(7), profile=diffuser)
        found = located(canvas.frame(number), nudged(true, number, 0.5))
        off.append(outward(error_of(found, true), true))
    assert abs(2 * np.mean(off)) < percent / 100 * side


@pytest.mark.parametrize(("smear_px", "within_px"), [(1, 0.1), (3, 0.25), (5, 0.6)])
def test_a_moving_panel_is_where_it_was_on_average(smear_px: int, within_px: float) -> None:
    """A robot that turns smears the picture sideways; the blur tells by a root of 12 how far at most.

    A lens's own blur is 1.3 px at most.
    """
    true = square(310.4, 240.2, 100, 6)
    canvas = Canvas()
    canvas.panel(true, word(7))
    canvas.light = cv2.blur(canvas.light, (smear_px, 1))
    found = located(canvas.frame(), nudged(true, 1))
    assert rms(error_of(found, true)) < within_px
    assert found.blur_px is not None
    assert np.sqrt(12.0) * found.blur_px[0] > smear_px - 1
    assert found.blur_px.max() < 1.01 * np.hypot(smear_px / np.sqrt(12.0), 1.3)


@pytest.mark.slow
@pytest.mark.parametrize("side", [26, 70])
def test_the_stated_deviation_is_the_true_one(side: float) -> None:
    """Over places, rolls, words and noise: not half of it, nor three times; panels differ more than these do."""
    rng = np.random.default_rng(side)
    squares, stated = [], []
    for number in range(16):
        true = square(*rng.uniform((250, 180), (390, 300)), side, rng.uniform(-45, 45))
        canvas = Canvas(background=rng.uniform(0.01, 0.08))
        canvas.panel(true, word(int(rng.choice([0, 7, 12, 23]))), gains=rng.uniform(0.85, 1.15, (4, 4)))
        found = located(canvas.frame(number), nudged(true, number, 0.5))
        squares.append(np.square(error_of(found, true)).mean())
        stated.append(variance_px2(found))
    assert 0.5 < math.sqrt(np.mean(stated) / np.mean(squares)) < 3.0


@pytest.mark.parametrize("turns", range(4))
def test_corners_keep_the_order_of_the_rough_ones(turns: int) -> None:
    """So do the lattice's: a track's corners are the same ones in each frame."""
    true = np.roll(square(310.3, 240.6, 80, 20), turns, axis=0)
    canvas = Canvas()
    canvas.panel(square(310.3, 240.6, 80, 20), word(7))
    found = located(canvas.frame(), true)
    assert rms(found.corners_px - true) < 0.15
    assert found.lattice_px is not None
    assert rms(found.lattice_px - true) < 0.6


def test_a_panel_that_the_lens_bends_is_followed() -> None:
    """Near the picture's corner: knowing the lens, the corners are exact although no side is straight."""
    straight = square(490, 350, 230, 3)
    true = seen_through(LENS, straight)
    canvas = Canvas()
    canvas.panel(straight, word(7), lens=LENS)
    with_lens, without = (located(canvas.frame(), nudged(true, 1), lens) for lens in (LENS, None))
    assert rms(error_of(with_lens, true)) < min(0.15, rms(error_of(without, true)))


@pytest.mark.parametrize("around", [0.1, 0.3])
@pytest.mark.parametrize("side", [60.0, 130.0])
def test_a_bezel_moves_no_corner(side: float, around: float) -> None:
    """A steady frame with a quarter or three of the cells' light: an eighth of the side wide, all around."""
    true = square(310.4, 240.2, side, 13)
    canvas = Canvas()
    canvas.lamp(true + 0.25 * (true - true.mean(axis=0)), around)
    canvas.panel(true, word(7))
    found = located(canvas.frame(), true + 0.02 * side)
    assert rms(error_of(found, true)) < 0.3


@pytest.mark.parametrize(
    ("side", "exposure_us"),
    [(24.0, TRUE_10_MS_US), (60.0, TRUE_10_MS_US), (120.0, TRUE_10_MS_US), (60.0, SHORT_US), (120.0, SHORT_US)],
)
@pytest.mark.parametrize("dead", [(0, 0), (1, 2)])
def test_one_dead_cell_does_not_move_the_corners(dead: tuple[int, int], side: float, exposure_us: float) -> None:
    """At a corner, or within: the panel is where its other cells are."""
    true, gains = square(310.4, 240.2, side, 8), np.ones((4, 4))
    gains[dead] = 0.0
    canvas = Canvas(exposure_us=exposure_us)
    canvas.panel(true, word(7), gains=gains)
    assert rms(error_of(located(canvas.frame(), true + 0.5), true)) < 0.3


@pytest.mark.parametrize("side", [60.0, 120.0])
@pytest.mark.parametrize("share", [0.03, 0.12])
@pytest.mark.parametrize("exposure_us", [SHORT_US, TRUE_10_MS_US])
def test_a_panel_with_a_hidden_side_is_where_its_cells_are(exposure_us: float, share: float, side: float) -> None:
    """Something dark before a strip along its left side: from corners of what is seen."""
    true = square(310.4, 240.2, side, 8)
    (a, b, c, d) = true
    left = np.array([a + share * (b - a), b, c, d + share * (c - d)])
    canvas = Canvas(exposure_us=exposure_us)
    canvas.panel(true, word(7))
    out, up = 0.3 * (a - b), 0.2 * (a - d)
    canvas.lamp(np.array([a + out + up, left[0] + up, left[3] - up, d + out - up]), 0.0)
    found = located(canvas.frame(), left)
    assert found.lattice_px is not None
    assert rms(found.lattice_px - true) < 0.01 * side
    assert rms(error_of(found, true)) < 0.01 * side


@pytest.mark.parametrize("exposure_us", [SHORT_US, TRUE_10_MS_US])
def test_a_hidden_corner_does_not_move_the_others(exposure_us: float) -> None:
    """An eighth of either side at one corner is dark."""
    true = square(310.4, 240.2, 100, 8)
    (a, b, _, d) = true
    canvas = Canvas(exposure_us=exposure_us)
    canvas.panel(true, word(7))
    along, down = 0.12 * (b - a), 0.12 * (d - a)
    canvas.lamp(np.array([a - along - down, a + along - down, a + along + down, a - along + down]), 0.0)
    assert rms(error_of(located(canvas.frame(), true + 0.5), true)) < 0.3


@pytest.mark.parametrize("side", [40.0, 130.0])
@pytest.mark.parametrize("exposure_us", [SHORT_US, 640.0, TRUE_10_MS_US])
def test_it_is_found_from_a_tenth_of_its_side_off(exposure_us: float, side: float) -> None:
    """Which is how far off proposals may be."""
    true = square(310.4, 240.2, side, 25)
    canvas = Canvas(exposure_us=exposure_us)
    canvas.panel(true, word(7))
    for seed in range(4):
        found = located(canvas.frame(seed), true + 0.07 * side * np.array([math.cos(seed), math.sin(seed)]))
        assert rms(error_of(found, true)) < 0.25


@pytest.mark.parametrize("cells", [3, 5, 6])
def test_other_grids_are_located_too(cells: int) -> None:
    """Panels have three, five or six cells along a side."""
    true = square(300, 200, 100, 5)
    canvas = Canvas()
    canvas.panel(true, np.indices((cells, cells)).sum(axis=0) % 3 == 0, profile=flat)
    assert rms(error_of(located(canvas.frame(), nudged(true, 3, 1.0), cells=cells), true)) < 0.3


def test_the_frequencies_that_explain_most_are_taken() -> None:
    """One of two pairs, whichever is named first: with the other pair, bands are not where they are."""
    true, other = square(310.4, 240.2, 90, 7), PanelSpec(side_m=0.16, black_hz=1700.0, white_hz=3100.0)
    canvas = Canvas(exposure_us=300.0)
    canvas.panel(true, word(7))
    for specs in ((SPEC, other), (other, SPEC)):
        found = Locator(4, specs, None).localise(canvas.frame(), true + 0.5)
        assert isinstance(found, Quad)
        assert rms(error_of(found, true)) < 0.1


# ---- What is none


@pytest.mark.parametrize("exposure_us", [TRUE_10_MS_US, 300.0])
@pytest.mark.parametrize(("of_the_others", "is_one"), [(0.1, False), (0.4, False), (0.6, True)])
def test_what_has_a_dark_side_is_no_panel(of_the_others: float, exposure_us: float, *, is_one: bool) -> None:
    """So looks a lattice that is a cell off: no pose, though none beside fits better. LEDs alone differ by less."""
    true = square(300, 240, 100, 20)
    canvas = Canvas(exposure_us=exposure_us)
    canvas.panel(true, word(7), profile=lambda u, v: np.where(v < 0.25, of_the_others, 1.0) * diffuser(u, v))
    found = Locator(4, (SPEC,), None).localise(canvas.frame(), true + 1.0)
    assert ("a panel" if isinstance(found, Quad) else reason(found)) == ("a panel" if is_one else "fit.misfit")


@pytest.mark.parametrize("exposure_us", [SHORT_US, 640.0])
def test_a_steady_lamp_is_refused_in_deep_bands(exposure_us: float) -> None:
    """It would show them."""
    true = square(310, 240, 100, 10)
    canvas = Canvas(exposure_us=exposure_us)
    canvas.lamp(true)
    assert reason(Locator(4, (SPEC,), None).localise(canvas.frame(), true)) == "fit.no_bands"


def test_what_has_nothing_dark_in_it_costs_no_fit_where_bands_are_deep() -> None:
    """Not even a lattice that is steady: a lit panel's darkest bands have the room's light only."""
    true, locator = square(310, 240, 100, 10), Locator(4, (SPEC,), None)
    canvas = Canvas(exposure_us=SHORT_US)
    canvas.lamp(true, profile=lambda u, v: 1.0 - 0.4 * ((4 * u % 1.0 < 0.3) | (4 * v % 1.0 < 0.3)))
    assert reason(locator.localise(canvas.frame(), true)) == "fit.no_bands"
    assert locator.spent == 0


def test_an_even_wall_and_a_square_too_small_are_refused() -> None:
    """Noise is not taken for a panel; nor are seven pixels a side, of cells that are less than two."""
    assert isinstance(Locator(4, (SPEC,), None).localise(Canvas().frame(), square(310, 240, 75)), Rejected)
    canvas = Canvas()
    canvas.panel(square(310, 240, 7), word(7), profile=flat)
    assert reason(Locator(4, (SPEC,), None).localise(canvas.frame(), square(310, 240, 7))) == "fit.too_small"


@pytest.mark.parametrize(
    "rough",
    [
        np.array([[270.0, 200], [330, 200], [330, 200], [270, 200]]),
        np.array([[270.0, 170], [330, 170], [270, 170], [330, 170]]),
        np.full((4, 2), np.nan),
        square(300, 200, 60) * [np.inf, 1.0],
        square(300, 200, 60) + 1e6,
    ],
)
def test_corners_that_are_none_are_refused_in_silence(rough: Floats) -> None:
    """Without an area, folded, no numbers, far away: no number comes out of them, and no warning."""
    canvas = Canvas()
    canvas.panel(square(300, 200, 60), word(7))
    locator, known = Locator(4, (SPEC,), None), located(canvas.frame(), square(300, 200, 60)).unknown
    assert known is not None
    assert isinstance(locator.localise(canvas.frame(), rough), Rejected)
    assert isinstance(locator.refine(canvas.frame(), rough, known), Rejected)


# ---- What it costs


def test_what_is_no_panel_costs_little() -> None:
    """Spots that lie about at random are given up before their fit has settled: for a fifth of what a panel costs."""
    panel, spots, true = Canvas(), Canvas(), square(310.4, 240.2, 90, 7)
    panel.panel(true, word(7))
    rough = cv2.GaussianBlur(np.random.default_rng(3).normal(size=spots.light.shape), None, 6.0)
    spots.light += 0.5 * np.maximum(rough, 0.0) / rough.max()
    one, other = Locator(4, (SPEC,), None), Locator(4, (SPEC,), None)
    assert isinstance(one.localise(panel.frame(), true), Quad)
    assert reason(other.localise(spots.frame(), true)) in {"fit.uncertain", "fit.misfit"}
    assert 0 < other.spent < 0.2 * one.spent


def test_what_was_spent_is_counted() -> None:
    """Following costs less than what is proposed; two kinds of panels cost more than one."""
    true, other = square(310.4, 240.2, 90, 7), PanelSpec(side_m=0.16, black_hz=1700.0, white_hz=3100.0)
    canvas = Canvas()
    canvas.panel(true, word(7))
    one, two = Locator(4, (SPEC,), None), Locator(4, (SPEC, other), None)
    assert one.spent == 0
    found = one.localise(canvas.frame(), true)
    proposed = one.spent
    assert isinstance(found, Quad)
    assert found.unknown is not None
    one.refine(canvas.frame(), true, found.unknown)
    followed = one.spent - proposed
    two.refine(canvas.frame(), true, found.unknown)
    assert 0 < followed < proposed
    assert two.spent > 1.3 * followed


@pytest.mark.parametrize("side", [60, 100])
@pytest.mark.parametrize("number", range(2))
def test_a_lattice_that_is_a_row_off_is_moved_before_its_last_fit(side: float, number: int) -> None:
    """Its dark row is plain in the first fits: the panel costs three times one that was proposed in place, at most."""
    true, canvas = square(300.3, 200.6, side, 10 + 5 * number), Canvas()
    canvas.panel(true, word(7))
    spent = []
    for near in (nudged(true, number, 1.0), true + (true[1] - true[0]) / 4):
        locator = Locator(4, (SPEC,), None)
        found = locator.localise(canvas.frame(number), near)
        assert isinstance(found, Quad), reason(found)
        assert rms(error_of(found, true)) < 0.1
        spent.append(locator.spent)
    assert spent[1] < 3 * spent[0]
