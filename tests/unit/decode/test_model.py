"""The fit of a panel's whole picture, held to pictures drawn by the same equation in other code."""

from __future__ import annotations

import numpy as np
import pytest

from ledpi.core.records import Floats
from ledpi.decode.model.fit import FitOptions, Fitted, Fitter
from ledpi.decode.model.light import Window
from ledpi.decode.model.prior import (
    BESIDE,
    BLUR,
    COMMON,
    DARK,
    DEPTH,
    GAP,
    GLOW,
    HARMONICS,
    OWN,
    PHASE,
    RIM,
    RIM_SIGMA,
    SHAPE,
    SMEAR,
    turned_unknown,
)
from tests.builders.decode import PHASES, SPEC, TRUE_10_MS_US, Canvas, reason, square, word
from tests.builders.model import Panel, nees, places_of, projected, window_of

FITTER = Fitter(4, None)
WHOLE, ONE_STEP = FitOptions(rounds=10, reweightings=2), FitOptions(rounds=1, phasing=False)
TRUE = square(80.3, 80.6, 100, 12)
ASIDE = projected(40.0)  # and seen from 60° aside
OBLIQUE = np.array([[40.3, 20.6], [111.7, 32.2], [112.1, 127.4], [39.8, 141.9]])
OFF_PX = np.array([[1.0, -1.0], [-1.0, 0.0], [0.5, 1.0], [0.0, -1.0]])
EXPOSURES_US = (TRUE_10_MS_US, 600.0, 150.0)
HIDDEN = 0.06  # of a cell, as in decode/model/panel_corners.c


def fitted(
    panel: Panel, window: Window, near: Floats, options: FitOptions = WHOLE, known: Floats | None = None
) -> Fitted:
    fit = FITTER.fit(panel.frame(), window, near, SPEC, options, known)
    assert isinstance(fit, Fitted), reason(fit)
    return fit


@pytest.mark.parametrize("corners", [TRUE, square(80.3, 80.6, 50, 30), square(80.3, 80.6, 36, 40), OBLIQUE])
def test_corners_are_where_the_equation_has_them(corners: Floats) -> None:
    """From a pixel off, at 10 ms: to a thirtieth of a pixel, which is what interpolating between pixels costs."""
    panel = Panel(corners=corners)
    fit = fitted(panel, window_of(panel.light()), corners + OFF_PX, FitOptions(rounds=24, tolerance=1e-4))
    assert np.abs(fit.lattice_px - corners).max() < 1 / 30
    assert fit.explained > 0.99


@pytest.mark.slow
@pytest.mark.parametrize(("exposure_us", "within_px"), [(600.0, 0.025), (150.0, 0.05)])
def test_deep_bands_do_not_move_corners(exposure_us: float, within_px: float) -> None:
    """Root mean square over eight places and phases; a band's edge is 4 rows wide at 150 µs, and pixels smooth it."""
    errors = []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        corners = square(*rng.uniform(80, 81, 2), 100, 12)
        black, white = rng.random(2)
        panel = Panel(corners=corners, exposure_us=exposure_us, phases=(black, white))
        errors.append(fitted(panel, window_of(panel.light()), corners + OFF_PX).lattice_px - corners)
    assert np.sqrt(np.mean(np.square(errors))) < within_px


def test_what_is_lit_ends_within_the_lattice_by_the_rim() -> None:
    """By 3 % of a cell to the left, and by 6 % below."""
    panel = Panel(corners=TRUE, rim=(0.03, 0.0, 0.0, 0.06))
    fit = fitted(panel, window_of(panel.light()), TRUE + OFF_PX)
    across, down = places_of(TRUE, fit.corners_px)
    np.testing.assert_allclose(across, [0.03, 4.0, 4.0, 0.03], atol=2e-3)
    np.testing.assert_allclose(down, [0.0, 0.0, 3.94, 3.94], atol=2e-3)


def test_blur_gap_gains_and_what_is_beside_are_reported() -> None:
    """Each as it was drawn; the blur with what interpolation adds, a sixth of a square pixel."""
    gains = np.random.default_rng(2).uniform(0.7, 1.3, (4, 4))
    panel = Panel(corners=TRUE, blur_px=1.0, gap=0.12, hot=0.2, gains=gains, beside=(0.1, 0.3, 0.05, 0.2), dark=0.05)
    unknown = fitted(panel, window_of(panel.light()), TRUE + OFF_PX).unknown
    assert np.exp(unknown[BLUR]) == pytest.approx(np.sqrt(1.0 + 1 / 6), rel=0.03)
    assert unknown[GAP] == pytest.approx(0.12, abs=0.01)
    np.testing.assert_allclose(unknown[[SHAPE, SHAPE + 1]], 0.2, atol=0.01)  # first harmonics across and down
    np.testing.assert_allclose(unknown[COMMON::OWN].reshape(4, 4), gains, rtol=0.02)
    levels = unknown[BESIDE : BESIDE + 4] + unknown[DARK]
    np.testing.assert_allclose(levels, [0.13 + 0.02 * n for n in (0, 10, -2.5, 5)], atol=0.02)


@pytest.mark.parametrize("exposure_us", EXPOSURES_US)
def test_phases_and_classes_are_found(exposure_us: float) -> None:
    """Phases to 2 % of a cycle, of half a cycle at that: a negative wave is one that is half a cycle later.

    Each cell shows its own class's wave, as deep as its light, and none of the other's.
    """
    panel = Panel(corners=TRUE, exposure_us=exposure_us)
    fit = fitted(panel, window_of(panel.light()), TRUE + OFF_PX)
    off = (fit.unknown[PHASE : PHASE + 2] - PHASES + 0.25) % 0.5 - 0.25
    assert np.abs(off).max() < 0.02
    own = np.stack([~word(7).ravel(), word(7).ravel()], axis=1)
    np.testing.assert_allclose(np.abs(fit.unknown[COMMON:].reshape(-1, OWN)[:, 1:]), own, atol=0.25)


@pytest.mark.parametrize("corners", [TRUE, ASIDE], ids=["from ahead", "from aside"])
@pytest.mark.parametrize("depth", [0.0, 0.05, 0.1])
def test_walls_before_the_diffuser_do_not_move_corners(depth: float, corners: Floats) -> None:
    """They explain what is hidden at one end of each cell, and how far LEDs seem aside."""
    panel = Panel(corners=corners, depth=depth)
    fit = fitted(panel, window_of(panel.light(), noise=0.01), corners + OFF_PX)
    assert np.abs(fit.corners_px - corners).max() < 0.15
    assert fit.unknown[DEPTH] == pytest.approx(depth, abs=0.02)


@pytest.mark.parametrize("leds", [2, 3, 4])
def test_several_leds_along_a_cell_do_not_move_corners(leds: int) -> None:
    """Their spots are harmonics of the cell's profile."""
    panel = Panel(corners=TRUE, leds=leds)
    fit = fitted(panel, window_of(panel.light(), noise=0.01), TRUE + OFF_PX)
    assert np.abs(fit.corners_px - TRUE).max() < 0.12


STEPS = [
    *(
        ("blur", BLUR, 0.05),
        ("gap", GAP, 0.01),
        ("dark", DARK, 0.03),
        ("depth", DEPTH, 0.01),
        ("glow", GLOW, 0.1),
        ("smear", SMEAR, 0.05),
    ),
    *((f"rim {k}", RIM + k, 0.01) for k in range(4)),
    *((f"shape {k}", SHAPE + k, 0.03) for k in range(len(HARMONICS))),
    *((f"phase {k}", PHASE + k, 0.01) for k in range(2)),
    *((f"beside {k}", BESIDE + k, 0.05) for k in range(4)),
    *((name, COMMON + 5 * OWN + k, 0.1) for k, name in enumerate(["gain", "black", "white"])),
]


Solved = tuple[Panel, Window, Fitted, Fitted]


@pytest.fixture(scope="module", params=[TRUE_10_MS_US, 150.0])
def solved(request: pytest.FixtureRequest) -> Solved:
    """A picture in which all of the unknowns count, its fit, and what one more step makes of that."""
    gains = np.random.default_rng(2).uniform(0.8, 1.2, (4, 4))
    panel = Panel(corners=TRUE, exposure_us=request.param, gains=gains, beside=(0.1, 0.2, 0.05, 0.15), depth=0.06)
    window = window_of(panel.light())
    best = fitted(panel, window, TRUE, FitOptions(rounds=40))
    return panel, window, best, fitted(panel, window, best.lattice_px, ONE_STEP, best.unknown)


@pytest.mark.parametrize(("at", "by"), [step[1:] for step in STEPS], ids=[step[0] for step in STEPS])
def test_one_step_undoes_a_wrong_unknown(solved: Solved, at: int, by: float) -> None:
    """All but a tenth of it, and moves no corner meanwhile: the slope by which the step is found is the true one.

    (Of a phase, or of depth, most of it: the slope is not the same all over the place that it moves to.)
    """
    panel, window, best, right = solved
    wrong = best.unknown.copy()
    wrong[at] += by
    step = fitted(panel, window, best.lattice_px, ONE_STEP, wrong)
    share, within_px = (0.3, 0.05) if at in (PHASE, PHASE + 1, DEPTH) else (0.1, 0.02)
    assert abs(step.unknown[at] - right.unknown[at]) < share * by
    assert np.abs(step.lattice_px - right.lattice_px).max() < within_px


@pytest.mark.parametrize("coordinate", range(8))
def test_one_step_undoes_a_wrong_corner(solved: Solved, coordinate: int) -> None:
    """All but a seventh of 0.3 px."""
    panel, window, best, right = solved
    wrong = best.lattice_px.copy()
    wrong.reshape(8)[coordinate] += 0.3
    step = fitted(panel, window, wrong, ONE_STEP, best.unknown)
    assert np.abs(step.lattice_px - right.lattice_px).max() < 0.3 / 7


@pytest.mark.parametrize("seed", range(8))
def test_more_rounds_leave_no_more(seed: int) -> None:
    """Small panels have three LEDs along a cell, walls, and a gap or none: a step too far is taken back."""
    rng = np.random.default_rng(seed)
    corners = square(*rng.uniform(80, 81, 2), rng.uniform(22, 26), rng.uniform(0, 90))
    look = {
        "gap": rng.choice([0.0, 0.02, 0.1]),
        "depth": rng.choice([0.0, 0.05, 0.1]),
        "blur_px": rng.uniform(0.5, 1.2),
    }
    lit = {"dark": rng.uniform(0.0, 0.4), "hot": rng.uniform(0.0, 0.5), "gains": rng.uniform(0.8, 1.2, (4, 4))}
    panel = Panel(corners=corners, leds=3, glow=0.8, beside=(0.1, 0.3, 0.5, 0.2), **look, **lit)
    window = window_of(panel.light(), noise=0.01)
    left = [1.0 - fitted(panel, window, corners, FitOptions(rounds=rounds)).explained for rounds in (2, 4, 6, 10, 14)]
    assert (left / np.minimum.accumulate(left)).max() < 1.25  # each step may leave a tenth more: samples move, too


@pytest.mark.parametrize("exposure_us", [TRUE_10_MS_US, 150.0])
@pytest.mark.parametrize(("side", "hidden"), [(0, 0.03), (1, 0.06), (2, 0.04), (3, 0.05)])
def test_a_hidden_strip_moves_neither_the_lattice_nor_corners(side: int, hidden: float, exposure_us: float) -> None:
    """Dark all along it, above, right, below or left: what does not fit there weighs little, and is no rim."""
    panel = Panel(corners=TRUE, exposure_us=exposure_us)
    light = panel.light()
    down, across = np.indices(light.shape)
    u, v = (at / 4 for at in places_of(TRUE, np.stack([across, down], axis=-1)))
    light[(v, 1 - u, 1 - v, u)[side] < hidden] = panel.dark
    fit = fitted(panel, window_of(light, noise=0.01), TRUE + OFF_PX)
    assert np.abs(fit.lattice_px - TRUE).max() < 0.5
    assert np.abs(fit.corners_px - TRUE).max() < 0.5


@pytest.mark.parametrize("exposure_us", EXPOSURES_US)
@pytest.mark.parametrize(("side", "level"), [(0, 0.0), (3, 1.0)])
def test_what_lies_aslant_before_a_side_is_in_the_covariance(side: int, level: float, exposure_us: float) -> None:
    """A wedge, dark or bright, none to a fiftieth of the side: corners by a pixel, by three deviations or so.

    It turns the side without a rim, and by what the noise says this would be eight.
    """
    panel = Panel(corners=TRUE, exposure_us=exposure_us)
    light = panel.light()
    down, across = np.indices(light.shape)
    u, v = (at / 4 for at in places_of(TRUE, np.stack([across, down], axis=-1)))
    inwards, along = (v, 1 - u, 1 - v, u)[side], (u, v, u, v)[side]
    light[(inwards >= -0.1) & (inwards < 0.02 * along) & (along <= 1.0)] = level
    fit = fitted(panel, window_of(light, noise=0.01), TRUE + OFF_PX)
    error = (fit.corners_px - TRUE).reshape(8)
    assert np.sqrt(error @ np.linalg.solve(fit.covariance_px2 + fit.jackknife_px2, error) / 8) < 3.5
    assert np.sqrt(error @ np.linalg.solve(fit.covariance_px2, error) / 8) > 2.0


@pytest.mark.parametrize("exposure_us", EXPOSURES_US)
@pytest.mark.parametrize("noise", [0.03, 0.01])
def test_where_nothing_does_deviations_are_hardly_larger(noise: float, exposure_us: float) -> None:
    """By less than a quarter: without a cell, corners move no further than noise has them."""
    panel = Panel(corners=TRUE, exposure_us=exposure_us)
    fit = fitted(panel, window_of(panel.light(), noise=noise), TRUE + OFF_PX)
    assert np.trace(fit.covariance_px2 + fit.jackknife_px2) < 1.25**2 * np.trace(fit.covariance_px2)


@pytest.mark.parametrize("noise_of", range(12))
def test_no_cell_of_a_small_panel_tells_its_size_alone(noise_of: int) -> None:
    """Without it corners move by less than a tenth of a pixel, also where a last step moves profile and size."""
    corners = square(80.3, 80.6, 33, 12)
    panel = Panel(corners=corners, blur_px=0.9, gap=0.0, hot=0.15)
    fit = fitted(
        panel,
        window_of(panel.light(), noise=0.01, seed=noise_of),
        corners + 0.2,
        FitOptions(rounds=10, reweightings=2, faint=True),
    )
    outward = (corners - corners.mean(axis=0)).reshape(8) / np.linalg.norm(corners - corners.mean(axis=0), axis=1).sum()
    assert np.sqrt(outward @ fit.jackknife_px2 @ outward) < 0.1


@pytest.mark.parametrize("side", [100, 40])
@pytest.mark.parametrize("hot_at", [0.53, 0.55])
def test_light_that_is_off_the_cells_middles_is_in_the_deviation(hot_at: float, side: float) -> None:
    """The gauge: such a profile may be taken for a panel that lies elsewhere, by three deviations or so."""
    corners = square(80.3, 80.6, side, 12)
    panel = Panel(corners=corners, hot_at=hot_at)
    assert np.sqrt(nees(fitted(panel, window_of(panel.light(), noise=0.02), corners + 0.2), corners) / 8) < 3.5


@pytest.mark.parametrize("side", [100, 40])
@pytest.mark.parametrize("noise", [0.04, 0.005])
def test_the_gauge_between_profile_and_corners_widens_the_covariance_along_a_shift(noise: float, side: float) -> None:
    """A profile and corners that shift together leave the same light, at any noise: twice as wide as of even cells."""
    corners = square(80.3, 80.6, side, 12)
    panel, along = Panel(corners=corners), np.tile(corners[1] - corners[0], 4) / (4 * side)

    def sigma_px(*, even: bool) -> float:
        options = FitOptions(rounds=10, reweightings=2, even=even)
        fit = fitted(panel, window_of(panel.light(), noise=noise), corners + 0.2, options)
        return float(np.sqrt(along @ fit.covariance_px2 @ along))

    assert sigma_px(even=False) > 2.0 * sigma_px(even=True)


@pytest.mark.parametrize("blinks", [True, False])
@pytest.mark.parametrize("exposure_us", [TRUE_10_MS_US, 2000.0, *EXPOSURES_US[1:]])
def test_a_steady_square_is_without_bands(exposure_us: float, blinks: bool) -> None:
    """And a panel is not, be its bands 8 % deep."""
    panel = Panel(corners=TRUE, exposure_us=exposure_us, blinks=blinks)
    window = window_of(panel.light(), noise=0.02)
    first = fitted(panel, window, TRUE + 0.5, FitOptions(rounds=8, phasing=False))
    options = FitOptions(rounds=10, must_blink=True)
    then = FITTER.fit(panel.frame(), window, first.lattice_px, SPEC, options, first.unknown)
    assert isinstance(then, Fitted) if blinks else reason(then) == "fit.no_bands"


@pytest.mark.parametrize("side", range(4))
def test_deviations_do_not_jump_where_a_side_begins_to_be_taken_for_hidden(side: int) -> None:
    """Half a ten-thousandth of a cell before it does and after it they are what they are a thousandth from there."""
    panel = Panel(corners=TRUE)
    window = window_of(panel.light(), noise=0.01)
    unknown = fitted(panel, window, TRUE).unknown.copy()
    unknown[RIM:SHAPE] = 0.0

    def deviation_px(rim: float) -> float:
        unknown[RIM + side] = rim
        fit = fitted(panel, window, TRUE, FitOptions(rounds=0, phasing=False), unknown)
        return float(np.sqrt(np.trace(fit.covariance_px2) / 8))

    before, after = deviation_px(HIDDEN - 1e-3), deviation_px(HIDDEN + 1e-3)
    assert deviation_px(HIDDEN - 5e-5) == pytest.approx(before, rel=0.1)
    assert deviation_px(HIDDEN + 5e-5) == pytest.approx(after, rel=0.1)


def test_no_rim_is_further_off_than_is_stated() -> None:
    """By their deviations, which are two to four times too wide: 24 panels as the prior has them, with noise."""
    errors, stated = [], []
    for seed in range(24):
        rng = np.random.default_rng(seed)
        blur_px, gap, rim = 0.8 * np.exp(rng.normal(0.0, 0.2)), rng.uniform(0.02, 0.14), rng.normal(0.0, RIM_SIGMA, 4)
        panel = Panel(corners=TRUE, blur_px=blur_px, gap=gap, rim=tuple(rim))
        fit = fitted(panel, window_of(panel.light(), noise=0.02, seed=seed), TRUE)
        errors.append(fit.unknown[RIM : RIM + 4] - rim)
        stated.append(fit.rim_variance)
    spread, deviation = np.sqrt(np.mean(np.square(errors), axis=0)), np.sqrt(np.mean(stated, axis=0))
    ratio = deviation[[3, 1, 0, 2]] / spread
    assert ratio.min() > 1.0
    assert ratio.max() < 4.0


# ---- The window


def test_a_window_is_linear_light() -> None:
    """A pixel of sRGB's 188 is half as bright as one of 255; where the window begins, its first pixel lies."""
    canvas = Canvas(background=0.5)
    canvas.lamp(square(300, 200, 60), 0.9)
    window = Window.crop(canvas.frame(None), square(300, 200, 60), 0.1)
    assert window is not None
    assert window.first == (261.0, 161.0)
    assert window.shrink == 1
    assert window.light[0, 0] == pytest.approx(0.5, abs=0.01)
    assert (window.dark, window.bright) == (pytest.approx(0.5, abs=0.01), pytest.approx(0.9, abs=0.01))
    near = Canvas()
    near.panel(square(320, 240, 300), word(7))
    window = Window.crop(near.frame(), square(320, 240, 300), 0.1)
    assert window is not None
    assert (window.shrink, window.first) == (4, (137 + 1.5, 57 + 1.5))  # the middle of the sixteen that it is of
    for level, x in ((0.0, 300), (0.3, 300), (0.03, 2000)):  # in the dark, on an even wall, beyond the picture
        assert Window.crop(Canvas(background=level).frame(None), square(x, 200, 60), 0.1) is None


@pytest.mark.parametrize("turns", [1, 2])
def test_what_is_known_in_one_order_of_corners_is_known_in_another(turns: int) -> None:
    """A fit from corners in another order finds the same walls, profile, gains, and light beside each side."""
    gains = np.linspace(0.7, 1.3, 16).reshape(4, 4)
    panel = Panel(corners=TRUE, gains=gains, hot_at=0.52, beside=(0.1, 0.2, 0.3, 0.4), rim=(0.01, 0.02, 0.03, 0.04))
    window = window_of(panel.light(), noise=0.002)
    known, other = fitted(panel, window, TRUE), fitted(panel, window, np.roll(TRUE, -turns, axis=0))
    turned = turned_unknown(known.unknown, turns)
    compared = np.r_[BLUR:PHASE, BESIDE:DEPTH, COMMON : len(turned) : OWN]
    np.testing.assert_allclose(turned[compared], other.unknown[compared], atol=0.02)
    assert np.abs(known.unknown - other.unknown)[compared].max() > 0.1
