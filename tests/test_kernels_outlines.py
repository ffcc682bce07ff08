"""What the compiled loops find lit, its outlines and its squares are those that OpenCV and numpy find."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from ledpi.decode.four_sides import Squares, distinct
from ledpi.decode.lit import Lit
from ledpi.decode.outlines import Outlines
from ledpi.kernels.library import COMPILED
from ledpi.records import Floats, Pixels

pytestmark = pytest.mark.skipif(not COMPILED, reason="needs the compiled loops (a C compiler when ledpi was installed)")


def lit_of(*rows: str) -> Pixels:
    """A picture drawn with # for what is lit."""
    return np.array([[255 * (c == "#") for c in row] for row in rows], np.uint8)


def found_in(lit: Pixels, shortest: int, *, compiled: bool) -> tuple[list[tuple[float, list[list[int]]]], int]:
    """Area and points of each outline, in an order that does not depend on who follows them."""
    found = Outlines(*lit.shape, compiled=compiled).of(lit, shortest)
    return sorted(
        (float(own["area"]), sorted(found.points[own["first"] :][: own["length"]].tolist())) for own in found.outlines
    ), found.at_border


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
    """Middles and lengths of all small outlines but at the border; holes are none."""
    lit = 255 * (np.random.default_rng(7).random((50, 70)) < 0.4).astype(np.uint8)
    ours, theirs = (Outlines(50, 70, compiled=compiled).of(lit, 10).spots for compiled in (True, False))
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


def shapes(seed: int) -> Pixels:
    """Four-sided things with rounded and cut corners, triangles and blots, side by side."""
    rng, lit = np.random.default_rng(seed), np.zeros((200, 400), np.uint8)
    for k in range(8):
        middle, size = np.array([50 + 100 * (k % 4), 50 + 100 * (k // 4)]), rng.uniform(4, 40)
        angles = rng.uniform(0, 2 * np.pi) + np.array([0.0, 0.5, 1.0, 1.5]) * np.pi + rng.normal(0, 0.2, 4)
        corners = size * np.stack([np.cos(angles), rng.choice([0.25, 1.0]) * np.sin(angles)], axis=1)
        cut = corners[1] + 0.3 * (corners[[0, 2]] - corners[1])  # of the second one
        chosen = (corners, corners[:3], np.insert(np.delete(corners, 1, axis=0), [1, 1], cut, axis=0))[rng.choice(3)]
        cv2.fillConvexPoly(lit, np.round(middle + chosen).astype(np.int32), 255)
    return cv2.GaussianBlur(lit, (0, 0), rng.uniform(0.5, 2)) // 128 * 255


def squares_in(lit: Pixels, *, compiled: bool) -> tuple[Floats, int, int]:
    """Of one picture, in its own pixels, and in an order that does not depend on who finds them."""
    found = Outlines(*lit.shape, compiled=compiled).of(lit, 10)
    squares, *refused = Squares(lit.shape[0], compiled=compiled).among(found, 1.0, 9.0)
    return squares[np.lexsort(squares.T)], *refused


def test_squares_are_those_of_the_reference() -> None:
    """Corners from the same one on, side, misfit; and how many are refused, for either reason."""
    found = np.zeros(3, int)
    for seed in range(20):
        (ours, *ours_refused), (theirs, *theirs_refused) = (
            squares_in(shapes(seed), compiled=compiled) for compiled in (True, False)
        )
        assert ours_refused == theirs_refused
        np.testing.assert_allclose(ours, theirs, atol=1e-6)
        found += (len(ours), *ours_refused)
    assert (found > 5).all()


def test_distinct_squares_are_those_of_the_reference() -> None:
    """The same of many that lie across each other, in the same order."""
    rng = np.random.default_rng(3)
    size = rng.uniform(8, 40, (60, 1, 1))
    corners = rng.uniform(0, 60, (60, 1, 2)) + size * np.array([[0, 0], [1, 0], [1, 1], [0, 1]])
    numbers = np.column_stack([size[:, 0], rng.uniform(0, 0.3, 60), rng.choice([3.0, 6.0, 12.0], 60)])
    squares = np.column_stack([corners.reshape(60, 8), numbers])
    ours, theirs = (distinct(squares, compiled=compiled) for compiled in (True, False))
    np.testing.assert_array_equal(ours, theirs)
    assert 10 < len(ours) < 55


@pytest.mark.parametrize("size", [(1, 1), (3, 9), (30, 40), (75, 111)], ids=str)
def test_what_is_lit_is_what_opencv_says(size: tuple[int, int]) -> None:
    """By either threshold, opened or not, in pictures that end within a window too."""
    rng = np.random.default_rng(5)
    picture = cv2.GaussianBlur(rng.integers(0, 256, size).astype(np.uint8), (0, 0), 1.5)
    ours, theirs = (Lit(*size, compiled=compiled) for compiled in (True, False))
    for share, opened in ((128, False), (179, True)):
        ours.look(picture)
        theirs.look(picture)
        np.testing.assert_array_equal(ours.by(share, opened=opened), theirs.by(share, opened=opened))
    assert min(size) < 30 or 0.1 < np.mean(ours.by(128, opened=False) > 0) < 0.9


@pytest.mark.parametrize("compiled", [True, False], ids=["compiled", "OpenCV"])
@pytest.mark.parametrize(
    ("brightest", "here", "is_lit"), [(150, 125, False), (150, 126, True), (120, 116, False), (120, 117, True)]
)
def test_light_halfway_between_is_not_lit(brightest: int, here: int, is_lit: bool, compiled: bool) -> None:
    """From 100 to 150 the threshold is 125, and nowhere is it less than 16 above the darkest."""
    lit, picture = Lit(9, 9, compiled=compiled), np.full((9, 9), 100, np.uint8)
    picture[0], picture[4:7, 3:6] = brightest, here
    lit.look(picture)
    assert bool(lit.by(128, opened=False)[5, 4]) is is_lit
