"""What the compiled loops find is what OpenCV and numpy find: lit things, their outlines, squares, spots."""

from __future__ import annotations

from functools import partial

import cv2
import numpy as np
import pytest
from decode_material import Canvas, square, word
from kernels_material import both_ways, compiled

from ledpi.decode.finding.find import AGAIN, THRESHOLDS, Finder
from ledpi.decode.finding.lit import contrasts, lit_by
from ledpi.decode.finding.outlines import outlines_in
from ledpi.records import Floats, Frame, Pixels


def frame_of(pixels: Pixels) -> Frame:
    return Frame(pixels=pixels, seq=0, row0_readout_ns=0, exposure_us=1e4, row_time_us=30.0, transfer="srgb")


def from_the_left(squares: Floats) -> Floats:
    """With the leftmost corner first: which is nearest the top left, two may be to the last bit but one."""
    turned = squares.copy()
    for row in turned:
        corners = row[:8].reshape(4, 2)
        row[:8] = np.roll(corners, -int(corners[:, 0].argmin()), axis=0).ravel()
    return turned


def assert_same(pixels: Pixels) -> tuple[int, int]:
    """That both find the same; how many squares and groups of spots these are."""
    squares_and_groups = [0, 0]
    finders = both_ways(partial(Finder, pixels.shape[1], pixels.shape[0], 12.0))
    for finder in finders:
        finder.find(frame_of(pixels))
    for thresholds in (THRESHOLDS, AGAIN):
        ours = finders[0]._searcher.search(thresholds)  # type: ignore[union-attr]
        theirs = finders[1]._search(thresholds)
        assert ours[3] == theirs[3]  # what was dropped, and why
        np.testing.assert_allclose(from_the_left(ours[0]), from_the_left(theirs[0]), atol=1e-6)
        np.testing.assert_allclose(np.sort(ours[1][:, 8:], axis=0), np.sort(theirs[1][:, 8:], axis=0), atol=1e-6)
        in_order = [sorted((scale, sorted(group.tolist())) for scale, group in found[2]) for found in (ours, theirs)]
        assert in_order[0] == in_order[1]
        squares_and_groups[0] += len(ours[0])
        squares_and_groups[1] += len(ours[2])
    return squares_and_groups[0], squares_and_groups[1]


@compiled
@pytest.mark.parametrize("blur_px", [1.0, 2.0, 4.0])
def test_anything(blur_px: float) -> None:
    """Blots of all sizes with holes and things in holes, at the border too; in pictures of odd sizes."""
    rng = np.random.default_rng(round(blur_px))
    for height, width in ((480, 640), (251, 333), (30, 40), (9, 7), (1, 1)):
        picture = cv2.GaussianBlur(rng.random((height, width)), (0, 0), blur_px)
        assert_same(cv2.normalize(picture, None, 0, 255, cv2.NORM_MINMAX, cv2.CV_8U))


@compiled
def test_four_sided_things() -> None:
    """With rounded and cut corners, slender, triangles; side by side."""
    found = 0
    for seed in range(8):
        rng, picture = np.random.default_rng(seed), np.full((480, 640), 20, np.uint8)
        for k in range(12):
            middle, size = np.array([80 + 160 * (k % 4), 80 + 160 * (k // 4)]), rng.uniform(8, 70)
            angles = rng.uniform(0, 2 * np.pi) + np.array([0.0, 0.5, 1.0, 1.5]) * np.pi + rng.normal(0, 0.2, 4)
            corners = size * np.stack([np.cos(angles), rng.choice([0.25, 1.0]) * np.sin(angles)], axis=1)
            cut = corners[1] + 0.3 * (corners[[0, 2]] - corners[1])
            shapes = (corners, corners[:3], np.insert(np.delete(corners, 1, axis=0), [1, 1], cut, axis=0))
            cv2.fillConvexPoly(picture, np.round(middle + shapes[rng.choice(3)]).astype(np.int32), 200)
        found += assert_same(cv2.GaussianBlur(picture, (0, 0), rng.uniform(0.5, 2)))[0]
    assert found > 40


@compiled
def test_spots() -> None:
    """Two grids of sixteen, with specks beside them."""
    rng, picture = np.random.default_rng(1), np.full((480, 640), 20, np.uint8)
    u, v = np.meshgrid(np.arange(4), np.arange(4))
    for middle, pitch in (((150, 200), 26), ((450, 240), 34)):
        for x, y in zip(u.ravel() - 1.5, v.ravel() - 1.5, strict=True):
            at = np.round(np.array(middle) + pitch * np.array([x - 0.3 * y, y + 0.3 * x])).astype(int)
            cv2.circle(picture, at.tolist(), 5, 220, -1)
    for at in rng.integers(10, 70, (6, 2)).tolist():
        cv2.circle(picture, at, 4, 200, -1)
    assert assert_same(cv2.GaussianBlur(picture, (0, 0), 1.0))[1] >= 2


@compiled
def test_more_spots_than_are_looked_at() -> None:
    """Are texture, to both."""
    picture = np.full((480, 640), 20, np.uint8)
    picture[10:470:20, 10:630:20] = 255
    assert assert_same(cv2.GaussianBlur(picture, (0, 0), 2.0))[1] == 0


@compiled
def test_panels() -> None:
    """As they look, with cells and walls: large, small, turned."""
    canvas = Canvas()
    for place in (square(120, 130, 160, 7), square(330, 110, 60, -20), square(450, 330, 200, 40), square(250, 380, 20)):
        canvas.panel(place, word(7))
    assert assert_same(canvas.frame().pixels)[0] >= 4


# ---- The reference itself


def lit_of(*rows: str) -> Pixels:
    """A picture drawn with # for what is lit."""
    return np.array([[255 * (c == "#") for c in row] for row in rows], np.uint8)


def test_what_is_lit_throughout() -> None:
    """A square with a small hole is found, its outline's area between the centres of its pixels; a ring is not."""
    square_with_hole = lit_of("........", ".#####..", ".#####..", ".##.##..", ".#####..", ".#####..", "........")
    ring = lit_of(".........", ".#######.", ".#.....#.", ".#.....#.", ".#.....#.", ".#######.", ".........")
    (only,), _ = outlines_in(square_with_hole, 3)
    assert only.area == 16.0
    assert len(only.points) == 16
    assert outlines_in(ring, 3)[0] == []


def test_what_touches_the_border_is_counted() -> None:
    """It may go on beyond it; specks there are none of anybody's concern."""
    found, at_border = outlines_in(lit_of("###....", "###...#", "###....", "......."), 3)
    assert (found, at_border) == ([], 1)


@pytest.mark.parametrize(
    ("brightest", "here", "is_lit"), [(150, 125, False), (150, 126, True), (120, 116, False), (120, 117, True)]
)
def test_light_halfway_between_is_not_lit(brightest: int, here: int, is_lit: bool) -> None:
    """From 100 to 150 the threshold is 125, and nowhere is it less than 16 above the darkest."""
    picture = np.full((9, 9), 100, np.uint8)
    picture[0], picture[4:7, 3:6] = brightest, here
    assert bool(lit_by(128, *contrasts(picture), opened=False)[5, 4]) is is_lit
