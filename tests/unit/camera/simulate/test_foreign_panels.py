"""Panels as other people have them: LEDs in numbers, deep walls, a glossy floor, defocus."""

from __future__ import annotations

from dataclasses import asdict, replace

import numpy as np
import pytest

from evaluation.simulated import BuiltAppearance, GlossyFloor
from ledpi.camera.simulate.render import Renderer
from ledpi.camera.simulate.scene import Panel, Scene
from ledpi.camera.simulate.trajectory import Still, facing_camera
from ledpi.core.records import Floats
from tests.builders.simulate import DARK, FLAT, PINHOLE, panel, sensor, single_class_panel, standing

AHEAD = np.array([0.0, 0.0, 20.0])  # the eye, in pitches of a cell


def light_of(*panels: Panel, floor: GlossyFloor | None = None, defocus_px: float = 0.0, seq: int = 0) -> Floats:
    """(480, 640) light of panels in the dark through a sharp pinhole, in double precision."""
    camera = replace(sensor(PINHOLE, psf_sigma_px=0.0), defocus_px=defocus_px)
    scene = Scene(sensor=camera, panels=panels, room=DARK, floor=floor)
    return np.asarray(Renderer(scene, seed=5).light(seq), np.float64)


def test_a_cell_of_four_leds_has_four_bright_spots() -> None:
    """A quarter of a cell from its middle either way, and none of them brighter than the peak of 1."""
    appearance = BuiltAppearance(gap=0.0, falloff=0.0, hot_spot=0.6, hot_spot_sigma=0.08, leds=2)
    light = appearance.lights(4, 64)
    along = light[16, :64]  # through the upper two of the first cell
    assert along[[16, 48]] == pytest.approx(1.0, abs=0.01)
    assert along[32] < 0.45
    assert light.max() <= 1.0


def test_walls_hide_nothing_from_straight_ahead_in_the_middle() -> None:
    """There the line of sight ends on what is behind its opening; and walls of no depth hide nothing anywhere."""
    flat, deep = (BuiltAppearance(gap=0.1, depth=depth).lights(5, 64, AHEAD) for depth in (0.0, 0.3))
    np.testing.assert_allclose(deep[160, 160], flat[160, 160], rtol=1e-3)
    from_aside = BuiltAppearance(gap=0.1).lights(5, 64, np.array([20.0, 3.0, 5.0]))
    np.testing.assert_array_equal(from_aside, flat)


@pytest.mark.parametrize(("eye", "axis"), [((40.0, 0.0, 20.0), 1), ((0.0, 40.0, 20.0), 0)])
def test_from_aside_a_wall_hides_depth_times_the_tangent_of_a_cell(eye: tuple[float, float, float], axis: int) -> None:
    """Seen from the right, or from above, at tan = 2, walls of a tenth show their own face on a fifth of each cell.

    It is the far wall's that is seen: to the left of each cell, or below; half as bright as the diffuser beside it.
    """
    appearance = BuiltAppearance(gap=0.0, falloff=0.0, hot_spot=0.0, depth=0.1, wall_glow=0.5)
    light = np.moveaxis(appearance.lights(4, 100, np.array(eye)), axis, 0)[:, 150]
    second = light[100:200]
    dark = np.flatnonzero(second < 0.75)
    assert len(dark) == pytest.approx(20, abs=2)
    assert dark.min() == (0 if axis == 1 else 100 - len(dark))
    assert second[50] == pytest.approx(1.0)
    assert second[dark[len(dark) // 2]] == pytest.approx(0.5)


@pytest.mark.parametrize(("x_m", "first", "last"), [(-0.25, 56 + 13, 183), (0.25, 456, 583 - 13)])
def test_the_camera_decides_which_walls_hide(x_m: float, first: int, last: int) -> None:
    """At either side of the picture the far walls hide: walls of a whole cell, at tan 0.41, 13 of 32 columns."""
    deep = BuiltAppearance(**asdict(FLAT), depth=1.0, wall_glow=0.0)
    row = light_of(replace(single_class_panel(standing(x_m=x_m, z_m=0.8)), appearance=deep))[240]
    lit = np.flatnonzero(row > 0.5 * row.max())
    assert (lit.min(), lit.max()) == (pytest.approx(first, abs=1), pytest.approx(last, abs=1))


def test_a_glossy_floor_shows_the_panel_upside_down() -> None:
    """As much darker as it reflects, as far below the floor as the panel is above, and blinking with it."""
    above = panel(Still(facing_camera(np.array([0.0, -0.04, 0.6]))), marker_id=7)
    alone = light_of(above, seq=3)
    both = light_of(above, floor=GlossyFloor(y_m=0.06, reflectance=0.25, blur=0.001), seq=3)
    np.testing.assert_array_equal(both[:280], alone[:280])  # the floor meets the panel's plane in row 304
    shown = both[304:] - alone[304:]
    lit = alone[:304][::-1][: len(shown)]  # from the floor upwards
    steady = np.outer(lit.mean(axis=1) > 0, np.ones(640, bool))
    assert shown[steady].mean() == pytest.approx(0.25 * lit[steady].mean(), rel=0.05)
    ends = [np.flatnonzero(light.max(axis=1) > 0.005).min() for light in (shown, lit)]
    assert ends[0] == pytest.approx(ends[1], abs=2)


def test_a_mirror_image_swaps_nothing_from_left_to_right() -> None:
    """In the water a thing stands on its head, its left still at the left: gains of the left column stay there."""
    gains = np.ones((4, 4))
    gains[0, 0] = 3.0  # top left
    body = replace(single_class_panel(Still(facing_camera(np.array([0.0, -0.04, 0.6])))), cell_gains=gains)
    shown = light_of(body, floor=GlossyFloor(y_m=0.06, reflectance=0.5, blur=0.001))[304:]
    row, column = np.unravel_index(np.argmax(shown), shown.shape)
    lit = np.flatnonzero(shown.max(axis=1) > 0.005)
    assert column < 320
    assert row > lit.mean()  # what is at the top is the farthest below


def test_defocus_spreads_light_over_a_disc_and_keeps_its_sum() -> None:
    """An edge gets as wide as the disc's diameter, its light no less."""
    sharp, soft = (light_of(single_class_panel(standing(z_m=0.8)), defocus_px=radius) for radius in (0.0, 3.0))
    assert soft.sum() == pytest.approx(sharp.sum(), rel=1e-3)
    share = soft[240, 240:320] / sharp[240, 300]
    rising = np.flatnonzero((share > 0.001) & (share < 0.999))
    assert 5 <= len(rising) <= 8


@pytest.mark.parametrize("appearance", [{"leds": 0}, {"depth": -0.1}])
def test_looks_that_cannot_be_are_refused(appearance: dict[str, float]) -> None:
    """A cell has an LED; walls stand out, not in."""
    with pytest.raises(ValueError, match="leds must be at least 1, depth not negative"):
        BuiltAppearance(**appearance)  # type: ignore[arg-type]
