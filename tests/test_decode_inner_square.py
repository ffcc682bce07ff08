"""A panel's corners by its inner lines alone, whatever is around it."""

from __future__ import annotations

import math

import numpy as np
import pytest
from decode_material import LENS, Canvas, diffuser, one_size, quad, reason, seen_through, square, word

from ledpi.decode.corners.inner_square import _told, by_inner_lines, is_aside, is_same
from ledpi.kernels import inner_square as kernel
from ledpi.kernels.library import COMPILED
from ledpi.records import Floats, Frame, Intrinsics, Quad


def touched(true: Floats, light: float, *, lamp: bool = False) -> Frame:
    """A panel, or a lamp that looks like none, in the middle of a sheet."""
    canvas = Canvas()
    canvas.lamp(true + 0.4 * (true - true.mean(axis=0)), light)
    if lamp:
        canvas.lamp(true, 0.4)
    else:
        canvas.panel(true, word(7))
    return canvas.frame()


def nudged(true: Floats, share: float, seed: int = 1) -> Floats:
    away = np.random.default_rng(seed).uniform(-1, 1, (4, 2))
    return np.asarray(true + share * float(np.linalg.norm(true[1] - true[0])) / 4 * away)


@pytest.mark.parametrize(("side", "within_px"), [(50.0, 0.3), (100.0, 0.2), (200.0, 0.2)])
@pytest.mark.parametrize("light", [0.15, 0.3, 0.9])
@pytest.mark.parametrize("seed", range(3))
def test_what_is_around_moves_no_corner(seed: int, light: float, side: float, within_px: float) -> None:
    """From a tenth of a cell off, beside something as bright as the rim of a cell, and three times as bright."""
    true = square(310.4, 240.2, side, 13)
    found = by_inner_lines(touched(true, light), nudged(true, 0.1, seed), 4)
    assert isinstance(found, Quad), reason(found)
    assert found.told_by == "lines"
    off = np.linalg.norm(found.corners_px - true, axis=1).max()
    assert off < within_px
    assert off < 6 * found.own_sigma_px


def test_lines_alone_leave_half_a_wall_open() -> None:
    """Cells of one size end within their lattice: each side by 1 % of 130 px, nearly all of which all of them share."""
    true = square(310.4, 240.2, 130.0, 8)
    canvas = Canvas()
    canvas.panel(true, word(7), profile=one_size)
    found = by_inner_lines(canvas.frame(), true, 4)
    assert isinstance(found, Quad), reason(found)
    off = float(np.sqrt(np.square(found.corners_px - true).mean()))
    assert 1.0 < off < 1.5 * found.size_sigma_px
    assert found.own_sigma_px < 0.1


def test_the_lens_bends_the_lines() -> None:
    """Near the picture's corner, where straight lines are bent by half a pixel."""
    straight = square(530.0, 390.0, 150.0, 5)
    canvas = Canvas()
    canvas.panel(straight, word(7), lens=LENS)
    true = seen_through(LENS, straight)
    found = by_inner_lines(canvas.frame(), nudged(true, 0.1), 4, LENS)
    assert isinstance(found, Quad), reason(found)
    assert np.linalg.norm(found.corners_px - true, axis=1).max() < 0.3


def test_an_even_lamp_has_no_lines() -> None:
    """Noise is no lattice."""
    true = square(310.4, 240.2, 100.0, 13)
    assert reason(by_inner_lines(touched(true, 0.15, lamp=True), true, 4)) == "edges.no_inner_lines"


def test_half_a_cell_off_is_too_far() -> None:
    """There the next line is as near."""
    true = square(310.4, 240.2, 100.0, 13)
    found = by_inner_lines(touched(true, 0.15), true + np.array([12.5, 0.0]), 4)
    assert not isinstance(found, Quad) or math.dist(found.corners_px[0], true[0]) < 1


NOWHERE = [np.zeros((4, 2)), np.full((4, 2), 3.0), square(0.0, 0.0, 40.0), square(-900.0, 9.0, 80.0)]


@pytest.mark.parametrize("near", NOWHERE)
def test_nowhere_is_refused(near: Floats) -> None:
    """A point, and squares that are partly or wholly outside the picture."""
    assert not isinstance(by_inner_lines(Canvas().frame(), near, 4), Quad)


def test_the_same_square_may_begin_at_another_corner() -> None:
    """A fiftieth of a cell apart is the same; a twentieth is not."""
    one = quad(square(300.0, 200.0, 100.0, 40))
    assert is_same(quad(np.roll(one.corners_px, 1, axis=0) + 0.3), one, 4)
    assert not is_same(quad(one.corners_px + 1.2), one, 4)


def test_walls_alone_are_lines_enough() -> None:
    """Cells lit evenly to dark walls between them."""

    def walls(u: Floats, v: Floats) -> Floats:
        return np.where(diffuser(u, v) > 0, 1.0, 0.0)

    true = square(310.4, 240.2, 100.0, 13)
    canvas = Canvas(background=0.35)
    canvas.panel(true, word(7), profile=walls)
    found = by_inner_lines(canvas.frame(), nudged(true, 0.1), 4)
    assert isinstance(found, Quad), reason(found)
    assert np.linalg.norm(found.corners_px - true, axis=1).max() < 0.2


@pytest.mark.skipif(not COMPILED, reason="needs the compiled loops (a C compiler when ledpi was installed)")
@pytest.mark.parametrize("side", [36.0, 90.0, 180.0])
@pytest.mark.parametrize("lens", [None, LENS])
def test_compiled_loops_tell_the_same(lens: Intrinsics | None, side: float) -> None:
    """With a dead cell; where they find nothing, both find nothing."""
    gains = np.ones((4, 4))
    gains[1, 2] = 0.0
    straight = square(330.4, 250.2, side, 21)
    canvas = Canvas()
    canvas.panel(straight, word(7), gains=gains, lens=lens)
    frame, true = canvas.frame(), straight if lens is None else seen_through(lens, straight)
    found = 0
    for share in (0.05, 0.15, 0.25, 0.6):
        near = nudged(true, share)
        (ours, sigma_px), (theirs, their_sigma_px) = kernel.told(frame, near, 4, lens), _told(frame, near, 4, lens)
        np.testing.assert_allclose(sigma_px, their_sigma_px, rtol=1e-3)
        if math.isfinite(sigma_px):
            np.testing.assert_allclose(ours, theirs, atol=1e-3)
            found += 1
    assert found >= 1


@pytest.mark.parametrize("side", [60.0, 100.0, 140.0])
def test_a_grid_a_cell_aside_is_refused(side: float) -> None:
    """Its last column is the dark beside the panel, and only five of six lines are there."""
    true = square(310.4, 240.2, side, 13)
    canvas = Canvas()
    canvas.panel(true, word(7))
    aside = true + (true[1] - true[0]) / 4
    assert not isinstance(by_inner_lines(canvas.frame(), aside, 4), Quad)


def test_a_grid_a_row_aside_overlaps_what_it_is_aside_of() -> None:
    """By a column, by a row and a column, and not by a hundredth; and a grid of other cells is another thing."""
    one = quad(square(320.0, 240.0, 80.0))
    for aside in ([20.0, 0.0], [-20.0, 20.0], [60.0, 0.0]):
        assert is_aside(quad(one.corners_px + np.array(aside)), one, 4)
    assert not is_aside(quad(one.corners_px + 0.2), one, 4)
    assert not is_aside(quad(one.corners_px + np.array([100.0, 0.0])), one, 4)
    assert not is_aside(quad(square(340.0, 240.0, 160.0)), one, 4)
