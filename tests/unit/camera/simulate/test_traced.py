"""Panels lit by recorded edges in place of ideal square waves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from evaluation.simulated import TracedWave
from ledpi.camera.simulate.render import Renderer
from ledpi.camera.simulate.scene import FIRST_READOUT_NS, Panel
from ledpi.camera.simulate.trajectory import Gliding, Trajectory, facing_camera
from ledpi.core.records import Floats
from tests.builders.simulate import FLAT, PINHOLE, dark_scene, panel, sensor, standing

BEGIN_S, END_S = FIRST_READOUT_NS * 1e-9 - 0.05, FIRST_READOUT_NS * 1e-9 + 0.15


def ideal_trace(frequency_hz: float, phase_cycles: float) -> TracedWave:
    """The edges of a square wave of this phase at t = 0, one by one."""
    first = np.ceil(frequency_hz * BEGIN_S + phase_cycles)
    count = int((END_S - BEGIN_S) * frequency_hz) - 1
    rising = (first + np.arange(count) - phase_cycles) / frequency_hz
    edges = np.stack([rising, rising + 0.5 / frequency_hz], axis=1).ravel()
    return TracedWave.from_edges(edges, begin_s=BEGIN_S, end_s=END_S)


def traced(shown: Panel, black: TracedWave, white: TracedWave) -> Panel:
    """The panel with its cells lit by these."""
    return replace(shown, cell_waves=tuple(white if bit else black for bit in shown.codeword.ravel()))


def test_shares_of_exposures_by_hand() -> None:
    """Off, on from 1 to 2 s and from 3 to 3.5 s, off: what is on within an exposure, over its length."""
    wave = TracedWave.from_edges(np.array([1.0, 2.0, 3.0, 3.5]), begin_s=0.0, end_s=5.0)
    starts = np.array([0.0, 1.0, 1.75, 2.5, 3.25, 3.5])
    np.testing.assert_allclose(wave.share_on(starts, 1.5), [0.5 / 1.5, 1 / 1.5, 0.5 / 1.5, 0.5 / 1.5, 0.25 / 1.5, 0.0])
    ends_lit = TracedWave.from_edges(np.array([1.0]), begin_s=0.0, end_s=2.0)
    assert ends_lit.share_on(np.array([0.0, 1.0]), 1.0).tolist() == [0.0, 1.0]


@pytest.mark.parametrize("start_s", [-0.1, 1.6])
def test_what_was_not_traced_is_not_made_up(start_s: float) -> None:
    """An exposure that reaches beyond the trace is refused."""
    wave = TracedWave.from_edges(np.array([1.0]), begin_s=0.0, end_s=2.0)
    with pytest.raises(ValueError, match=r"not within the trace, 0\.000000 to 2\.000000 s"):
        wave.share_on(np.array([1.0, start_s]), 0.5)


def test_edges_out_of_order_are_refused() -> None:
    """Time does not run backward."""
    with pytest.raises(ValueError, match="must rise"):
        TracedWave.from_edges(np.array([2.0, 1.0]), begin_s=0.0, end_s=3.0)


@pytest.mark.parametrize(
    "motion",
    [
        standing(z_m=0.8),
        Gliding(start=facing_camera(np.array([0.0, 0.0, 0.8])), velocity_m_s=np.array([1.0, 0.3, 0.0]), start_s=1.0),
    ],
    ids=["still", "moving"],
)
def test_ideal_edges_give_the_ideal_picture(motion: Trajectory) -> None:
    """A trace of exact square waves, and the closed form of them, light the same pixels alike."""
    camera = sensor(PINHOLE)
    shown = panel(motion, appearance=FLAT)
    ideal = Renderer(dark_scene(shown, camera=camera), seed=3)
    black, white = ideal.phases_cycles[0]
    lit = traced(shown, ideal_trace(shown.spec.black_hz, black), ideal_trace(shown.spec.white_hz, white))
    expected = ideal.light(2).copy()
    assert np.ptp(expected[180:300, 320]) > 0.01  # bands
    np.testing.assert_allclose(Renderer(dark_scene(lit, camera=camera), seed=3).light(2), expected, atol=2e-6)


def test_every_cell_can_have_a_wave_of_its_own() -> None:
    """One cell is lit, the others never."""
    dark = TracedWave.from_edges(np.array([]), begin_s=BEGIN_S, end_s=END_S)
    lit = TracedWave.from_edges(np.array([BEGIN_S]), begin_s=BEGIN_S, end_s=END_S)
    waves = [dark] * 16
    waves[6] = lit  # second row, third column
    scene = dark_scene(replace(panel(standing(z_m=0.8)), cell_waves=tuple(waves)), camera=sensor(PINHOLE))
    light: Floats = Renderer(scene, seed=0).light(0)
    rows, columns = np.nonzero(light > 0.4)
    assert (rows.mean(), columns.mean()) == pytest.approx((240 - 16, 320 + 16), abs=0.6)  # a cell is 32 px


def test_a_wave_is_missing() -> None:
    """Sixteen cells need sixteen waves."""
    with pytest.raises(ValueError, match="cell_waves must be 16, not 1"):
        replace(panel(standing()), cell_waves=(ideal_trace(1250.0, 0.0),))
