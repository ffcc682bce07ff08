"""Panels without a diffuser: sixteen bright spots, from which the grid's corners follow."""

from __future__ import annotations

import numpy as np
import pytest
from decode_material import Canvas, camera_info, panel_settings, quad, reason, square, word

from ledpi.decode.find import Finder
from ledpi.decode.spots import group_sizes, groups, is_part_of, lattice, settle
from ledpi.pipeline import Pipeline
from ledpi.records import Floats, Quad


def bare(u: Floats, v: Floats) -> Floats:
    """An LED in the middle of each cell, a sixth of the cell wide (a deviation), and nothing around it."""
    x, y = 4 * u % 1.0 - 0.5, 4 * v % 1.0 - 0.5
    return np.asarray(np.exp(-(x * x + y * y) / (2 * 0.16**2)))


def middles(corners: Floats) -> Floats:
    """(16, 3) middles of the cells of a parallelogram, all outlines 8 pixels long."""
    at = (np.arange(4) + 0.5) / 4
    u, v = (w.reshape(-1, 1) for w in np.meshgrid(at, at))
    points = corners[0] + u * (corners[1] - corners[0]) + v * (corners[3] - corners[0])
    return np.column_stack([points, np.full(16, 8.0)])


def lattices(spots: Floats) -> list[Floats]:
    """The corners of each grid of 4 × 4 that there is among spots."""
    found = (lattice(group, 4) for group in groups(spots, group_sizes(4)))
    return [corners for corners in found if corners is not None]


def test_sixteen_spots_in_a_lattice_are_a_grid_half_a_pitch_larger() -> None:
    """In whatever order, and with specks beside them."""
    true = square(100.0, 80.0, 64.0, 20)
    specks = np.array([[300.0, 10.0, 8.0], [310.0, 12.0, 9.0], [200.0, 200.0, 7.0]])
    spots = np.random.default_rng(1).permutation(np.concatenate([middles(true), specks]))
    (found,) = lattices(spots)
    assert np.abs(found - true).max() < 1e-3


def test_spots_that_are_no_lattice_are_no_grid() -> None:
    """One of them half a pitch off; or fifteen of them; or some far larger than others."""
    spots = middles(square(100.0, 80.0, 64.0, 20))
    moved, unlike = spots.copy(), spots.copy()
    moved[5, :2] += 8.0
    unlike[::2, 2] = 40.0
    assert lattices(moved) == []
    assert lattices(spots[1:]) == []
    assert lattices(unlike) == []


@pytest.mark.parametrize("side", [60.0, 110.0, 180.0])
@pytest.mark.parametrize("turn_deg", [3, 30])
def test_a_panel_of_bare_leds_is_found_by_its_spots(turn_deg: float, side: float) -> None:
    """To 0.3 pixels: there is no edge to be seen."""
    true = square(310.4, 240.2, side, turn_deg)
    canvas = Canvas()
    canvas.panel(true, word(7), profile=bare)
    frame = canvas.frame()
    candidates, _ = Finder(640, 480, 10.0).find(frame)
    (grid,) = (candidate for candidate in candidates if candidate.spots)
    found = settle(frame, grid.corners, 4)
    assert isinstance(found, Quad), reason(found)
    assert np.abs(found.corners_px - true).max() < 0.3


def test_without_spots_there_is_nothing_to_settle_on() -> None:
    """An even lamp has no middles of cells."""
    true = square(310.4, 240.2, 100.0)
    canvas = Canvas()
    canvas.lamp(square(360.0, 200.0, 90.0, 30), 0.4)
    assert reason(settle(canvas.frame(None), true, 4)).startswith("edges.")


def test_what_runs_around_a_grids_spots_is_part_of_it() -> None:
    """And what is elsewhere is not."""
    inner, other, grid = (quad(square(*at)) for at in ((100, 100, 90), (300, 100, 90), (100, 100, 100)))
    assert is_part_of(inner, grid)
    assert not is_part_of(other, grid)


def test_a_stream_follows_and_reads_bare_leds() -> None:
    """From the second frame on it is sought where it was, by its spots again."""
    true = square(310.4, 240.2, 110.0, 30)
    pipeline = Pipeline(camera_info(), panel_settings(), intrinsics=None)
    for seq in range(4):
        canvas = Canvas()
        canvas.panel(true, word(7), profile=bare, start_us=seq * 504 * 33.67)
        markers = pipeline.decode(canvas.frame(seq, seq=seq)).markers
    assert [marker.sighting.id for marker in markers] == [7]
    assert np.abs(markers[0].sighting.corners_px - true).max() < 0.3
