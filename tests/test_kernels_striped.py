"""What compiled loops make of striped panels is what numpy makes of them."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import pytest
from decode_material import LENS, SHORT_US, SPEC, Canvas, Profile, diffuser, one_size, seen_through, square, word
from kernels_material import both_ways, compiled

from ledpi.decode.corners.sides import as_points
from ledpi.decode.striped.band_light import BandLight, Bands
from ledpi.decode.striped.lattice import fine_lattice, rough_lattice
from ledpi.decode.striped.light_window import Window
from ledpi.decode.striped.panel_fit import Fit, fitted
from ledpi.records import BandShape, HiddenSide, Intrinsics, PanelSpec

pytestmark = compiled

ANTIPHASE = PanelSpec(side_m=0.16, black_hz=1250.0, white_hz=1250.0, phase="antiphase")


def panel(
    side_px: float, lens: Intrinsics | None, spec: PanelSpec = SPEC, profile: Profile = diffuser
) -> tuple[Window, np.ndarray, Bands]:
    """Light around a panel, its corners, and its bands."""
    canvas, true = Canvas(exposure_us=SHORT_US), square(250, 200, side_px, 20)
    canvas.panel(true, word(7), phases=(0.3, 0.9 if spec is SPEC else 0.8), lens=lens, spec=spec, profile=profile)
    corners = as_points(true if lens is None else seen_through(lens, true))
    window = Window.around(canvas.frame(), corners[None], 12)
    bands = Bands.at(window, window.within(corners), 4, [spec])
    assert bands is not None
    return window, corners, bands


def fitted_both_ways(fit: Callable[[], Fit | None]) -> tuple[Fit, Fit]:
    """Both fits; of the same corners."""
    ours, theirs = both_ways(fit)
    assert ours is not None
    assert theirs is not None
    assert np.abs(ours.corners - theirs.corners).max() < 1e-3
    return ours, theirs


@pytest.mark.parametrize("lattice", [rough_lattice(4), fine_lattice(4)], ids=["rough", "fine"])
def test_lattices_explain_as_much(lattice: object) -> None:
    """In any place: on the panel, beside it, beyond what is looked at, turned over, and nowhere."""
    window, corners, bands = panel(80, None)
    light = BandLight.of(window, bands, 4, 600.0)
    rng = np.random.default_rng(3)
    near = window.within(corners) + 8 * (rng.standard_normal((50, 4)) + 1j * rng.standard_normal((50, 4)))
    tried = np.concatenate([near, near[:2] + 70, near[:1, ::-1], np.full((1, 4), np.nan + 0j)])
    with np.errstate(all="ignore"):
        ours, theirs = both_ways(lambda: light.explains(tried, lattice))
    np.testing.assert_allclose(ours, theirs, rtol=1e-4, atol=0.05)
    assert ours[:50].max() > 0.5 * 80**2 * 0.3
    assert ours[-1] == -np.inf


@pytest.mark.parametrize("lens", [None, LENS], ids=["no lens", "lens"])
@pytest.mark.parametrize("side_px", [30, 80, 200])
@pytest.mark.parametrize("roughly", [True, False])
def test_panels_fit_as_well(side_px: float, lens: Intrinsics | None, roughly: bool) -> None:
    """Corners, their deviation, and the share that is explained; after three steps from 1 % of the side away."""
    window, corners, bands = panel(side_px, lens)
    near = corners + 0.01 * side_px * np.array([1, -1j, 1j, -1 + 1j])
    fit = partial(fitted, window, near, bands, 4, lens, rounds=3, roughly=roughly)
    ours, theirs = fitted_both_ways(fit)
    assert ours.sigma_px == pytest.approx(theirs.sigma_px, rel=1e-3)
    assert ours.size_sigma_px == pytest.approx(theirs.size_sigma_px, rel=1e-3)
    assert ours.rim_wall == pytest.approx(theirs.rim_wall, abs=1e-6)
    assert ours.explained == pytest.approx(theirs.explained, abs=1e-5)
    assert np.abs(ours.corners - near).max() > 0.005 * side_px  # it did move


@pytest.mark.parametrize("lens", [None, LENS], ids=["no lens", "lens"])
@pytest.mark.parametrize("side_px", [40, 130])
def test_panels_of_cells_of_one_size_fit_as_well(side_px: float, lens: Intrinsics | None) -> None:
    """Their rim lies within the lattice's end, and half a wall, 0.9 % of the side, is found."""
    window, corners, bands = panel(side_px, lens, profile=one_size)
    ours, theirs = fitted_both_ways(partial(fitted, window, corners, bands, 4, lens, rounds=6))
    assert ours.rim_wall == pytest.approx(theirs.rim_wall, abs=1e-5)
    assert ours.rim_wall == pytest.approx(0.035 / 3.93, abs=0.002)
    assert ours.size_sigma_px == pytest.approx(theirs.size_sigma_px, rel=1e-3)


def test_panels_fit_as_well_in_bands_of_another_shape() -> None:
    """The same corners, and the same shape."""
    window, corners, bands = panel(80, None, SPEC)
    shape = BandShape(exposure_us=110.0, smoothing_rows2=0.5)
    fit = partial(fitted, window, corners, bands, 4, None, rounds=4, shape=shape)
    ours, theirs = fitted_both_ways(fit)
    assert ours.shape is not None
    assert theirs.shape is not None
    assert ours.shape.exposure_us == pytest.approx(theirs.shape.exposure_us, rel=1e-3)
    assert ours.shape.smoothing_rows2 == pytest.approx(theirs.shape.smoothing_rows2, abs=0.01)


@pytest.mark.parametrize("spec", [SPEC, ANTIPHASE], ids=["free", "antiphase"])
@pytest.mark.parametrize("side_px", [30, 80, 200])
def test_bands_are_the_same(side_px: float, spec: PanelSpec) -> None:
    """Levels, phases and classes of the panel, or near by; with two specs to choose from."""
    window, corners, _ = panel(side_px, None, spec)
    other = PanelSpec(side_m=0.16, black_hz=1500.0, white_hz=2700.0)
    rng = np.random.default_rng(4)
    off = 0.1 * side_px * (rng.standard_normal((20, 4)) + 1j * rng.standard_normal((20, 4)))
    for at in (window.within(corners), *window.within(corners + off)):
        ours, theirs = both_ways(partial(Bands.at, window, at, 4, [other, spec]))
        assert ours is not None
        assert theirs is not None
        assert (ours.spec, *ours.phases, *ours.white) == (theirs.spec, *theirs.phases, *theirs.white)
        assert (ours.dark, ours.bright) == pytest.approx((theirs.dark, theirs.bright), rel=1e-5)
        assert ours.explained == pytest.approx(theirs.explained, abs=1e-4)
    assert Bands.at(window, window.within(corners) * 0, 4, [spec]) is None  # all of it in one dark pixel


@pytest.mark.parametrize("side", [0, 1, 2, 3])
def test_bands_of_what_is_not_hidden_are_the_same(side: int) -> None:
    """And not what they are with it."""
    window, corners, bands = panel(80, None)
    ours, theirs = both_ways(partial(Bands.at, window, window.within(corners), 4, [SPEC], None, HiddenSide(side, 0.15)))
    assert ours is not None
    assert theirs is not None
    assert (*ours.phases, *ours.white) == (*theirs.phases, *theirs.white)
    assert ours.explained == pytest.approx(theirs.explained, abs=1e-4)
    assert ours.explained != pytest.approx(bands.explained, abs=1e-4)
