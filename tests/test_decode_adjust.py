"""Corners by all lines of a panel's lattice: what touches its sides from outside no longer moves them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from decode_material import HEIGHT, LENS, WIDTH, Canvas, flat, one_size, reason, seen_through, square, word

from ledpi.decode.corners import edges
from ledpi.decode.corners.adjust import adjust_quads
from ledpi.decode.corners.inner_lines import NOT_SEEN_PX2, Homographies, inner_lines, lens_moves, line_places
from ledpi.decode.corners.sides import Patches, as_corners, as_points
from ledpi.kernels import library
from ledpi.records import Floats, Frame, Intrinsics, Quad

CELLS = 4


def page(seed: int) -> Canvas:
    """Paper half as bright as the panel's rim, with black spots of 11 px wherever they fall."""
    canvas = Canvas()
    spots = np.random.default_rng(seed).random((HEIGHT // 11 + 1, WIDTH // 11 + 1)) < 0.35
    paper = np.where(np.kron(spots, np.ones((11, 11), bool))[:HEIGHT, :WIDTH], 0.02, 0.18)
    canvas.light = cv2.GaussianBlur(paper, (0, 0), 0.7)
    return canvas


def found(frame: Frame, near: Floats, lens: Intrinsics | None = None) -> Quad:
    quad = edges.refine_quads(frame, near[None], CELLS, lens)[0]
    assert isinstance(quad, Quad), reason(quad)
    return quad


def by_its_sides(frame: Frame, near: Floats) -> Quad:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(library, "COMPILED", False)  # in one call of which the sides are adjusted, too
        patch.setattr(edges, "adjust_quads", lambda frame, quads, *_: quads)
        return found(frame, near)


def rms(error: Floats) -> float:
    return float(np.sqrt(np.square(error).sum(axis=-1).mean()))


def measured(frame: Frame, corners: Floats, lens: Intrinsics | None = None) -> tuple[Floats, Floats]:
    """How far off lines (2, lines, cells) are from where `corners` (4, 2) have them, and the variance."""
    at = as_points(corners[None])
    patches = Patches(frame, at, 8.0)
    pitch_px = np.full((1, 2), np.linalg.norm(corners[1] - corners[0]) / CELLS)
    homographies = Homographies.of(at - patches.first)
    off, variance = inner_lines(patches, homographies, pitch_px, lens_moves(at, CELLS, lens), CELLS)
    return off.reshape(2, CELLS - 1, CELLS), variance.reshape(2, CELLS - 1, CELLS)


@pytest.mark.parametrize("side", [50, 90])
def test_what_touches_the_sides_does_not_move_the_corners(side: float) -> None:
    """Letters and tiles pull the sides by a tenth of a pixel and more; with the lines within, not by half of that."""
    sides_off, off = [], []
    for number in range(4):
        true = square(310.3 + 0.17 * number, 240.6, side, 5 + 3 * number)
        canvas = page(number)
        canvas.panel(true, word(7))
        frame = canvas.frame(number)
        sides_off.append(by_its_sides(frame, true).corners_px - true)
        off.append(found(frame, true).corners_px - true)
    assert rms(np.array(sides_off)) > 0.06
    assert rms(np.array(off)) < 0.5 * rms(np.array(sides_off))


def test_a_line_is_found_where_it_is() -> None:
    """Corners that are 0.2 px too far right and 0.1 px too far up: upright lines are 0.2 px less far along u."""
    true = square(310.3, 240.6, 90)
    canvas = Canvas()
    canvas.panel(true, word(7), gains=np.random.default_rng(1).uniform(0.9, 1.1, (4, 4)))
    off, variance = measured(canvas.frame(), true + np.array([0.2, -0.1]))
    np.testing.assert_allclose(off[0].mean(), -0.2, atol=0.02)
    np.testing.assert_allclose(off[1].mean(), 0.1, atol=0.02)
    assert np.sqrt(variance).max() < 0.05


def test_lines_bend_with_the_lens() -> None:
    """Where the middle line of a large panel is a pixel off the line between its ends."""
    straight = square(120, 110, 120, 4)
    canvas = Canvas()
    canvas.panel(straight, word(7), lens=LENS)
    corners = seen_through(LENS, straight)
    off, _ = measured(canvas.frame(), corners, LENS)
    without, _ = measured(canvas.frame(), corners)
    assert np.abs(off).mean() < 0.05
    assert np.abs(without).mean() > 3 * np.abs(off).mean()


def test_where_the_lens_moves_the_lines() -> None:
    """To a hundredth of a pixel as points that are bent one by one."""
    straight = square(420, 330, 160, 20)
    u, v = line_places(CELLS)
    pixels, *_ = Homographies.of(as_points(straight[None])).at(u, v)
    bent = as_points(seen_through(LENS, as_corners(pixels[0])))
    corners = as_points(seen_through(LENS, straight)[None])
    at = Homographies.of(corners).at(u, v)[0] + lens_moves(corners, CELLS, LENS)
    np.testing.assert_allclose(at[0], bent, atol=0.02)


def test_lines_that_are_not_seen_say_nothing() -> None:
    """Evenly lit, without walls: only the sides tell where the panel is."""
    true = square(310.3, 240.6, 90, 7)
    canvas = Canvas()
    canvas.panel(true, word(7), profile=flat)
    frame = canvas.frame()
    _, variance = measured(frame, true)
    assert np.median(variance) > 0.1**2
    assert rms(found(frame, true).corners_px - by_its_sides(frame, true).corners_px) < 0.02


def test_a_dead_cells_lines_do_not_count() -> None:
    """Nothing is as bright on both sides of them."""
    true = square(310.3, 240.6, 90, 7)
    gains = np.ones((4, 4))
    gains[1, 2] = 0.0
    canvas = Canvas()
    canvas.panel(true, word(7), gains=gains)
    frame = canvas.frame()
    _, variance = measured(frame, true)
    np.testing.assert_allclose(np.argwhere(variance[0] == NOT_SEEN_PX2), [[1, 1], [2, 1]], atol=1e-4)
    np.testing.assert_allclose(np.argwhere(variance[1] == NOT_SEEN_PX2), [[0, 2], [1, 2]], atol=1e-4)
    assert rms(found(frame, true).corners_px - true) < 0.06


def test_a_far_panels_corners_are_its_sides(monkeypatch: pytest.MonkeyPatch) -> None:
    """With cells of 5 px the blurs of lines run together."""
    true = square(310.3, 240.6, 20, 7)
    canvas = Canvas()
    canvas.panel(true, word(7))
    sides = by_its_sides(canvas.frame(), true)
    monkeypatch.setattr(library, "COMPILED", False)  # as these were found
    np.testing.assert_allclose(found(canvas.frame(), true).corners_px, sides.corners_px, atol=1e-4)


def test_another_lattice_is_left_as_it_is() -> None:
    """A window of 3 × 3 panes has no lines where a panel of 4 × 4 cells has: what its sides said stands."""
    true = square(310.3, 240.6, 90, 7)
    canvas = Canvas()
    canvas.lamp(true, profile=lambda u, v: (np.minimum(3 * u % 1, 3 * v % 1) > 0.1).astype(float))
    frame = canvas.frame()
    given = Quad(corners_px=true, corner_sigma_px=0.05)
    (quad,) = adjust_quads(frame, [given], np.array([True]), np.zeros((1, 4, 2), complex), CELLS, None)
    assert isinstance(quad, Quad)
    assert rms(quad.corners_px - true) < 1.0


@pytest.mark.parametrize("side", [28, 50, 90])
def test_lines_that_have_a_panel_larger_leave_its_size_open(side: float) -> None:
    """Of cells of one size they end half a wall further out than the light: by no more than is stated of all sides."""
    true = square(310.4, 240.2, side, 8)
    canvas = Canvas()
    canvas.panel(true, word(7), light=0.5, profile=one_size)
    quad = found(canvas.frame(), true)
    assert rms(quad.corners_px - true) / np.sqrt(2) < 2.5 * quad.corner_sigma_px
    canvas = Canvas()
    canvas.panel(true, word(7), light=0.5)
    assert quad.size_sigma_px > 1.5 * found(canvas.frame(), true).size_sigma_px


@pytest.mark.parametrize("side", [30, 60])
def test_the_stated_deviation_holds_beside_what_touches_the_sides(side: float) -> None:
    """Not less than 0.45 of the true one, nor more than twice, with and without a page behind."""
    for canvas_of in (page, lambda number: Canvas(background=0.02 + 0.01 * number)):
        stated, squares = [], []
        for number in range(8):
            true = square(310.3 + 0.17 * number, 240.6, side, 5 + 3 * number)
            canvas = canvas_of(number)
            canvas.panel(true, word(7), gains=np.random.default_rng(number).uniform(0.85, 1.15, (4, 4)))
            quad = found(canvas.frame(number), true)
            stated.append(quad.corner_sigma_px**2)
            squares.append(np.square(quad.corners_px - true).mean())
        assert 0.45 < np.sqrt(np.mean(stated) / np.mean(squares)) < 2.0
