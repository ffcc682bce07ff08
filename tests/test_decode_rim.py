"""The filters for a lattice's rim: profiles made here by numerical blur, shifted, and the shift asked back."""

from __future__ import annotations

import math

import numpy as np
import pytest

from ledpi.decode.corners.rim import ACROSS, RimFilter, filter_key, light_across, rim_filter
from ledpi.records import Floats

PITCHES_PX = [3.2, 6.4, 12.8, 40.0]


def cells(x: Floats, pitch: float, brighter: float, gap: float) -> Floats:
    """Sharp light x pixels inward of the rim: 1 at a cell's ends, 1 + `brighter` in its middle, gaps between cells."""
    y = 2 * (x / pitch % 1.0) - 1
    to_gap = np.abs(x / pitch - np.maximum(np.round(x / pitch), 1))
    return np.where(x > 0, (1 + brighter * (1 - y * y)) * (to_gap > gap / 2), 0.0)


def blurred(t: Floats, edge: float, pitch: float, blur: float, *, brighter: float = 0.6, gap: float = 0.05) -> Floats:
    """What a lens with a Gaussian of `blur` makes of it at t, the rim being at `edge`: of 200 points a pixel."""
    x = np.arange(-30.0, 30.0, 0.005)
    weights = np.exp(-0.5 * np.square((t[:, None] - edge - x) / blur)) / (blur * math.sqrt(2 * math.pi)) * 0.005
    return np.asarray(weights @ cells(x, pitch, brighter, gap))


def at(pitch: float, blur: float = 0.78) -> RimFilter:
    return rim_filter(*filter_key(pitch, blur))


def both_and_apart(rim: RimFilter, first: Floats, second: Floats) -> tuple[float, float]:
    """Where two opposite sides are, from their profiles."""
    half_sum = float(rim.both[0] @ (0.5 * (first + second)) + rim.both_offset[0])
    half_difference = float(rim.apart @ (0.5 * (first - second)))
    return half_sum + half_difference, half_sum - half_difference


@pytest.mark.parametrize("pitch", PITCHES_PX)
def test_the_closed_form_is_the_blurred_light(pitch: float) -> None:
    """Even cells, and cells with a parabola, against the sum over a sharp picture."""
    parts = light_across(ACROSS, pitch, 0.9)
    looked_at = 2.5 * pitch > ACROSS  # the closed form has four cells, and no far end
    for brighter in (0.0, 0.8):
        expected = blurred(ACROSS, 0.0, pitch, 0.9, brighter=brighter, gap=0.0)
        np.testing.assert_allclose((parts[0] + brighter * parts[1])[looked_at], expected[looked_at], atol=2e-3)


@pytest.mark.parametrize("pitch", PITCHES_PX)
@pytest.mark.parametrize("shift", [-0.3, 0.0, 0.2])
def test_a_shifted_side_is_found(pitch: float, shift: float) -> None:
    """One side is moved, the opposite one is not: both are told to 0.08 px in one look; the next has less to tell."""
    rim = at(pitch)
    moved, still = (blurred(ACROSS, edge, pitch, 0.78) for edge in (shift, 0.0))
    found = both_and_apart(rim, moved, still)
    assert found == pytest.approx((shift, 0.0), abs=0.08)


@pytest.mark.parametrize("brighter", [0.2, 1.0])
@pytest.mark.parametrize("blur", [0.6, 0.95])
def test_neither_blur_nor_the_cells_shape_moves_a_side_far(blur: float, brighter: float) -> None:
    """What a half-height crossing would put 0.1 to 0.4 px off; with cells of 12.8 px."""
    side = blurred(ACROSS, 0.0, 12.8, blur, brighter=brighter)
    assert both_and_apart(at(12.8), side, side) == pytest.approx((0.0, 0.0), abs=0.1)


def test_the_surroundings_and_a_slope_of_the_light_move_nothing() -> None:
    """A bright wall behind the panel, and bands: 1 % more light with each row."""
    side = blurred(ACROSS, 0.0, 12.8, 0.78)
    there = both_and_apart(at(12.8), side + 0.4, side + 0.1)
    sloped = both_and_apart(at(12.8), side * (1 + 0.01 * ACROSS), side * (1 - 0.01 * ACROSS))
    assert there == pytest.approx(both_and_apart(at(12.8), side, side), abs=1e-3)
    assert sloped == pytest.approx((0.0, 0.0), abs=0.1)


def test_a_wider_blur_is_told() -> None:
    """The blur's logarithm comes out nearer to the truth than the usual blur was."""
    side = blurred(ACROSS, 0.0, 12.8, 1.1)
    rim = at(12.8)
    change = float(rim.both[1] @ side + rim.both_offset[1])
    assert 0.5 * math.log(1.1 / 0.78) < change < 1.3 * math.log(1.1 / 0.78)
