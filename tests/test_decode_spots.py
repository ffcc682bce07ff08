"""Panels without a diffuser: sixteen bright spots, from which the grid's corners follow."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from decode_material import SPEC, Canvas, camera_info, diffuser, panel_settings, quad, reason, square, word

from ledpi.decode.corners.spot_centres import _centres, by_spot_centres, is_part_of
from ledpi.decode.finding.find import Finder
from ledpi.decode.finding.lit import contrasts
from ledpi.decode.finding.spots import group_sizes, groups, lattice, spots_in
from ledpi.decode.squares import Squares
from ledpi.geometry import distort
from ledpi.kernels import spot_centres as kernel
from ledpi.kernels.library import COMPILED
from ledpi.pipeline import Pipeline
from ledpi.records import Floats, Frame, Intrinsics, Pixels, Quad


def bare(u: Floats, v: Floats) -> Floats:
    """An LED in the middle of each cell, a sixth of the cell wide (a deviation), and nothing around it."""
    x, y = 4 * u % 1.0 - 0.5, 4 * v % 1.0 - 0.5
    return np.asarray(np.exp(-(x * x + y * y) / (2 * 0.16**2)))


def behind_thick_walls(u: Floats, v: Floats) -> Floats:
    """A diffuser, and walls of an eighth of a cell."""
    x, y = 4 * u % 1.0, 4 * v % 1.0
    return np.asarray((np.abs(x - 0.5) < 0.44) & (np.abs(y - 0.5) < 0.44), np.float64)


def frame_of(pixels: Pixels) -> Frame:
    return Frame(pixels=pixels, seq=0, row0_readout_ns=0, exposure_us=1e4, row_time_us=30.0, transfer="linear")


def middles(corners: Floats) -> Floats:
    """(16, 3) middles of the cells of a parallelogram, all 80 grey levels above what is around."""
    at = (np.arange(4) + 0.5) / 4
    u, v = (w.reshape(-1, 1) for w in np.meshgrid(at, at))
    points = corners[0] + u * (corners[1] - corners[0]) + v * (corners[3] - corners[0])
    return np.column_stack([points, np.full(16, 80.0)])


def lattices(spots: Floats) -> list[Floats]:
    """The corners of each grid of 4 × 4 that there is among spots."""
    found = (lattice(group, 4) for group in groups(spots, group_sizes(4)))
    return [corners for corners in found if corners is not None]


def test_sixteen_spots_in_a_lattice_are_a_grid_half_a_pitch_larger() -> None:
    """In whatever order, and with specks beside them."""
    true = square(100.0, 80.0, 64.0, 20)
    specks = np.array([[300.0, 10.0, 80.0], [310.0, 12.0, 90.0], [200.0, 200.0, 70.0]])
    spots = np.random.default_rng(1).permutation(np.concatenate([middles(true), specks]))
    (found,) = lattices(spots)
    assert np.abs(found - true).max() < 1e-3


def test_spots_that_are_no_lattice_are_no_grid() -> None:
    """One of them half a pitch off; or fifteen of them; or every other one far brighter."""
    spots = middles(square(100.0, 80.0, 64.0, 20))
    moved, unlike = spots.copy(), spots.copy()
    moved[5, :2] += 8.0
    unlike[::2, 2] = 200.0
    assert lattices(moved) == []
    assert lattices(spots[1:]) == []
    assert lattices(unlike) == []


def test_a_spot_is_brighter_than_what_is_two_pixels_around_it() -> None:
    """By a third at least, in the picture; of several as bright side by side, it is the first."""
    picture = np.full((12, 40), 60, np.uint8)
    picture[5, 5] = 81  # 60 is 0.74 of it
    picture[5, 15] = 79  # 0.76
    picture[5:7, 25:27] = 120
    picture[2:9, 31:38] = 120 - 10 * np.maximum(np.abs(np.arange(-3, 4)), np.abs(np.arange(-3, 4))[:, None])  # a hill
    found = spots_in(picture, *contrasts(picture), 128)
    assert found.tolist() == [[5, 5, 21], [25, 5, 60]]


def test_cells_behind_a_diffuser_are_no_spots() -> None:
    """Walls between them are narrower than the dark between bare LEDs."""
    canvas = Canvas()
    canvas.panel(square(310.4, 240.2, 40.0, 20), word(7))
    candidates, _ = Finder(640, 480, 10.0).find(canvas.frame())
    assert [candidate.spots for candidate in candidates] == [False]


@pytest.mark.parametrize("side", [32.0, 60.0, 110.0, 180.0])
@pytest.mark.parametrize("turn_deg", [3, 30])
def test_a_panel_of_bare_leds_is_found_by_its_spots(turn_deg: float, side: float) -> None:
    """To 0.3 pixels: there is no edge to be seen."""
    true = square(310.4, 240.2, side, turn_deg)
    canvas = Canvas()
    canvas.panel(true, word(7), profile=bare)
    frame = canvas.frame()
    candidates, _ = Finder(640, 480, 10.0).find(frame)
    (grid,) = (candidate for candidate in candidates if candidate.spots)
    found = by_spot_centres(frame, grid.corners, 4)
    assert isinstance(found, Quad), reason(found)
    assert np.abs(found.corners_px - true).max() < 0.3


def test_without_spots_there_is_nothing_to_measure() -> None:
    """An even lamp has no middles of cells."""
    true = square(310.4, 240.2, 100.0)
    canvas = Canvas()
    canvas.lamp(square(360.0, 200.0, 90.0, 30), 0.4)
    assert reason(by_spot_centres(canvas.frame(None), true, 4)).startswith("edges.")


def test_cells_that_are_lit_throughout_are_no_spots() -> None:
    """However dark the walls between them: their sides tell more than their centres do."""
    true = square(310.4, 240.2, 100.0, 20)
    canvas = Canvas()
    canvas.panel(true, word(7), profile=behind_thick_walls)
    assert reason(by_spot_centres(canvas.frame(), true, 4)) == "edges.no_spots"


def test_what_a_lens_bends_is_seen_as_bent() -> None:
    """A barrel that moves the corners by 3 pixels, and not in line with the middles."""
    barrel = (-0.3, 0.0, 0.0, 0.0, 0.0)
    lens = Intrinsics(width=640, height=480, fx=600.0, fy=600.0, cx=310.0, cy=240.0, distortion=barrel)
    flat = square(310.0, 240.0, 240.0, 20)
    pixels = np.full((480, 640), 10.0)
    rows, columns = np.indices(pixels.shape)
    for x, y in distort((middles(flat)[:, :2] - (310.0, 240.0)) / 600.0, lens):
        pixels += 200.0 * np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / (2 * 8.0**2))
    true = distort((flat - (310.0, 240.0)) / 600.0, lens)
    frame = frame_of(np.round(pixels).astype(np.uint8))
    found, straight = by_spot_centres(frame, true, 4, lens), by_spot_centres(frame, true, 4)
    assert isinstance(found, Quad)
    assert isinstance(straight, Quad)
    assert np.abs(found.corners_px - true).max() < 0.05 < np.abs(straight.corners_px - true).max()


@pytest.mark.skipif(not COMPILED, reason="needs the compiled loops (a C compiler when ledpi was installed)")
def test_compiled_centres_are_those_of_numpy() -> None:
    """Beyond the picture and where all is as bright, too."""
    rng = np.random.default_rng(3)
    frame = frame_of(cv2.GaussianBlur(rng.integers(0, 256, (60, 80), np.uint8), (0, 0), 2.0))
    at = np.concatenate([rng.uniform((-5, -5), (85, 65), (60, 2)), [[np.nan, 10.0], [np.inf, 10.0]]])
    for reach_px in (0.9, 2.6, 7.3):
        ours, theirs = kernel.centres(frame, at, reach_px), _centres(frame, at, reach_px)
        np.testing.assert_allclose(ours, theirs, atol=1e-5)
    flat = frame_of(np.full((60, 80), 90, np.uint8))
    assert np.isnan(kernel.centres(flat, at, 5.0)).all()


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


def hot_behind_a_thin_diffuser(u: Floats, v: Floats) -> Floats:
    """The LED shines through, and between the spots there is light enough to see where the panel ends."""
    x, y = 4 * u % 1.0 - 0.5, 4 * v % 1.0 - 0.5
    return np.asarray(diffuser(u, v) * (0.3 + 0.7 * np.exp(-(x * x + y * y) / (2 * 0.2**2))))


def test_a_panel_of_spots_that_is_lit_up_to_its_sides_is_told_by_these() -> None:
    """To a tenth of a pixel, where its spots, which are not quite alike, tell it to one."""
    rng, true = np.random.default_rng(5), square(310.4, 240.2, 100.0, 3)
    canvas = Canvas(transfer="linear")
    canvas.panel(true, word(7), profile=hot_behind_a_thin_diffuser, gains=1 + 0.1 * rng.standard_normal((4, 4)))
    frame = canvas.frame()
    squares = Squares(camera_info(transfer="linear"), 4, (SPEC,), None)
    candidates, _ = squares.candidates(frame)
    assert any(candidate.spots for candidate in candidates)
    (found,) = (each for _, each in squares.of(frame, candidates) if isinstance(each, Quad))
    assert found.told_by == "sides"
    assert np.abs(found.corners_px - true).max() < 0.15
