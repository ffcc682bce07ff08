"""Panels that are not wholly seen: something dark before a side, dead cells, quads too small or too large."""

from __future__ import annotations

import numpy as np
import pytest
from decode_material import Canvas, Profile, camera_info, flat, panel_settings, reason, square, word

from ledpi.decode.corners.approach import approach_quads
from ledpi.decode.corners.edges import refine_quads
from ledpi.decode.finding.find import Finder
from ledpi.geometry import undistort
from ledpi.pipeline import Pipeline
from ledpi.records import Floats, Frame, Intrinsics, Quad, Rejected
from ledpi.trace import Trace

SIDES_PX = [24.0, 60.0, 120.0]

WIDE = Intrinsics(
    width=640, height=480, fx=500.0, fy=500.0, cx=319.5, cy=239.5, distortion=(-0.28, 0.09, 0.0, 0.0, 0.0)
)


def seen(frame: Frame, rough: Floats, tolerance_px: float = 3.0) -> Quad | Rejected:
    (near,) = approach_quads(frame, rough[None], np.array([tolerance_px]))
    return near if isinstance(near, Rejected) else refine_quads(frame, near[None], 4)[0]


def farthest(found: Quad | Rejected, true: Floats) -> float:
    assert isinstance(found, Quad), reason(found)
    return float(np.linalg.norm(found.corners_px - true, axis=1).max())


def covered(true: Floats, share: float) -> tuple[Floats, Floats]:
    """What hides `share` of the left side of a panel, and what then is left of it."""
    (a, b, c, d) = true
    left = np.array([a + share * (b - a), b, c, d + share * (c - d)])
    out = 0.3 * (a - b)
    up = 0.2 * (a - d)
    return np.array([a + out + up, left[0] + up, left[3] - up, d + out - up]), left


def apart(wall: float) -> Profile:
    """Four even cells of one size, with three walls between them."""

    def light(u: Floats, v: Floats) -> Floats:
        return np.where(np.maximum((4 - wall) * u % 1, (4 - wall) * v % 1) < 1 - wall, 1.0, 0.03)

    return light


@pytest.mark.parametrize("side", SIDES_PX)
@pytest.mark.parametrize("share", [0.06, 0.09, 0.12])
def test_a_hidden_side_is_where_the_cells_tell(share: float, side: float) -> None:
    """What is left is a rectangle with all four sides; its corners would be off by the hidden share."""
    true = square(310.4, 240.2, side, 8)
    canvas = Canvas()
    canvas.panel(true, word(7))
    shade, left = covered(true, share)
    canvas.lamp(shade, 0.0)
    found = seen(canvas.frame(), left)
    assert farthest(found, true) < 0.02 * side
    assert isinstance(found, Quad)
    assert farthest(found, true) < 5 * found.corner_sigma_px


@pytest.mark.parametrize("side", [60.0, 120.0])
def test_inner_lines_tell_a_hidden_side_exactly(side: float) -> None:
    """To a fifth of a pixel, where the share of the panel that is hidden is told to half of one."""
    true = square(310.4, 240.2, side, 8)
    canvas = Canvas()
    canvas.panel(true, word(7))
    shade, left = covered(true, 0.09)
    canvas.lamp(shade, 0.0)
    assert farthest(seen(canvas.frame(), left), true) < 0.2


def test_a_stream_follows_what_is_seen_of_a_panel() -> None:
    """Its hidden side is sought where it was seen last, not 4 px further out, where the panel ends."""
    true = square(310.4, 240.2, 34.0, 40)
    shade, _ = covered(true, 0.12)
    pipeline = Pipeline(camera_info(), panel_settings(), intrinsics=None)
    for seq in range(5):
        canvas = Canvas()
        canvas.panel(true, word(7), start_us=seq * 504 * 33.67)
        canvas.lamp(shade, 0.0)
        trace = Trace()
        pipeline.decode(canvas.frame(seq, seq=seq), trace)
        (look,) = trace.looks
        assert farthest(look.quad, true) < 0.6


@pytest.mark.parametrize("side", SIDES_PX)
def test_a_whole_panel_is_left_as_it_is(side: float) -> None:
    """With cells of unlike brightness, and bands."""
    true = square(310.4, 240.2, side, 8)
    canvas = Canvas()
    canvas.panel(true, word(12), gains=np.random.default_rng(1).uniform(0.7, 1.3, (4, 4)))
    assert farthest(seen(canvas.frame(), true), true) < 0.25


@pytest.mark.parametrize("side", [60.0, 120.0, 170.0])
@pytest.mark.parametrize("wall", [0.05, 0.07, 0.1])
def test_cells_of_one_size_without_a_wall_at_the_rim_are_a_whole_panel(wall: float, side: float) -> None:
    """Three walls between four cells: these lie as if there were half a wall more at either end, which is dark."""

    true = square(310.4, 240.2, side, 8)
    canvas = Canvas()
    canvas.panel(true, word(7), profile=apart(wall))
    assert farthest(seen(canvas.frame(), true), true) < 0.15


@pytest.mark.parametrize(("wall", "side"), [(0.1, 60.0), (0.07, 120.0), (0.1, 120.0), (0.05, 170.0)])
def test_lines_tell_exactly_where_cells_of_one_size_are(wall: float, side: float) -> None:
    """Half a wall beyond each side ends their lattice, of 4 less one wall in all."""
    canvas = Canvas()
    canvas.panel(square(310.4, 240.2, side, 8), word(7), profile=apart(wall))
    found = seen(canvas.frame(), square(310.4, 240.2, side, 8))
    assert isinstance(found, Quad)
    assert found.rim_wall == pytest.approx(0.5 * wall / (4 - wall), abs=0.0015)


def test_where_lines_are_too_far_off_their_place_is_told_roughly() -> None:
    """Of a large panel: half of the 0.0128 by which its lattice is larger puts each cell's light in its own sample."""
    canvas = Canvas()
    canvas.panel(square(310.4, 240.2, 200, 8), word(7), profile=apart(0.1))
    found = seen(canvas.frame(), square(310.4, 240.2, 200, 8))
    assert isinstance(found, Quad)
    assert 0.0064 < found.rim_wall < 0.0192


@pytest.mark.parametrize("side", [60.0, 120.0])
def test_a_panel_with_a_dead_row_is_refused(side: float) -> None:
    """Three rows of four cells are lit: a rectangle, but no panel's place."""
    true = square(310.4, 240.2, side, 8)
    gains = np.ones((4, 4))
    gains[0] = 0.0
    canvas = Canvas()
    canvas.panel(true, word(7), gains=gains)
    (a, b, c, d) = true
    assert reason(seen(canvas.frame(), np.array([a + 0.25 * (d - a), b + 0.25 * (c - b), c, d]))) == "edges.not_whole"


@pytest.mark.parametrize("dead", [(0, 1), (2, 3), (0, 0)])
@pytest.mark.parametrize("side", [40.0, 110.0])
def test_one_dead_cell_does_not_move_the_corners(side: float, dead: tuple[int, int]) -> None:
    """Of the rim, or at a corner: the sides are where their other cells are."""
    true = square(310.4, 240.2, side, 8)
    gains = np.ones((4, 4))
    gains[dead] = 0.0
    canvas = Canvas()
    canvas.panel(true, word(7), gains=gains)
    assert farthest(seen(canvas.frame(), true + 0.5), true) < 0.3


def test_a_finders_corner_that_a_dead_cell_cut_off_is_put_back() -> None:
    """An outline around fifteen cells of sixteen is four-sided too, with one corner a cell too far inside."""
    true = square(310.4, 240.2, 100, 8)
    gains = np.ones((4, 4))
    gains[0, 0] = 0.0
    canvas = Canvas()
    canvas.panel(true, word(7), gains=gains)
    cut = true.copy()
    cut[0] += 0.24 * (true[2] - true[0]) / np.sqrt(2)
    assert farthest(seen(canvas.frame(), cut), true) < 0.3


@pytest.mark.parametrize("turn_deg", [12, 40])
def test_a_far_panels_corner_that_is_dead_is_put_back(turn_deg: float) -> None:
    """An outline that goes on from one end of the dead cell: its sides are not straight, but by less than a pixel."""
    true, gains = square(310.3, 236.6, 34, turn_deg), np.ones((4, 4))
    gains[0, 0] = 0.0
    canvas = Canvas()
    canvas.panel(true, word(7), gains=gains)
    cut = true.copy()
    cut[0] += 0.25 * (true[1] - true[0]) + 0.04 * (true[3] - true[0])
    assert farthest(seen(canvas.frame(), cut), true) < 0.5


@pytest.mark.parametrize("turn_deg", [8, 28, 62])
@pytest.mark.parametrize("dead", [(0, 3), (3, 0), (3, 3)])
def test_a_panel_whose_corner_is_dead_is_found_whole(dead: tuple[int, int], turn_deg: float) -> None:
    """Its outline has five corners: two of the sides cross where the panel's own corner is."""
    true, gains = square(310.3, 236.6, 100, turn_deg), np.ones((4, 4))
    gains[dead] = 0.0
    canvas = Canvas()
    canvas.panel(true, word(7), gains=gains)
    frame = canvas.frame()
    candidates, _ = Finder(640, 480, 10.0).find(frame)
    quads = [seen(frame, candidate.corners, candidate.tolerance_px) for candidate in candidates]
    squares = [q.corners_px for q in quads if isinstance(q, Quad)]
    assert min((np.abs(np.roll(s, k, axis=0) - true).max() for s in squares for k in range(4)), default=np.inf) < 0.3


def test_a_hidden_corner_does_not_move_the_others() -> None:
    """An eighth of either side at one corner is dark."""
    true = square(310.4, 240.2, 100, 8)
    (a, b, _, d) = true
    canvas = Canvas()
    canvas.panel(true, word(7))
    along, down = 0.12 * (b - a), 0.12 * (d - a)
    canvas.lamp(np.array([a - along - down, a + along - down, a + along + down, a - along + down]), 0.0)
    assert farthest(seen(canvas.frame(), true + 0.5), true) < 0.3


def test_a_finders_corner_that_is_cut_off_along_one_side_is_put_back() -> None:
    """An outline that ends where the hidden corner begins: one side is then off by 12 pixels at its end."""
    true = square(310.4, 240.2, 100, 8)
    canvas = Canvas()
    canvas.panel(true, word(7))
    canvas.lamp(square(*true[0], 24, 8), 0.0)
    rough = true.copy()
    rough[0] += 0.12 * (true[1] - true[0])
    (near,) = approach_quads(canvas.frame(), rough[None], np.array([6.0]))
    assert not isinstance(near, Rejected), reason(near)
    assert float(np.linalg.norm(near - true, axis=1).max()) < 2.0


def test_where_nothing_tells_a_quad_is_taken_as_it_is() -> None:
    """A lamp that is even all over has no cells to be in the wrong place."""
    true = square(310.4, 240.2, 80, 8)
    canvas = Canvas()
    canvas.lamp(true, 0.4, profile=flat)
    assert farthest(seen(canvas.frame(), true), true) < 0.25


@pytest.mark.parametrize(
    ("side", "turn_deg", "off_px", "towards_deg"),
    [(50.0, 0.0, 3.0, 0.0), (81.0, 8.0, 3.0, 200.0), (81.0, 8.0, 4.0, 120.0), (110.0, 30.0, 3.0, 310.0)],
)
def test_a_panel_that_is_sought_pixels_off_hides_no_side(
    side: float, turn_deg: float, off_px: float, towards_deg: float
) -> None:
    """As after a jerk: a side that does not show there is looked for where the cells tell that it is."""
    true = square(310.3, 240.6, side, turn_deg)
    canvas = Canvas(background=0.15)
    canvas.panel(true, word(7))
    towards = np.deg2rad(towards_deg)
    (found,) = refine_quads(canvas.frame(1), true[None] + off_px * np.array([np.cos(towards), np.sin(towards)]), 4)
    assert farthest(found, true) < 0.15
    assert isinstance(found, Quad)
    assert found.seen_px is None
    assert found.corner_sigma_px < 0.1


@pytest.mark.parametrize(
    "rough",
    [
        [(595.1, 283.8), (451.8, 435.7), (295.2, 308.1), (456.0, 132.4)],
        [(94.9, 253.0), (214.9, 315.0), (149.8, 443.3), (23.1, 374.7)],
    ],
)
def test_a_panel_with_thin_walls_that_a_wide_lens_bends_hides_no_side(rough: list[tuple[float, float]]) -> None:
    """Whose walls may fall between the places that are looked at along it: its corners were 3 to 5 px off."""
    near = np.array(rough)
    straight = undistort(near, WIDE) * WIDE.fx + (WIDE.cx, WIDE.cy)
    canvas = Canvas()
    canvas.panel(straight, word(7), profile=thin_walls, lens=WIDE)
    (found,) = refine_quads(canvas.frame(), near[None], 4, WIDE)
    assert isinstance(found, Quad)
    assert found.seen_px is None
    assert farthest(found, near) < 1.0


def thin_walls(u: Floats, v: Floats) -> Floats:
    """Even cells on a lattice, with walls of 7 % of a cell between them."""
    off = (np.abs(4 * w - np.clip(np.round(4 * w), 1, 3)) for w in (u, v))
    return np.where(np.minimum(*off) > 0.035, 1.0, 0.15)
