"""Where no cells show in a square, its panel is as far as it blinks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from decode_material import (
    FRAME_ROWS,
    LENS,
    PINHOLE,
    ROW_TIME_US,
    SPEC,
    Canvas,
    Profile,
    camera_info,
    flat,
    panel_settings,
    quad,
    seen_through,
    square,
    word,
)
from samples_material import bands_of

from ledpi.decode.identify.blinking_rim import UNTOLD, Inward, Rim
from ledpi.decode.identify.codebook import Codebook
from ledpi.dictionaries import load_dictionary
from ledpi.pipeline import Pipeline
from ledpi.records import Decoded, Floats, Frame, Intrinsics

BOOK = Codebook.build(list(range(50)), load_dictionary("DICT_4X4_50"), panel_settings().spec())
PERIOD_US = FRAME_ROWS * ROW_TIME_US
SIDE_PX = 100.0  # at 1 m
TRUE = square(310.4, 240.2, SIDE_PX, 13)


def wider(by: float) -> Floats:
    """The square that ends by this share of the panel's side further out, all around."""
    return square(310.4, 240.2, (1 + 2 * by) * SIDE_PX, 13)


def frame_of(
    seq: int,
    *,
    around: float = 0.0,
    light: float = 0.4,
    on_side: float | None = None,
    profile: Profile = flat,
    period_us: float = PERIOD_US,
    lens: Intrinsics | None = None,
) -> Frame:
    """Frame `seq` of a panel whose cells are at 0.4, in a frame of this `light`, `around` of the side wide.

    Or one on its first side alone. Light of level `on_side` falls on a strip along that side.
    """
    canvas = Canvas()
    if around:
        canvas.lamp(wider(around), light, lens=lens)
    canvas.panel(TRUE, word(7), profile=profile, start_us=seq * period_us, lens=lens)
    if on_side is not None:
        across = (TRUE[3] - TRUE[0]) / 16
        patch, lit = Canvas(background=0.0), np.array([TRUE[0], TRUE[1], TRUE[1] + across, TRUE[0] + across])
        patch.lamp(lit, on_side)
        canvas.light += patch.light
    return replace(canvas.frame(seq, seq=seq), row0_readout_ns=round(1e9 + 1e3 * seq * period_us))


def told(frames: list[Frame], at: Floats, lens: Intrinsics | None = None) -> Inward:
    """How far within a square the panel of these frames ends; its bands are known."""
    shown = bands_of(frame_of(0), TRUE, BOOK)
    rim = Rim.of(SPEC, 4)
    for frame in frames:
        rim = rim.after(frame, quad(at), shown, frames[0].row0_readout_ns, lens)
    return rim.inward


def test_a_panel_that_blinks_up_to_its_sides_ends_there() -> None:
    """The more surely, the more frames there are."""
    four, many = told([frame_of(n) for n in range(4)], TRUE), told([frame_of(n) for n in range(24)], TRUE)
    assert four.shares == many.shares == (0.0,) * 4
    assert many.sigma < four.sigma < UNTOLD / 4


@pytest.mark.parametrize("around", [0.03, 0.05, 0.08])
@pytest.mark.parametrize("light", [0.4, 0.5])
def test_one_in_a_frame_as_bright_ends_where_it_stops_blinking(around: float, light: float) -> None:
    """All around; the shares are of the whole square's side."""
    inward = told([frame_of(n, around=around, light=light) for n in range(4)], wider(around))
    of_square = around / (1 + 2 * around)
    assert inward.shares == pytest.approx([of_square] * 4, abs=0.011)
    assert inward.sigma < 0.01


def test_on_one_side_it_ends_there_alone() -> None:
    """As where a sheet of paper touches it."""
    at = TRUE.copy()
    at[:2] -= 0.06 * (TRUE[3] - TRUE[0])

    def frame(seq: int) -> Frame:
        canvas = Canvas()
        canvas.lamp(at, 0.4)
        canvas.panel(TRUE, word(7), profile=flat, start_us=seq * PERIOD_US)
        return replace(canvas.frame(seq, seq=seq), row0_readout_ns=round(1e9 + 1e3 * seq * PERIOD_US))

    inward = told([frame(n) for n in range(4)], at)
    assert inward.shares[0] == pytest.approx(0.06 / 1.06, abs=0.009)
    assert inward.shares[1:] == (0.0,) * 3


def test_behind_a_lens_as_well() -> None:
    """Strips are as bent as the square is."""
    frames = [frame_of(n, around=0.06, lens=LENS) for n in range(4)]
    inward = told(frames, seen_through(LENS, wider(0.06)), LENS)
    assert inward.shares == pytest.approx([0.06 / 1.12] * 4, abs=0.009)


def test_in_one_frame_nothing_is_told() -> None:
    """What a strip looks like may have other reasons; only how it changes is asked."""
    assert told([frame_of(0, around=0.06)], wider(0.06)) == Inward()


def test_nor_where_every_frame_shows_the_same() -> None:
    """At 20 ms, both classes advance by whole cycles."""
    assert told([frame_of(n, around=0.06, period_us=20_000.0) for n in range(12)], wider(0.06)) == Inward()


def test_light_that_falls_on_a_panels_rim_is_no_end() -> None:
    """It dilutes the bands there, but adds to the light as much as it takes of their share."""
    assert told([frame_of(n, on_side=0.15) for n in range(12)], TRUE).shares == (0.0,) * 4


def test_of_a_panel_whose_strips_are_too_thin_nothing_is_told() -> None:
    """At 10 m a strip was a row of cells, and one panel of a hundred seemed to end a row further in."""
    at, rim = square(310.4, 240.2, 10.0, 13), Rim.of(SPEC, 4)
    shown = bands_of(frame_of(0), TRUE, BOOK)
    for seq in range(12):
        canvas = Canvas()
        canvas.panel(at, word(7), profile=flat, start_us=seq * PERIOD_US)
        frame = replace(canvas.frame(seq, seq=seq), row0_readout_ns=round(1e9 + 1e3 * seq * PERIOD_US))
        rim = rim.after(frame, quad(at), shown, round(1e9), None)
        assert rim.inward == Inward()


def test_where_the_inner_strips_bands_are_not_told_nothing_is() -> None:
    """They are what the outer ones are compared with: here what is looked at does not blink at all."""
    shown, rim = bands_of(frame_of(0), TRUE, BOOK), Rim.of(SPEC, 4)
    for seq in range(8):
        canvas = Canvas()
        canvas.lamp(TRUE, 0.4)
        frame = replace(canvas.frame(seq, seq=seq), row0_readout_ns=round(1e9 + 1e3 * seq * PERIOD_US))
        rim = rim.after(frame, quad(TRUE), shown, round(1e9), None)
        assert rim.inward == Inward()


def pipeline(*, stream: bool = True) -> Pipeline:
    return Pipeline(camera_info(), panel_settings(), intrinsics=PINHOLE, stream=stream)


def error_px(decoded: Decoded) -> float:
    """Of the corners of the one panel, which must be read: rms."""
    (marker,) = decoded.markers
    assert marker.sighting.id == 7
    return float(np.sqrt(np.mean((marker.sighting.corners_px - TRUE) ** 2)))


@pytest.mark.parametrize("light", [0.1, 0.2, 0.3])
def test_the_sides_that_a_frame_leaves_visible_are_the_panels(light: float) -> None:
    """Of two squares one in the other, five pixels apart, in one frame."""
    assert error_px(pipeline(stream=False).decode(frame_of(0, around=0.05, light=light))) < 0.6


def test_where_none_are_visible_the_deviation_says_so_until_frames_tell() -> None:
    """A frame as bright as the cells: three pixels off at first, within half of one after four frames."""
    path = pipeline()
    seen = [path.decode(frame_of(n, around=0.03)) for n in range(6)]
    sigmas = [decoded.markers[0].sighting.corner_sigma_px for decoded in seen]
    assert error_px(seen[0]) > 2 > sigmas[0] > 1
    assert all(error_px(decoded) < 3 * sigma for decoded, sigma in zip(seen, sigmas, strict=True))
    assert error_px(seen[-1]) < 0.7
    assert sigmas[-1] < 0.5


def domed(u: Floats, v: Floats) -> Floats:
    return 1 - 0.4 * ((4 * u % 1 - 0.5) ** 2 + (4 * v % 1 - 0.5) ** 2)


def walled(u: Floats, v: Floats) -> Floats:
    to_wall = np.minimum(*(np.abs(4 * along - np.clip(np.round(4 * along), 1, 3)) for along in (u, v)))
    return np.where(to_wall < 0.03, 0.0, 1.0)


@pytest.mark.parametrize("profile", [domed, walled])
def test_cells_that_show_are_believed_at_once(profile: Profile) -> None:
    """With walls between them, or brighter in their middle."""
    (marker,) = pipeline(stream=False).decode(frame_of(0, profile=profile)).markers
    assert marker.sighting.corner_sigma_px < 0.2
