"""Outlines of lit squares: every panel with a clear one is among them, and what is dropped says why."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest

from ledpi.core.geometry import quad_side
from ledpi.core.records import Floats, Frame, Transfer
from ledpi.decode.finding.outlines import Finder
from tests.builders.decode import Canvas, flat, square, word

MIN_PX = 10.0


def find(frame: Frame) -> tuple[list[Floats], list[str]]:
    found, dropped = Finder(640, 480, MIN_PX).find(frame)
    return list(found), [rejected.key for rejected in dropped]


def matches(found: list[Floats], corners: Floats) -> list[Floats]:
    """Those whose corners, from whichever on, are within a tenth of the side, or three pixels."""
    within = max(3.0, 0.1 * quad_side(corners.tolist()))
    turned = [np.roll(corners, turn, axis=0) for turn in range(4)]
    return [at for at in found if min(float(np.abs(at - true).max()) for true in turned) < within]


@pytest.mark.parametrize("transfer", ["linear", "srgb"])
@pytest.mark.parametrize("side", [14, 50, 380])
def test_a_panel_of_any_size_is_found(side: float, transfer: Transfer) -> None:
    """From some metres away to one that nearly fills the picture: one candidate, its corners within the tolerance."""
    corners = square(310.3, 236.6, side, 8)
    canvas = Canvas(transfer=transfer)
    canvas.panel(corners, word(7))
    found, _ = find(canvas.frame())
    assert len(found) == 1
    assert len(matches(found, corners)) == 1


@pytest.mark.parametrize("turn_deg", [0, 20, 45, 70])
def test_corners_run_clockwise_from_the_top_left(turn_deg: float) -> None:
    """As seen in the picture, whichever way up the panel hangs; the first is the one nearest the top left."""
    canvas = Canvas()
    canvas.panel(square(320, 240, 90, turn_deg), word(7))
    ((candidate,), _) = find(canvas.frame())
    along = np.roll(candidate, -1, axis=0) - candidate
    onward = np.roll(along, -1, axis=0)
    assert (along[:, 0] * onward[:, 1] - along[:, 1] * onward[:, 0] > 0).all()
    assert np.argmin(candidate.sum(axis=1)) == 0


def test_several_panels_are_found() -> None:
    """Near and far ones in one picture, and one turned by 70°, which is a narrow trapezium."""
    oblique = np.array([[420.0, 280], [462, 295], [462, 385], [420, 400]])
    places = [square(100, 100, 40), square(300, 150, 120, 12), square(560, 380, 25, -5), square(150, 350, 80), oblique]
    canvas = Canvas()
    for place in places:
        canvas.panel(place, word(23))
    found, _ = find(canvas.frame())
    assert [len(matches(found, place)) for place in places] == [1, 1, 1, 1, 1]


@pytest.mark.parametrize("side", [40, 100])
def test_neighbours_are_distinguished(side: float) -> None:
    """Two panels with half a cell of wall between them, and a bright window a cell away, are three things."""
    gap = side / 8
    left, right = square(250, 240, side), square(250 + side + gap, 240, side)
    canvas = Canvas()
    canvas.panel(left, word(7))
    canvas.panel(right, word(23))
    canvas.lamp(square(250, 240 - side - 2 * gap, side), 0.9)
    found, _ = find(canvas.frame())
    assert len(matches(found, left)) == 1
    assert len(matches(found, right)) == 1


def test_a_dim_panel_in_a_bright_room_is_found() -> None:
    """The light next to the panel decides, not the brightest in the picture."""
    corners = square(200, 240, 80)
    canvas = Canvas(background=0.05)
    canvas.light += np.linspace(0, 0.1, 640)
    canvas.lamp(square(520, 150, 150), 0.95)
    canvas.panel(corners, word(7), light=0.15)
    found, _ = find(canvas.frame())
    assert len(matches(found, corners)) == 1


@pytest.mark.parametrize("transfer", ["linear", "srgb"])
@pytest.mark.parametrize("background", [0.0, 0.05, 0.5])
def test_an_empty_noisy_picture_holds_nothing(background: float, transfer: Transfer) -> None:
    """Neither darkness nor an evenly lit wall, with noise and a slow slope of light, looks like a panel."""
    canvas = Canvas(background=background, transfer=transfer)
    canvas.light *= np.linspace(0.7, 1.3, 640)
    found, _ = find(canvas.frame())
    assert found == []


@pytest.mark.parametrize("place", [(20, 240), (620, 240), (320, 10), (320, 470)])
def test_a_panel_cut_by_the_picture_is_dropped_as_such(place: tuple[float, float]) -> None:
    """Part of it is out of view, on whichever side."""
    canvas = Canvas()
    canvas.panel(square(*place, 80), word(7), profile=flat)
    found, dropped = find(canvas.frame())
    assert found == []
    assert "find.at_picture_border" in dropped


def test_what_is_too_small_or_has_not_four_sides_is_dropped_as_such() -> None:
    """A square smaller than asked for, and a triangle of light."""
    canvas = Canvas()
    canvas.panel(square(100, 100, 25), word(7))
    cv2.fillPoly(canvas.light, [np.array([[250, 300], [390, 300], [320, 180]])], 0.4)
    found, dropped = Finder(640, 480, smallest_px=40.0).find(canvas.frame())
    assert len(found) == 0
    assert {rejected.key for rejected in dropped} >= {"find.too_small", "find.not_four_sided"}


def test_a_finder_keeps_nothing_of_the_last_picture() -> None:
    """Its work space is used again: an empty picture after a full one holds nothing, and the same gives the same."""
    canvas = Canvas()
    canvas.panel(square(320, 240, 100), word(7))
    finder = Finder(640, 480, MIN_PX)
    first = finder.find(canvas.frame())[0].copy()
    nothing, _ = finder.find(Canvas().frame())
    again, _ = finder.find(canvas.frame())
    assert len(nothing) == 0
    np.testing.assert_array_equal(first[0], again[0])


def test_a_panel_beside_something_darker_than_the_wall_is_found() -> None:
    """Half-way from black to its light is darker than the wall around; some grey level tells it from both."""
    true = square(310.4, 240.2, 30, 40)
    canvas = Canvas(background=0.14)
    canvas.panel(true, word(7), light=0.45)
    before = square(310.4, 240.2, 42, 40)
    canvas.lamp(np.array([before[0], before[1], 0.5 * (true[1] + before[1]), 0.5 * (true[0] + before[0])]), 0.0)
    found, _ = find(canvas.frame())
    assert len(matches(found, true)) == 1


@pytest.mark.parametrize("background", [0.02, 0.06, 0.1])
def test_a_panel_without_a_bezel_on_a_bright_mottled_wall_is_found(background: float) -> None:
    """The wall's blots are as bright as half of the panel's light, and run up to it."""
    rng, true = np.random.default_rng(1), square(310.4, 240.2, 70, 25)
    canvas = Canvas(background=0.0)
    blots = cv2.GaussianBlur(rng.standard_normal((480, 640)), (0, 0), 8.0)
    canvas.light += background * np.clip(1.0 + 0.5 * blots / blots.std(), 0.1, 2.0)
    canvas.panel(true, word(7), light=0.45)
    found, _ = find(canvas.frame(1))
    assert len(matches(found, true)) == 1


def test_a_panels_cells_are_no_panels() -> None:
    """Walls stand between them, and each is a square of its own: what they make up is looked at, they are not."""
    true = square(310.4, 240.2, 200, 10)
    canvas = Canvas()
    canvas.panel(true, word(7))
    found, _ = find(canvas.frame())
    assert [round(quad_side(candidate.tolist()) / 200, 1) for candidate in found] == [1.0]


def test_a_ring_is_no_lit_square() -> None:
    """Beside a wide dark bezel the wall is lit, all around: what shines is the square within."""
    canvas = Canvas(background=0.03, transfer="linear")
    canvas.lamp(square(320.4, 240.2, 170), light=0.002)
    canvas.lamp(square(320.4, 240.2, 146), light=0.4)
    found, _ = find(canvas.frame())
    assert [round(quad_side(candidate.tolist()) / 146, 1) for candidate in found] == [1.0]


@pytest.mark.parametrize("size", [(1, 1), (3, 5), (16, 640), (480, 16)])
def test_a_picture_too_small_for_any_panel_holds_none(size: tuple[int, int]) -> None:
    """A recording may be cut down to whatever its maker cared for; halved four times nothing is left of it."""
    height, width = size
    pixels = np.random.default_rng(1).integers(0, 256, size, np.uint8)
    frame = dataclasses.replace(Canvas().frame(), pixels=pixels)
    assert len(Finder(width, height, MIN_PX).find(frame)[0]) == 0
