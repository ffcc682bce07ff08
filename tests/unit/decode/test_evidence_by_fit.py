"""Evidence on the bands of a panel by the equation that its fit solves: of an oblique one with deep walls, too."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from evaluation.suites.units import photographed
from evaluation.suites.wild import draw_wild
from ledpi.camera.simulate.sensor import sensor_info
from ledpi.core.records import CameraInfo, Floats, PanelSpec
from ledpi.decode.evidence.cells import Observation
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.evidence.light import LightWeigher
from ledpi.decode.evidence.memory import PanelMemory
from ledpi.decode.model.fit import FitOptions, Fitted, Fitter
from ledpi.decode.model.light import Window
from ledpi.workshop.evaluate.scoring import PanelReader
from tests.builders.decode import PHASES, SPEC, TRUE_10_MS_US, panel_settings, word
from tests.builders.model import Panel, projected, window_of

NOISE = 0.02
LATER_S = 0.0077
LATER = tuple((phase + hz * LATER_S) % 1.0 for phase, hz in zip(PHASES, SPEC.waves_hz, strict=True))
FINELY = FitOptions(rounds=10, reweightings=2, faint=True)
ANTIPHASE = replace(SPEC, white_hz=SPEC.black_hz, phase="antiphase")


def evidence_of(panel: Panel, window: Window, spec: PanelSpec = SPEC) -> Evidence:
    """Evidence by the panel's fit to the light, from its true corners."""
    found = LightWeigher(4, None).alone(seen(panel, window), spec)
    assert found is not None
    return found


def seen(panel: Panel, window: Window) -> Observation:
    """The panel as it is fitted to the light, from its true corners."""
    fit = Fitter(4, None).fit(panel.frame(), window, panel.corners, SPEC, FINELY)
    assert isinstance(fit, Fitted)
    return Observation(panel.frame(), window, fit.lattice_px, fit.unknown)


def bands_of(phases: tuple[float, float]) -> Floats:
    """(16, 4) cosine and sine of each wave's fundamental in row 0, as the cells of panel 7 show them."""
    out = np.zeros((16, 4))
    for cell, white in enumerate(word(7).ravel().astype(int)):
        hz, phase = SPEC.waves_hz[white], phases[white]
        amplitude = 2.0 * float(np.sinc(SPEC.duty) * np.sinc(hz * TRUE_10_MS_US * 1e-6))
        angle = math.tau * (phase - SPEC.duty / 2 + 0.5 * hz * TRUE_10_MS_US * 1e-6)
        out[cell, 2 * white : 2 * white + 2] = amplitude * math.cos(angle), -amplitude * math.sin(angle)
    return out


def spread_of(evidence: Evidence, bands: Floats) -> float:
    """Mean square of the score that these bands leave, over what the information says of it: 1 where that is right."""
    size = evidence.score.size
    values, vectors = np.linalg.eigh(evidence.information.reshape(size, size))
    told = values > 1e-3 * values[-1]
    return float(np.mean(np.square(vectors[:, told].T @ evidence.unexplained(bands).ravel()) / values[told]))


@pytest.mark.slow
@pytest.mark.parametrize("yaw_deg", [0.0, 40.0, 60.0], ids=lambda yaw: f"{yaw:.0f}°")
def test_cells_show_the_bands_that_they_have(yaw_deg: float) -> None:
    """Walls stand before the diffuser: their faces glow, and hide it. The score is off by as much as noise explains."""
    panel = Panel(corners=projected(yaw_deg), depth=0.08, hot_at=0.5)
    spreads = []
    for seed in range(6):
        evidence = evidence_of(panel, window_of(panel.light(), noise=NOISE, seed=seed))
        spreads.append([spread_of(evidence, bands) for bands in (bands_of(PHASES), np.zeros((16, 4)))])
    true, none = np.mean(spreads, axis=0)
    assert 0.4 < true < 1.4 < none


@pytest.mark.parametrize("blur_px", [0.0, 0.5, 0.7])
def test_noise_that_is_alike_in_neighbours_is_not_counted_as_if_it_were_not(blur_px: float) -> None:
    """A camera's processor takes noise off: what is left is as coarse as bands; the fit takes some."""
    panel = Panel(corners=projected(30.0), blinks=False)
    light = panel.light()
    spreads = []
    for seed in range(6):
        noise = np.random.default_rng(seed).standard_normal(light.shape)
        soft = cv2.GaussianBlur(noise, (0, 0), blur_px) if blur_px else noise
        seen = light + NOISE * np.sqrt(light + 0.1) * soft
        spreads.append(spread_of(evidence_of(panel, window_of(seen)), np.zeros((16, 4))))
    assert 0.5 < np.mean(spreads) < 1.7


def test_a_dead_cell_says_nothing() -> None:
    """The light that comes from there is its neighbours', and has their bands."""
    gains = np.ones((4, 4))
    gains[1, 2] = 0.0
    panel = Panel(corners=projected(30.0), gains=gains)
    evidence = evidence_of(panel, window_of(panel.light(), noise=NOISE))
    assert np.flatnonzero(~evidence.own_information.any(axis=(1, 2))).tolist() == [6]


def test_in_antiphase_there_is_one_wave() -> None:
    """Its cosine and sine in each cell."""
    panel = Panel(corners=projected(30.0))
    assert evidence_of(panel, window_of(panel.light(), noise=NOISE), ANTIPHASE).score.shape == (16, 2)


def test_a_window_that_is_all_saturated_gives_none() -> None:
    """There are no samples; nor does a frame that is so after others."""
    panel = Panel(corners=projected(30.0))
    window = window_of(panel.light(), noise=NOISE)
    fitted = seen(panel, window)
    full = replace(window, light=np.ones_like(window.light))
    weigher = LightWeigher(4, None)
    assert weigher.alone(fitted._replace(window=full), SPEC) is None
    one, _ = PanelMemory(spec=SPEC).add_frame(fitted, weigher)
    two, added = one.add_frame(fitted._replace(window=full), weigher)
    assert (two.frames, added) == (2, None)


@pytest.mark.slow
def test_an_oblique_panel_with_deep_walls_is_read_from_one_frame() -> None:
    """Far walls glow and near ones hide: that is much more than the bands, which are 4 % deep."""
    take = draw_wild("oblique", panel_settings(), 77001, 13)
    (frame,) = photographed(take, take.scene, 1)
    info: CameraInfo = sensor_info(take.scene.sensor)
    read = PanelReader("likelihood", info, panel_settings()).read(frame)
    assert [found.id for found in read.found] == [take.scene.panels[0].marker_id]


def compared(blur_px: float, seed: int, *, blinks: bool, shift_px: float = 0.0, shrunk: float = 1.0) -> Evidence:
    """A frame with noise, compared with another 7.7 ms earlier; its panel may have moved."""
    weigher, looks = LightWeigher(4, None), []
    for k in range(2):
        corners = projected(30.0)
        corners = corners.mean(axis=0) + (corners - corners.mean(axis=0)) / shrunk + k * shift_px
        panel = Panel(corners=corners, blinks=blinks, phases=PHASES if k == 0 else LATER)
        light = panel.light()
        noise = np.random.default_rng(2 * seed + k).standard_normal(light.shape)
        soft = cv2.GaussianBlur(noise, (0, 0), blur_px) if blur_px else noise
        looks.append(seen(panel, window_of(light + NOISE * np.sqrt(light + 0.1) * soft)))
    _, found = weigher.compare(looks[1], SPEC, LATER_S, weigher.first(looks[0], SPEC, 0.0))
    assert found is not None
    return found


@pytest.mark.slow
@pytest.mark.parametrize("shift_px", [0.0, 0.4])
def test_two_frames_differ_by_the_bands_that_they_have(shift_px: float) -> None:
    """Whatever the panel looks like, and also where it has moved."""
    spreads = []
    for seed in range(6):
        evidence = compared(0.0, seed, blinks=True, shift_px=shift_px)
        spreads.append([spread_of(evidence, bands) for bands in (bands_of(PHASES), np.zeros((16, 4)))])
    true, none = np.mean(spreads, axis=0)
    assert 0.4 < true < 1.5 < none


@pytest.mark.slow
@pytest.mark.parametrize(("blur_px", "shrunk"), [(0.0, 1.0), (0.5, 1.0), (0.7, 1.0), (0.0, 8.0)])
def test_what_frames_differ_by_is_as_sure_as_their_noise_leaves_it(blur_px: float, shrunk: float) -> None:
    """A mean of one frame has as much noise as the frame that is compared with it; the smallest is 11 px wide."""
    spreads = [spread_of(compared(blur_px, seed, blinks=False, shrunk=shrunk), np.zeros((16, 4))) for seed in range(6)]
    assert 0.5 < np.mean(spreads) < 1.7
