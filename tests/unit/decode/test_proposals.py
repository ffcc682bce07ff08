"""Proposals hold every panel, nearly enough for a fit; what they cost is bounded."""

from __future__ import annotations

import itertools
import math

import cv2
import numpy as np
import pytest

from ledpi.core.geometry import quad_side
from ledpi.core.records import Floats, Frame, Pixels
from ledpi.decode.agenda import alone
from ledpi.decode.finding.find import LatticeSearcher
from ledpi.decode.proposals import Candidate, Proposer
from tests.builders.decode import (
    SHORT_US,
    SPEC,
    TRUE_10_MS_US,
    Canvas,
    Profile,
    bare,
    camera_info,
    diffuser,
    flat,
    one_size,
    square,
    word,
)

NEAR = 0.2  # of the side, from corner to corner: from there a fit still finds the panel, mostly


def proposals(frame: Frame) -> list[Candidate]:
    proposer = Proposer(camera_info(exposure_us=frame.exposure_us), 4, (SPEC,))
    return proposer.propose(frame)[0]


def with_moved_ends(frame: Frame) -> list[Floats]:
    return [at for candidate in proposals(frame) for at in (candidate.corners_px, *candidate.moved_ends())]


def off_by(corners: Floats, true: Floats) -> float:
    """Distance of the farthest corner, in sides, whichever corner comes first."""
    turned = (np.roll(true, turn, axis=0) for turn in range(4))
    far_px = min(float(np.linalg.norm(corners - at, axis=1).max()) for at in turned)
    return far_px / quad_side(true.tolist())


def nearest(frame: Frame, true: Floats) -> float:
    return min((off_by(at, true) for at in with_moved_ends(frame)), default=math.inf)


@pytest.mark.parametrize("profile", [flat, diffuser, one_size, bare])
@pytest.mark.parametrize("exposure_us", [SHORT_US, TRUE_10_MS_US])
@pytest.mark.parametrize("side", [26, 60, 240])
def test_a_panel_is_among_the_proposals(side: float, exposure_us: float, profile: Profile) -> None:
    """Within what the fit starts from, at any size and exposure, however its cells are lit."""
    true = square(310.3, 236.6, side, 20)
    for black, white in ((0.1, 0.6), (0.35, 0.2), (0.8, 0.9)):
        canvas = Canvas(exposure_us=exposure_us)
        canvas.panel(true, word(7), profile=profile, phases=(black, white))
        assert nearest(canvas.frame(), true) < NEAR


@pytest.mark.parametrize("exposure_us", [SHORT_US, TRUE_10_MS_US])
@pytest.mark.parametrize("turn_deg", [0, 33])
@pytest.mark.parametrize("yaw_deg", [70])
def test_an_oblique_panel_is_among_them(yaw_deg: float, turn_deg: float, exposure_us: float) -> None:
    """At 0.6 m, turned in the picture by any angle."""
    half = square(0, 0, 0.16, turn_deg)
    depth_m = 0.6 + half[:, :1] * math.sin(math.radians(yaw_deg))
    true = (310.3, 240.6) + 640 * half * (math.cos(math.radians(yaw_deg)), 1.0) / depth_m
    canvas = Canvas(exposure_us=exposure_us)
    canvas.panel(true, word(7))
    assert nearest(canvas.frame(), true) < NEAR


@pytest.mark.parametrize("exposure_us", [SHORT_US, TRUE_10_MS_US])
def test_corners_run_clockwise_and_no_two_are_the_same(exposure_us: float) -> None:
    """As seen in the picture, of a panel and of what lies around it: a quarter of a cell apart, or of other sizes."""
    canvas = Canvas(exposure_us=exposure_us)
    canvas.lamp(square(310, 240, 200, 10), 0.1)
    canvas.panel(square(310, 240, 90, 30), word(7))
    found = proposals(canvas.frame())
    assert found
    for candidate in found:
        along = np.roll(candidate.corners_px, -1, axis=0) - candidate.corners_px
        onward = np.roll(along, -1, axis=0)
        assert (along[:, 0] * onward[:, 1] - along[:, 1] * onward[:, 0]).sum() > 0
    for one, other in itertools.combinations(found, 2):
        apart = np.linalg.norm(one.corners_px - other.corners_px, axis=1).max()
        assert apart > 0.2 * one.side_px / 4 or abs(one.side_px - other.side_px) > 0.2 * one.side_px / 4


@pytest.mark.parametrize("exposure_us", [SHORT_US, TRUE_10_MS_US])
def test_a_page_of_print_makes_no_more_than_so_many(exposure_us: float) -> None:
    """Whatever a picture shows, what is proposed is bounded."""
    rng, canvas = np.random.default_rng(1), Canvas(exposure_us=exposure_us)
    page = np.kron(rng.random((60, 80)) < 0.5, np.ones((8, 8)))
    canvas.light = np.where(page, 0.5, 0.02)
    assert len(proposals(canvas.frame())) <= 256


@pytest.mark.parametrize("exposure_us", [SHORT_US, TRUE_10_MS_US])
@pytest.mark.parametrize("background", [0.0, 0.05, 0.5])
def test_an_empty_noisy_picture_has_none(background: float, exposure_us: float) -> None:
    """Neither darkness nor an evenly lit wall, with noise and a slow slope of light."""
    canvas = Canvas(background=background, exposure_us=exposure_us)
    canvas.light *= np.linspace(0.7, 1.3, 640)
    assert proposals(canvas.frame()) == []


def test_what_does_not_blink_is_not_in_the_way_where_bands_are_deep() -> None:
    """A panel among sixty steady squares at 150 µs is one of the first: they show no change within a band."""
    canvas = Canvas(exposure_us=SHORT_US)
    for x, y in itertools.product(range(40, 640, 62), range(40, 480, 66)):
        if math.dist((x, y), (310, 240)) > 90:
            canvas.lamp(square(x, y, 24, x % 30), 0.5)
    true = square(310.3, 240.6, 80, 12)
    canvas.panel(true, word(7))
    best = proposals(canvas.frame())[:6]
    assert min(off_by(each.corners_px, true) for each in best) < NEAR


def test_a_frame_by_itself_tries_a_panel_before_larger_windows() -> None:
    """A fit of what is no panel costs as much, and the panel that is read excludes what lies on it."""
    canvas = Canvas()
    for x, y in itertools.product((110, 530), (110, 370)):
        canvas.lamp(square(x, y, 180, x % 30), 0.3)
        canvas.light[y - 110 : y + 110, x - 20 : x + 10] *= 0.4  # a bar
    true = square(310.3, 240.6, 70, 12)
    canvas.panel(true, word(7))
    first, *others = alone(proposals(canvas.frame()))
    assert off_by(first.corners_px, true) < NEAR
    assert any(other.side_px > 1.3 * first.side_px for other in others)


# ---- Lattices of cells


def blobs(places: Floats, radius: float, noise: float = 0.0) -> Pixels:
    """(480, 640) round spots on grey."""
    down, across = np.mgrid[:480, :640]
    light = np.full((480, 640), 20.0) + noise * np.random.default_rng(1).standard_normal((480, 640))
    for x, y in places:
        light += 150 * np.clip(radius + 0.5 - np.hypot(across - x, down - y), 0, 1)
    return np.clip(light, 0, 255).astype(np.uint8)


def middles(corners: Floats, cells: int = 4) -> Floats:
    """(cells², 2) of the cells of a panel, seen in perspective."""
    at = (np.arange(cells) + 0.5) / cells
    points = np.stack(np.meshgrid(at, at), axis=-1).reshape(-1, 1, 2)
    unit = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
    return np.asarray(cv2.perspectiveTransform(points, cv2.getPerspectiveTransform(unit, corners.astype(np.float32))))[
        :, 0
    ]


def lattices_of(picture: Pixels, cells: int = 4) -> list[Floats]:
    half = cv2.resize(picture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    return list(LatticeSearcher(*picture.shape, cells).search([picture, half]))


TRAPEZIUM = np.array([[270.0, 170], [350, 195], [350, 285], [270, 310]])
SEEN = [
    square(310, 240, 100),
    square(310, 240, 60, 20),
    square(310, 240, 100, 45),
    square(300, 200, 100, 80),
    TRAPEZIUM,
]


@pytest.mark.parametrize("turn_deg", [0, 20, 45])
def test_a_small_panel_before_a_wall_as_bright_as_it_is(turn_deg: float) -> None:
    """It has 18 px, cells of 4½: no grey level tells it from the wall, but the gaps between its cells do."""
    true = square(310.3, 236.6, 18, turn_deg)
    canvas = Canvas(background=0.4)
    canvas.panel(true, word(7), light=0.45)
    assert nearest(canvas.frame(), true) < NEAR / 2


@pytest.mark.parametrize("corners", SEEN)
def test_cells_seen_one_by_one_make_a_lattice(corners: Floats) -> None:
    """Turned by any angle, and in perspective: to a tenth of a cell."""
    radius = 0.3 * quad_side(corners.tolist()) / 4
    found = lattices_of(blobs(middles(corners), radius))
    assert min(off_by(at, corners) for at in found) < 0.025


@pytest.mark.parametrize("missing", [(), (0,), (3, 12), (1, 6, 11)])
def test_cells_may_be_missing(missing: tuple[int, ...]) -> None:
    """At a corner and within, and specks of other sizes beside: what is left still tells where all are."""
    corners, rng = square(310, 240, 100, 20), np.random.default_rng(4)
    beside = rng.uniform((20, 20), (620, 460), (60, 2))
    beside = beside[np.hypot(*(beside - 310 + (0, 70)).T) > 90]
    picture = blobs(np.delete(middles(corners), missing, axis=0), 8.0)
    found = lattices_of(np.maximum(picture, blobs(beside, 4.0)))
    assert min(off_by(at, corners) for at in found) < 0.05


def test_where_most_cells_are_seen_comes_first() -> None:
    """Three spots of a further row are seen: the panel comes before the lattice that is a row off."""
    corners = square(310, 240, 100, 20)
    below = middles(corners)[-4:-1] + (corners[3] - corners[0]) / 4
    picture = blobs(np.concatenate([np.delete(middles(corners), 1, axis=0), below]), 8.0)
    assert off_by(lattices_of(picture)[0], corners) < 0.05


def test_of_inner_cells_alone_only_full_ones_make_a_panel() -> None:
    """Spots that leave a cell mostly dark would all be seen by themselves."""
    corners = square(310, 240, 100)
    inner = middles(corners).reshape(4, 4, 2)[1:3, 1:3].reshape(-1, 2)
    assert lattices_of(blobs(inner, 8.0)) == []
    (found,) = lattices_of(blobs(inner, 11.0))[:1]
    assert off_by(found, corners) < 0.05


@pytest.mark.slow
def test_of_a_larger_lattice_none_is_taken() -> None:
    """A wall of tiles is no panel; of five by five spots each part may be one."""
    across, down = np.meshgrid(np.arange(40, 620, 26.0), np.arange(40, 460, 26.0))
    wall = np.stack([across, down], axis=-1).reshape(-1, 2)
    assert lattices_of(blobs(wall, 8.0)) == []
    five = middles(square(310, 240, 130), 5)
    parts = lattices_of(blobs(five, 8.0))
    expected = [square(310 + dx, 240 + dy, 104) for dx in (-13, 13) for dy in (-13, 13)]
    assert all(min(off_by(at, part) for at in parts) < 0.05 for part in expected)


def test_a_dictionary_of_six_by_six_has_other_lattices() -> None:
    """Sixteen cells are then no panel, and thirty-six are."""
    corners = square(310, 240, 150, 10)
    assert lattices_of(blobs(middles(corners), 12.0), cells=6) == []
    assert min(off_by(at, corners) for at in lattices_of(blobs(middles(corners, 6), 8.0), cells=6)) < 0.05


# ---- Before something bright


@pytest.mark.parametrize("wide", [0.06, 0.1, 0.15])
@pytest.mark.parametrize("side", [70, 170])
def test_a_panel_in_a_bright_frame_is_among_them(side: float, wide: float) -> None:
    """The frame, half as bright and `wide` sides wide, has the clearer outline."""
    true = square(310.4, 240.2, side, 20)
    canvas = Canvas(background=0.02)
    canvas.lamp(square(310.4, 240.2, side * (1 + 2 * wide), 20), 0.2)
    canvas.panel(true, word(7), light=0.4)
    assert nearest(canvas.frame(), true) < NEAR


# ---- What changes within a band


def test_a_panel_in_pieces_is_proposed_whole() -> None:
    """At 150 µs whole rows of cells are dark, of a panel that stands upright: not only what shines is proposed."""
    for phase in np.arange(0, 1, 0.2):
        true = square(310.3, 240.6, 52)
        canvas = Canvas(exposure_us=SHORT_US)
        canvas.panel(true, word(7), phases=(phase, 3 * phase + 0.4))
        assert nearest(canvas.frame(), true) < NEAR


@pytest.mark.parametrize(("exposure_us", "more"), [(SHORT_US, 6), (TRUE_10_MS_US, 0)])
def test_ends_are_moved_where_dark_bands_may_hide_them(exposure_us: float, more: int) -> None:
    """Up, down, or one of them, by as much on the left as on the right; faint bands cut nothing off."""
    canvas = Canvas(exposure_us=exposure_us)
    canvas.panel(square(310, 240, 90, 5), word(7))
    first = proposals(canvas.frame())[0]
    moved = first.moved_ends()
    assert len(moved) == more
    for at in moved:
        by = at - first.corners_px
        assert not by[:, 0].any()
        assert 1.0 < np.abs(by[:, 1]).max() < first.dark_rows / 2.0
