"""The light of each cell: from the right place, in linear light, without what was saturated."""

from __future__ import annotations

import dataclasses

import cv2
import numpy as np
import pytest

from ledpi.core.records import Floats, Frame, Intrinsics, Quad, Transfer
from ledpi.decode.evidence.cells import CellSamples, sample_cells
from tests.builders.decode import LENS, Canvas, quad, reason, seen_through, square, word

# Each cell has a level of its own, so that what is sampled tells where it came from.
LEVELS = 0.1 + 0.05 * np.random.default_rng(5).permutation(16).reshape(4, 4)


def chequered(u: Floats, v: Floats) -> Floats:
    row, column = (np.clip((4 * w).astype(int), 0, 3) for w in (v, u))
    return np.asarray(LEVELS[row, column])


def picture(corners: Floats, transfer: Transfer = "srgb", lens: Intrinsics | None = None) -> Frame:
    """A steady light of LEVELS between known corners, without noise."""
    canvas = Canvas(transfer=transfer)
    canvas.lamp(corners, 1.0, profile=chequered, lens=lens)
    return canvas.frame(None)


def sampled(frame: Frame, where: Quad, lens: Intrinsics | None = None) -> CellSamples:
    samples = sample_cells(frame, where, 4, lens)
    assert isinstance(samples, CellSamples), reason(samples)
    return samples


def means(samples: CellSamples) -> Floats:
    """(4, 4) mean light of the valid samples of each cell, from the quad's first corner on."""
    valid = np.ones(samples.light.shape, bool) if samples.valid is None else samples.valid
    return np.asarray((samples.light * valid).sum(axis=1) / valid.sum(axis=1)).reshape(4, 4)


def middle(samples: CellSamples) -> Floats:
    """(4, 4) median light of each cell: free of what the blur brings in from its neighbours."""
    return np.median(samples.light, axis=1).astype(float).reshape(4, 4)


SHAPES = {
    "small": square(310.3, 240.6, 24),
    "upright": square(310.3, 240.6, 100),
    "turned": square(310.3, 240.6, 90, 33),
    "large": square(310.3, 240.6, 390, 2),
    "oblique": np.array([[300.3, 180.6], [351.7, 192.2], [352.1, 287.4], [299.8, 301.9]]),
}


@pytest.mark.slow
@pytest.mark.parametrize("shape", ["small", "upright", "turned", "large"])
def test_cells_whose_lattice_ends_beyond_the_sides(shape: str) -> None:
    """As those of a quad that is as large as the lattice."""
    corners = SHAPES[shape]
    frame, centre = picture(corners), corners.mean(axis=0)
    beyond = sampled(frame, dataclasses.replace(quad(corners), lattice_px=centre + 1.04 * (corners - centre)))
    larger = sampled(frame, quad(centre + 1.04 * (corners - centre)))
    np.testing.assert_allclose(beyond.rows, larger.rows, atol=1e-3)


@pytest.mark.parametrize("transfer", ["linear", "srgb"])
@pytest.mark.parametrize("shape", SHAPES)
def test_each_cell_gives_its_own_light(shape: str, transfer: Transfer) -> None:
    """Row by row from the quad's first corner, in linear light whatever the camera's transfer."""
    samples = sampled(picture(SHAPES[shape], transfer), quad(SHAPES[shape]))
    np.testing.assert_allclose(middle(samples), LEVELS, rtol=0.12 if shape == "small" else 0.02)


def test_the_lattice_is_the_same_in_each_cell() -> None:
    """A diffuser's hot spot appears at the same samples of every cell, however the panel is seen."""

    def hot_spots(u: Floats, v: Floats) -> Floats:
        x, y = 4 * u % 1.0 - 0.4, 4 * v % 1.0 - 0.6
        return 0.3 + 0.5 * np.exp(-(x * x + y * y) / 0.05)

    canvas = Canvas()
    canvas.lamp(SHAPES["oblique"], 1.0, profile=hot_spots)
    light = sampled(canvas.frame(None), quad(SHAPES["oblique"])).light
    common = light.mean(axis=0)
    assert np.ptp(common) > 0.2
    # Within 8 % of the spot's height: what the blur does differs with the size of a cell.
    np.testing.assert_allclose(light, np.broadcast_to(common, light.shape), atol=0.04)


def test_a_square_that_the_lens_bends_is_followed() -> None:
    """Near the picture's corner, where a flat square's middle is off by more than a pixel."""
    straight = square(490, 350, 230, 3)
    corners = seen_through(LENS, straight)
    samples = sampled(picture(straight, lens=LENS), quad(corners), LENS)
    np.testing.assert_allclose(middle(samples), LEVELS, rtol=0.02)
    # The centres of the first and the last cell lie on the diagonal, an eighth from its ends.
    ends = seen_through(LENS, straight[0] + (straight[2] - straight[0]) * np.array([[0.125], [0.875]]))
    rows = samples.rows.mean(axis=1).reshape(4, 4)
    np.testing.assert_allclose([rows[0, 0], rows[3, 3]], ends[:, 1], atol=0.3)


@pytest.mark.parametrize("shape", ["upright", "turned", "large"])
def test_every_sample_knows_its_row(shape: str) -> None:
    """The picture holds each sample's row: painted so, and asked back, to within 2 rows."""
    down = np.broadcast_to(np.arange(480)[:, None] / 2.0, (480, 640)).round().astype(np.uint8)
    blank = Canvas(transfer="linear").frame(None)
    samples = sampled(dataclasses.replace(blank, pixels=down.copy()), quad(SHAPES[shape]))
    np.testing.assert_allclose(samples.rows / 2, samples.light * 255, atol=1.0)


def test_saturated_pixels_are_not_averaged_in() -> None:
    """A hot spot beyond full scale: its samples do not count, and the others are what they are."""
    spot = 0.012  # of the panel's area, around each cell's centre

    def blown(u: Floats, v: Floats) -> Floats:
        x, y = 4 * u % 1.0 - 0.5, 4 * v % 1.0 - 0.5
        return np.where(x * x + y * y < 16 * spot / np.pi, 4.0, 0.3)

    canvas = Canvas()
    canvas.lamp(SHAPES["upright"], 1.0, profile=blown, blur_px=0.4)
    samples = sampled(canvas.frame(None), quad(SHAPES["upright"]))
    assert samples.valid is not None
    assert 0.3 < samples.valid.mean() < 0.95
    assert (samples.light[~samples.valid] == 0).all()
    at_the_rim_of_the_spots = 0.1  # where the blur leaves pixels brighter than 0.3 but not blown
    np.testing.assert_allclose(means(samples), 0.3, atol=at_the_rim_of_the_spots)


def test_where_nothing_is_saturated_everything_is_valid() -> None:
    """Nothing is masked without need."""
    assert sampled(picture(SHAPES["upright"]), quad(SHAPES["upright"])).valid is None


def test_a_cell_that_is_saturated_all_over_is_reported() -> None:
    """Bands cannot be seen there; a guess about one cell is no reading of a panel."""

    def one_blown(u: Floats, v: Floats) -> Floats:
        return np.where((u < 0.25) & (v < 0.25), 4.0, 0.3)

    canvas = Canvas()
    canvas.lamp(SHAPES["upright"], 1.0, profile=one_blown)
    assert reason(sample_cells(canvas.frame(None), quad(SHAPES["upright"]), 4)) == "cells.saturated"


def test_a_panel_without_light_is_reported() -> None:
    """A cell of value 0 throughout has no light whose bands could be measured."""
    dark = Canvas(background=0.0).frame(None)
    assert reason(sample_cells(dark, quad(SHAPES["upright"]), 4)) == "cells.dark"


@pytest.mark.parametrize("place", [(20, 240), (625, 240), (320, 15), (320, 470)])
def test_a_panel_that_is_partly_outside_is_reported(place: tuple[float, float]) -> None:
    """Nothing is read beyond the picture's edge."""
    assert reason(sample_cells(Canvas().frame(None), quad(square(*place, 60)), 4)) == "cells.outside_picture"


def test_cells_smaller_than_can_be_distinguished_are_refused() -> None:
    """A pixel and a half a cell is too little, also where only one side is so short."""
    narrow = np.array([[300.0, 200], [306, 200], [306, 260], [300, 260]])
    frame = Canvas().frame(None)
    assert reason(sample_cells(frame, quad(square(310, 240, 6)), 4)) == "cells.too_small"
    assert reason(sample_cells(frame, quad(narrow), 4)) == "cells.too_small"


def test_other_grids_than_four_by_four() -> None:
    """As many cells as the dictionary has."""
    levels = np.linspace(0.1, 0.8, 36).reshape(6, 6)

    def six_by_six(u: Floats, v: Floats) -> Floats:
        row, column = (np.clip((6 * w).astype(int), 0, 5) for w in (v, u))
        return np.asarray(levels[row, column])

    canvas = Canvas()
    canvas.lamp(SHAPES["upright"], 1.0, profile=six_by_six)
    samples = sample_cells(canvas.frame(None), quad(SHAPES["upright"]), 6)
    assert isinstance(samples, CellSamples)
    np.testing.assert_allclose(np.median(samples.light, axis=1).reshape(6, 6), levels, rtol=0.03)


@pytest.mark.parametrize("light", [0.2, 0.88])
@pytest.mark.parametrize(("x", "side"), [(82.3, 131), (320, 300), (600.4, 58.2)])
def test_samples_are_what_opencv_interpolates(x: float, side: float, light: float) -> None:
    """By Lanczos, or by straight lines where a pixel is saturated; at the border too. It rounds places to 1/32 px."""
    corners = square(x, 240, side, 3)
    canvas = Canvas(transfer="linear")
    canvas.panel(corners, word(7), light=light, gains=np.linspace(0.3, 1.1, 16).reshape(4, 4))
    frame = canvas.frame()
    samples = sampled(frame, quad(corners))
    ends = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], np.float32)
    places = np.stack([samples.lattice.u, samples.lattice.v], axis=-1)
    at = cv2.perspectiveTransform(places, cv2.getPerspectiveTransform(ends, corners.astype(np.float32)))
    np.testing.assert_allclose(samples.rows, at[..., 1], atol=1e-3)
    how = cv2.INTER_LINEAR if (frame.pixels == 255).any() else cv2.INTER_LANCZOS4
    theirs = cv2.remap(frame.pixels / np.float32(255), at, None, how, borderMode=cv2.BORDER_REPLICATE)
    valid = np.ones(samples.light.shape, bool) if samples.valid is None else samples.valid
    assert valid.mean() > 0.5
    steepest = 0.35 * light  # per pixel, at the panel's rim and its dark walls; in both directions
    assert np.abs(samples.light - theirs)[valid].max() < 2 * steepest / 64 + 1e-3


def test_a_picture_that_is_no_picture_is_outside() -> None:
    """One row, along which a folded square lies; and one whose pixels are not side by side is as any other."""
    frame = Canvas().frame(None)
    line = quad(np.array([[10.0, 0], [90, 0], [10, 0], [90, 0]]))
    assert reason(sample_cells(dataclasses.replace(frame, pixels=frame.pixels[:1]), line, 4)) == "cells.outside_picture"
    apart = dataclasses.replace(frame, pixels=np.repeat(frame.pixels, 2, axis=1)[:, ::2])
    where = quad(SHAPES["upright"])
    np.testing.assert_array_equal(sampled(apart, where).light, sampled(frame, where).light)
