"""Panels by the places where four of their cells meet, painted before whatever may surround them."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from decode_material import Bits, Canvas, Profile, diffuser, flat, square, word
from kernels_material import compiled

from ledpi.decode.finding.crossings import MISSING, MOST_GRIDS, crosses_in, grids_in, lattice_grids
from ledpi.decode.finding.find import Finder
from ledpi.kernels import crossings as kernel
from ledpi.records import Floats, Frame, Pixels


def frame_of(true: Floats, profile: Profile = diffuser, cells: Bits | None = None) -> Frame:
    """A panel that touches a sheet as bright as its cells' rim, and a brighter one."""
    canvas = Canvas()
    left, right = true[[0, 3]].mean(axis=0), true[[1, 2]].mean(axis=0)
    side = float(np.linalg.norm(true[1] - true[0]))
    turn = float(np.degrees(np.arctan2(*(true[1] - true[0])[::-1])))
    canvas.lamp(square(*(left - (right - left) / 2), side, turn), 0.28)
    canvas.lamp(square(*(right + (right - left) / 2), side, turn), 0.6)
    canvas.panel(true, word(7) if cells is None else cells, profile=profile)
    return canvas.frame()


def found_in(frame: Frame, cells: int = 4, *, far: bool = False) -> list[Floats]:
    finder = Finder(640, 480, 12.0, cells)
    finder.find(frame)
    return finder.find_crossings(frame, far=far)


def nearest(found: list[Floats], true: Floats) -> float:
    """The farthest corner of the grid that is the nearest."""
    away = [np.linalg.norm(np.roll(grid, k, axis=0) - true, axis=1).max() for grid in found for k in range(4)]
    return float(min(away, default=np.inf))


@pytest.mark.parametrize("side", [50.0, 100.0, 170.0, 256.0])
@pytest.mark.parametrize("turn_deg", [0, 17, 40])
def test_a_grid_is_found_whatever_touches_it(side: float, turn_deg: float) -> None:
    """To a fifth of a cell; at 2 m (50 pixels) as at 0.4 m."""
    true = square(320.4, 240.3, side, turn_deg)
    assert nearest(found_in(frame_of(true)), true) < 0.2 * side / 4


@pytest.mark.parametrize(("side", "turn_deg"), [(118.0, -5), (232.0, 0), (250.0, 10)])
def test_where_walls_are_thinner_than_a_pixel_the_level_before_sees_the_grid(side: float, turn_deg: float) -> None:
    """Nearly along the rows of pixels, places are found a pixel off: of seven, on the coarser level, too much."""
    true = square(320.4, 240.3, side, turn_deg)
    assert nearest(found_in(frame_of(true)), true) < 0.2 * side / 4


@pytest.mark.parametrize("turn_deg", [0, 17, 40])
def test_far_away_it_is_found_in_the_picture_itself(turn_deg: float) -> None:
    """At 3 m a cell is 8.5 pixels, and 4 in the half picture."""
    true = square(320.4, 240.3, 34.0, turn_deg)
    assert nearest(found_in(frame_of(true), far=True), true) < 0.2 * 34 / 4


def test_other_grids_are_found_too() -> None:
    """Of 6 × 6 cells, whose 25 places hold several squares of nine."""
    rng = np.random.default_rng(3)

    def six(u: Floats, v: Floats) -> Floats:
        return diffuser(u * 6 / 4 % 1.0, v * 6 / 4 % 1.0) * ((u * 6 % 1.0 > 0.04) & (v * 6 % 1.0 > 0.04))

    true = square(320.4, 240.3, 150.0, 11)
    assert nearest(found_in(frame_of(true, six, rng.random((6, 6)) > 0.5), 6), true) < 0.2 * 150 / 6


def test_an_even_square_has_none() -> None:
    """Nothing within it says where its cells are."""
    assert found_in(frame_of(square(320.4, 240.3, 100.0, 17), flat)) == []


def lattice_of_dots(rows: int, columns: int, pitch: int = 6, missing: int = 0) -> Pixels:
    """Dark pixels on grey, the first at (20, 20)."""
    picture = np.full((60 + rows * pitch, 60 + columns * pitch), 120, np.uint8)
    places = [(20 + pitch * y, 20 + pitch * x) for y in range(rows) for x in range(columns)]
    for y, x in places[missing:]:
        picture[y, x] = 60
    return picture


def test_the_grid_reaches_a_pitch_beyond_its_crossings() -> None:
    """Nine dots from 20 to 32 pixels: a grid of 4 × 4 from 14 to 38."""
    (grid,) = grids_in(lattice_of_dots(3, 3), 4)
    np.testing.assert_allclose(grid, [[14, 14], [38, 14], [38, 38], [14, 38]], atol=1e-6)


def test_a_diagonal_may_be_the_shortest_way() -> None:
    """Seen from the side at an eighth of a turn: steps of (6, 3) and (6, −3) pixels, and (0, 6) between neighbours."""
    picture = np.full((60, 80), 120, np.uint8)
    for i in range(3):
        for k in range(3):
            picture[30 + 3 * i - 3 * k, 20 + 6 * i + 6 * k] = 60
    (grid,) = grids_in(picture, 4)
    np.testing.assert_allclose(grid, [[8, 30], [32, 18], [56, 30], [32, 42]], atol=1e-6)


def test_all_but_one_crossing_must_be_there() -> None:
    """A dead cell blots out none that the others do not tell, but of two too much is guessed."""
    assert MISSING == 1
    assert len(grids_in(lattice_of_dots(3, 3, missing=1), 4)) == 1
    assert grids_in(lattice_of_dots(3, 3, missing=2), 4) == []


def test_each_part_of_a_larger_lattice_may_be_the_grid() -> None:
    """Of 3 × 5 dots, three squares of nine."""
    assert len(grids_in(lattice_of_dots(3, 5), 4)) == 3


def test_patterns_without_end_cost_little() -> None:
    """Of a wall of tiles no more is looked at than so many parts."""
    assert len(grids_in(lattice_of_dots(30, 40), 4)) == MOST_GRIDS


def test_three_cells_a_side_are_too_few() -> None:
    """Four places where cells meet are in anything."""
    assert grids_in(lattice_of_dots(3, 3), 3) == []


@pytest.mark.parametrize("shape", [(1, 1), (6, 40), (7, 7)])
def test_small_pictures_hold_none(shape: tuple[int, int]) -> None:
    """Nor are they an error."""
    assert grids_in(np.zeros(shape, np.uint8), 4) == []


@compiled
@pytest.mark.parametrize("blur_px", [1.0, 2.0, 4.0])
def test_compiled_loops_find_the_same(blur_px: float) -> None:
    """Blots of all sizes, too many of them too; lattices; a panel."""
    rng = np.random.default_rng(round(blur_px))
    blots = cv2.GaussianBlur(rng.random((241, 322)), (0, 0), blur_px)
    panel = cv2.resize(frame_of(square(320.4, 240.3, 100.0, 17)).pixels, (320, 240), interpolation=cv2.INTER_AREA)
    tiles = cv2.GaussianBlur(lattice_of_dots(9, 9), (0, 0), 0.3 * blur_px)
    for picture in (cv2.normalize(blots, None, 0, 255, cv2.NORM_MINMAX, cv2.CV_8U), panel, tiles):
        ours, theirs = kernel.crosses(picture), crosses_in(picture)
        np.testing.assert_allclose(ours[0], theirs[0], atol=1e-9)
        assert ours[1].tolist() == theirs[1].tolist()
        np.testing.assert_allclose(ours[2], theirs[2], atol=1e-9)
        for cells in (4, 5, 8):
            grids, expected = kernel.grids(*ours, cells), lattice_grids(*ours, cells)
            np.testing.assert_allclose(grids, np.array(expected).reshape(-1, 4, 2), atol=1e-6)
