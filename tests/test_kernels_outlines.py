"""Outlines that the compiled loops follow are those that OpenCV finds."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from ledpi.decode.find import _through_sides
from ledpi.decode.outlines import Outlines
from ledpi.kernels.library import COMPILED
from ledpi.records import Pixels

pytestmark = pytest.mark.skipif(not COMPILED, reason="needs the compiled loops (a C compiler when ledpi was installed)")


def lit_of(*rows: str) -> Pixels:
    """A picture drawn with # for what is lit."""
    return np.array([[255 * (c == "#") for c in row] for row in rows], np.uint8)


def found_in(lit: Pixels, shortest: int, *, compiled: bool) -> tuple[list[tuple[float, list[list[int]]]], int]:
    """Area and points of each outline, in an order that does not depend on who follows them."""
    outlines, at_border, _ = Outlines(*lit.shape, compiled=compiled).of(lit, shortest)
    return sorted((o.area, sorted(o.points[:, 0].tolist())) for o in outlines), at_border


@pytest.mark.parametrize("share", [0.3, 0.6, 0.8])
def test_outlines_of_anything(share: float) -> None:
    """Specks, holes, things in holes, things at the border: as OpenCV has them, closed or not."""
    rng = np.random.default_rng(round(100 * share))
    for _ in range(20):
        height, width = rng.integers(3, 60, 2)
        lit = 255 * (rng.random((height, width)) < share).astype(np.uint8)
        for picture in (lit, cv2.morphologyEx(lit, cv2.MORPH_CLOSE, np.ones((3, 3), np.uint8))):
            shortest = int(rng.integers(1, 12))
            assert found_in(picture, shortest, compiled=True) == found_in(picture, shortest, compiled=False)


def test_spots_are_where_opencv_has_them() -> None:
    """Middles and lengths of all small outlines, at the border too; holes are none."""
    lit = 255 * (np.random.default_rng(7).random((50, 70)) < 0.4).astype(np.uint8)
    ours, theirs = (Outlines(50, 70, compiled=compiled).of(lit, 10)[2] for compiled in (True, False))
    assert len(ours) > 5
    assert sorted(ours.tolist()) == sorted(theirs.tolist())


@pytest.mark.parametrize("compiled", [True, False], ids=["compiled", "OpenCV"])
def test_what_is_lit_throughout(compiled: bool) -> None:
    """A square with a small hole is found, its outline's area between the centres of its pixels; a ring is not."""
    square = lit_of("........", ".#####..", ".#####..", ".##.##..", ".#####..", ".#####..", "........")
    ring = lit_of(".........", ".#######.", ".#.....#.", ".#.....#.", ".#.....#.", ".#######.", ".........")
    (only,), _ = found_in(square, 3, compiled=compiled)
    assert only[0] == 16.0
    assert len(only[1]) == 16
    assert found_in(ring, 3, compiled=compiled) == ([], 0)


@pytest.mark.parametrize("compiled", [True, False], ids=["compiled", "OpenCV"])
def test_what_touches_the_border_is_counted(compiled: bool) -> None:
    """It may go on beyond it; specks there are none of anybody's concern."""
    lit = lit_of("###....", "###...#", "###....", ".......")
    assert found_in(lit, 3, compiled=compiled) == ([], 1)


def test_sides_cross_where_they_do_in_numpy() -> None:
    """Of a slender shape, drawn with blunt corners."""
    lit = np.zeros((60, 90), np.uint8)
    cv2.fillConvexPoly(lit, np.array([[10, 20], [70, 8], [80, 20], [74, 30], [20, 41], [11, 30]]), 255)
    (outline,), _, _ = Outlines(60, 90, compiled=True).of(lit, 10)
    corners = [[10.0, 20.0], [70.0, 8.0], [78.0, 30.0], [15.0, 41.0]]
    ours, theirs = (_through_sides(corners, outline.points, compiled=compiled) for compiled in (True, False))
    np.testing.assert_allclose(ours, theirs, atol=1e-6)
    assert np.abs(np.array(ours) - corners).max() > 0.1


def test_sides_that_do_not_cross_stay() -> None:
    """Of two points there is no line."""
    corners = [[0.0, 0.0], [9.0, 0.0], [9.0, 9.0], [0.0, 9.0]]
    points = np.array([[[4, 0]], [[5, 0]]], np.int32)
    assert _through_sides(corners, points, compiled=True) == corners
