"""Panels beside something bright: how sure it is where they end."""

from __future__ import annotations

import numpy as np
import pytest
from decode_material import Canvas, Profile, diffuser, one_size, reason, square, word

from ledpi.decode.corners.approach import approach_quads
from ledpi.decode.corners.edges import refine_quads
from ledpi.records import Floats, Frame, Quad, Rejected

LIGHT = 0.5
BEZEL = 0.6  # of the light within


def refined(frame: Frame, rough: Floats) -> Quad:
    (near,) = approach_quads(frame, rough[None], np.array([3.0]))
    assert not isinstance(near, Rejected), reason(near)
    (found,) = refine_quads(frame, near[None], 4)
    assert isinstance(found, Quad), reason(found)
    return found


def error_px(found: Quad, true: Floats) -> float:
    """Of a coordinate, root mean square."""
    return float(np.sqrt(np.square(found.corners_px - true).mean()))


def dim_rim(u: Floats, v: Floats) -> Floats:
    """A diffuser that has half its light at the panel's edge, and nearly all of it 8 % of a cell further in."""
    inward = 4 * np.minimum(np.minimum(u, 1 - u), np.minimum(v, 1 - v))
    return np.asarray(diffuser(u, v) * (1 - 0.5 * np.exp(-inward / 0.04)))


def on_bezel(true: Floats, profile: Profile, wide: float = 1.25, bezel: float = BEZEL) -> Frame:
    """A bezel around it, so many times as large, with that share of its light."""
    canvas = Canvas()
    middle = true.mean(axis=0)
    canvas.lamp(middle + wide * (true - middle), bezel * LIGHT)
    canvas.panel(true, word(7), light=LIGHT, profile=profile)
    return canvas.frame()


@pytest.mark.parametrize("side", [90.0, 130.0, 170.0])
def test_a_rim_that_a_bright_bezel_hides_is_in_the_deviation(side: float) -> None:
    """Sides lie further in than the panel ends, by half a pixel and more, and by less than three deviations."""
    true = square(310.4, 240.2, side, 8)
    found = refined(on_bezel(true, dim_rim), true)
    assert error_px(found, true) > 0.5
    assert error_px(found, true) < 3 * found.size_sigma_px  # of all sides alike


@pytest.mark.parametrize("profile", [dim_rim, one_size])
@pytest.mark.parametrize("side", [90.0, 130.0])
def test_in_the_dark_the_sides_are_as_sure_as_ever(side: float, profile: Profile) -> None:
    """A dim rim is brighter than nothing."""
    true = square(310.4, 240.2, side, 8)
    canvas = Canvas()
    canvas.panel(true, word(7), light=LIGHT, profile=profile)
    found = refined(canvas.frame(), true)
    assert found.corner_sigma_px < 0.15


def test_a_bezel_beside_a_rim_as_bright_as_the_cells_leaves_nothing_open() -> None:
    """Its lattice ends where its sides are."""
    true = square(310.4, 240.2, 130.0, 8)
    found = refined(on_bezel(true, diffuser), true)
    assert error_px(found, true) < 0.15
    assert found.corner_sigma_px < 0.15


def test_within_a_bezels_outline_the_panels_own_sides_are_sought() -> None:
    """Its lines alone would have it larger, by half a wall on each side."""
    true = square(310.4, 240.2, 130.0, 8)
    found = refined(on_bezel(true, one_size, 1.12, 0.4), square(310.4, 240.2, 1.12 * 130.0, 8))
    assert error_px(found, true) < 0.2
