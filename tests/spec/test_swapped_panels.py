"""Another panel near the place of one that was read: the old ID is shown no more, whatever else is wrong.

Rendered, as `ledpi evaluate` draws its cases. Each of these once showed the old ID, for a frame or for all of them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import pytest

from evaluation.suites.conditions import Condition
from evaluation.suites.draw import draw_take
from ledpi.camera.simulate.render import Renderer
from ledpi.camera.simulate.scene import Panel
from ledpi.camera.simulate.sensor import sensor_info
from ledpi.camera.simulate.trajectory import Still
from ledpi.config.settings import load_config
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.records import Floats
from ledpi.core.shutter import RowClock
from ledpi.workshop.evaluate.scoring import PanelReader

PANELS = load_config(None, ("panels.side_m=0.16",)).panels
WORDS = load_dictionary(PANELS.dictionary).codewords
GAPS = (0, 0, 0, 1, 5)  # frames that are lost before the other panel is seen


@dataclass(frozen=True)
class Swap:
    """A take of a case, what is drawn in which, and the panel that comes in place of its own."""

    condition: Condition
    take: int
    moved: Floats  # (4, 4) places in the first panel's place
    marker_id: int
    off: Floats  # (2,) of its oscillators
    before: int  # frames of the first
    gap: int
    gains: Floats  # (4, 4)


def drawn(case: str, exposure_us: float, seed: int, take: int) -> Swap:
    """In the same place; beside it, nearer or further; or so and turned by quarters."""
    rng = np.random.default_rng([seed, take])
    distance_m, angle_deg = float(rng.choice([0.6, 1.0, 1.5, 2.5, 4.0])), float(rng.choice([0, 30, -50]))
    condition = Condition(
        suite="robustness", case=case, distance_m=distance_m, angle_deg=angle_deg, exposure_us=exposure_us
    )
    (panel,) = draw_take(condition, PANELS, seed, take).scene.panels
    pose = panel.motion.scene_from_body(0.0).copy()
    kind = rng.integers(3)
    if kind:
        aside, along = rng.uniform(-0.3, 0.3, 2) * PANELS.side_m
        pose[:3, 3] += pose[:3, 0] * aside + pose[:3, 1] * along
        pose[:3, 3] *= rng.uniform(0.85, 1.18)
    if kind == 2:
        turn, angle = np.eye(4), rng.integers(4) * math.pi / 2
        turn[:2, :2] = [[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]]
        pose = pose @ turn
    marker_id = int(rng.integers(50))
    if marker_id == panel.marker_id:
        marker_id = (marker_id + 1) % 50
    off = 0.01 * rng.choice((-1.0, 1.0), 2) if case.startswith("oscillators") else np.zeros(2)
    gains = np.maximum(1.0 + 0.08 * rng.standard_normal((4, 4)), 0.05)
    before, gap = int(rng.integers(6, 20)), int(rng.choice(GAPS))
    return Swap(condition, take, pose, marker_id, off, before, gap, gains)


def other(panel: Panel, swap: Swap) -> Panel:
    """The one that comes in its place."""
    spec = PANELS.spec(swap.marker_id)
    spec = spec.retune([hz * (1.0 + off) for hz, off in zip(spec.waves_hz, swap.off.tolist(), strict=True)])
    word, motion = WORDS[swap.marker_id], Still(swap.moved)
    return replace(panel, codeword=word, marker_id=swap.marker_id, spec=spec, motion=motion, cell_gains=swap.gains)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "exposure_us", "seed", "take"),
    [
        ("an edge hidden", 10_000.0, 1, 4),
        ("an edge hidden", 10_000.0, 1, 7),
        ("an edge hidden", 10_000.0, 1, 21),
        ("an edge hidden", 10_000.0, 1, 133),
        ("a corner hidden", 10_000.0, 1, 103),
        ("oscillators off by 1 %", 10_000.0, 2, 132),
        ("touched by something bright", 10_000.0, 2, 120),
        ("touched by something bright", 10_000.0, 2, 122),
        ("an edge hidden", 2_000.0, 2, 1),
        ("an edge hidden", 2_000.0, 2, 59),
        ("a corner hidden", 2_000.0, 2, 61),
        ("an edge hidden", 2_000.0, 3, 133),
    ],
)
def test_the_old_id_is_shown_no_more(case: str, exposure_us: float, seed: int, take: int) -> None:
    """Shows of the new panel its own ID, or none yet."""
    swap = drawn(case, exposure_us, seed, take)
    drawn_take = draw_take(swap.condition, PANELS, seed, take)
    scene, camera = drawn_take.scene, sensor_info(drawn_take.scene.sensor, drawn_take.reported_row_time)
    (panel,), clock = scene.panels, RowClock(camera)
    for seq in range(12):
        clock.add(seq, scene.sensor.row0_readout_ns(seq))
    old = Renderer(scene, seed=drawn_take.seed)
    new = Renderer(replace(scene, panels=(other(panel, swap),)), seed=drawn_take.seed + 1)
    reader, found = PanelReader("stream", clock.corrected(camera), PANELS), []
    for n in range(swap.before + 6):
        is_new = n >= swap.before
        frame = (new if is_new else old).frame(n + swap.gap * is_new, reported_row_time=drawn_take.reported_row_time)
        found.append({each.id for each in reader.read(clock.corrected(frame)).found})
    assert panel.marker_id in set().union(*found[: swap.before])
    assert set().union(*found[swap.before :]) <= {swap.marker_id}
