"""Information of a camera's pictures on each cell's class, for any pair of frequencies and frame period.

A cell shows its class's bands x_k (cosine and sine of amplitude a_k). Taken for the other class it would have to show
the other's, so what tells the two apart is δ = (−x_black, +x_white), or −2·x_black in antiphase. I, the decoder's own
Fisher information of that cell (`decode.evidence`, `decode.memory`), has gain, the profile that cells share, and wrong
corners projected out, and noise as it measures it. Then the log-likelihood ratio of the two is normal with mean
D = ½ δᵀIδ and variance 2D (nats).

I depends on where the rows lie and how noisy they are, not on the bands. So a panel is pictured *steady*, by the
simulator, a few times from each distance; every pair and period is then judged on the same pictures.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ledpi.camera.simulate.render import Renderer, scene_truth
from ledpi.camera.simulate.scene import Panel, Room, Scene, SimulatedSensor, uneven_gains
from ledpi.camera.simulate.trajectory import Still, facing_camera
from ledpi.core.records import Floats, Intrinsics, PanelSpec, Rejected
from ledpi.decode.evidence.cells import Observation
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.evidence.light import LightWeigher
from ledpi.decode.evidence.memory import PanelMemory
from ledpi.decode.locate import Locator

STREAM_FRAMES = 4  # that a panel is followed for, where a stream is judged
_ROLL_DEG = 2.0  # as hung by hand; also keeps the pixels from lying alike in all cells
_OFF_CENTRE_PX = (0.3, -0.2)
_GAIN_DEVIATION = 0.05
_MARGIN_PX = 12  # of unlit bezel and wall around the panel
_BRIGHTNESS = 0.5  # level of a cell's middle: well lit, not saturated
_PHASES = 8  # of either class, evenly over half a turn of one and a whole turn of the other: signs cancel


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """Pictures of one steady panel from one place."""

    distance_m: float
    cells: int
    shots: tuple[Observation, ...]  # noise is all that differs


def view_panel(sensor: SimulatedSensor, cells: int, side_m: float, distance_m: float) -> View | Rejected:
    """Pictures a steady panel, or says why its cells cannot be sampled from there."""
    scene = _steady_scene(sensor, cells, side_m, distance_m)
    renderer = Renderer(scene, seed=0)
    seen = scene_truth(scene, 0)
    if not seen:
        return Rejected(stage="cells", reason="too_small")
    locator = Locator(cells, (scene.panels[0].spec,), None, must_blink=False)
    shots = []
    for seq in range(STREAM_FRAMES):
        frame = renderer.frame(seq)
        quad = locator.localise(frame, seen[0].corners_px)
        shown = quad if isinstance(quad, Rejected) else locator.observe(frame, quad)
        if isinstance(shown, Rejected):
            return shown
        shots.append(shown)
    return View(distance_m=distance_m, cells=cells, shots=tuple(shots))


def _steady_scene(sensor: SimulatedSensor, cells: int, side_m: float, distance_m: float) -> Scene:
    """A panel that does not blink, before a camera that sees little else."""
    focal = sensor.intrinsics.fx
    size = math.ceil(1.3 * focal * side_m / distance_m) + 2 * _MARGIN_PX
    middle = (size - 1) / 2
    lens = Intrinsics(
        width=size, height=size, fx=focal, fy=focal, cx=middle + _OFF_CENTRE_PX[0], cy=middle + _OFF_CENTRE_PX[1]
    )
    null_hz = 1e6 / sensor.exposure_us  # whole cycles in an exposure leave no bands
    panel = Panel(
        codeword=np.zeros((cells, cells), bool),
        spec=PanelSpec(side_m=side_m, black_hz=null_hz, white_hz=2 * null_hz),
        motion=Still(facing_camera(np.array([0.0, 0.0, distance_m]), roll_deg=_ROLL_DEG)),
        marker_id=0,
        brightness=_BRIGHTNESS,
        cell_gains=uneven_gains(np.random.default_rng(0), cells, _GAIN_DEVIATION),
    )
    small = replace(sensor, intrinsics=lens, frame_length_rows=max(size, sensor.frame_length_rows))
    return Scene(sensor=small, panels=(panel,), room=Room(distance_m=1.5 * distance_m))


def evidence_of(view: View, spec: PanelSpec, *, frames: int, frame_length_rows: int) -> Evidence:
    """Draws what the decoder knows after so many frames: its information, and a score that is noise alone.

    A panel that it could not fit at all gives information 0.
    """
    memory, weigher = PanelMemory(spec), LightWeigher(view.cells, None)
    for seq, shown in enumerate(view.shots[:frames]):
        readout_ns = round(seq * frame_length_rows * shown.frame.row_time_us * 1e3)
        memory, _ = memory.add_frame(shown._replace(frame=replace(shown.frame, row0_readout_ns=readout_ns)), weigher)
    known = memory.evidence(weigher)
    if isinstance(known, Evidence):
        return known
    shape = (view.cells**2, 2 * len(spec.waves_hz))
    return Evidence(score=np.zeros(shape), information=np.zeros(shape * 2), prior=np.full(shape[1], 1e-12))


def separation_nats(evidence: Evidence, depths: tuple[float, float]) -> float:
    """The information D that separates the classes in a cell, for amplitudes `depths` of black's and white's bands.

    Phases are as they come, and the worst decide: this is the D of a cell that would be mistaken as often as these are
    on average over all cells and phases, by Bhattacharyya's bound exp(−D/4). Two frequencies that nearly coincide have
    much information on average and little of it where their phases agree.
    """
    own = evidence.own_information
    changes = _changes(depths, len(evidence.prior) // 2)
    separations = 0.5 * np.einsum("pci,pi->pc", np.einsum("pj,cij->pci", changes, own), changes)
    return float(-4.0 * (np.logaddexp.reduce(-separations.ravel() / 4.0) - math.log(separations.size)))


def _changes(depths: tuple[float, float], waves: int) -> Floats:
    """(phases, 2·waves) δ: what a cell of class black shows more or less when it is taken for white."""
    if waves == 1:
        turn = 2 * np.pi * np.arange(_PHASES) / _PHASES
        return -2 * depths[0] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    black, white = np.meshgrid(np.arange(_PHASES) / (2 * _PHASES), np.arange(_PHASES) / _PHASES, indexing="ij")
    b, w = 2 * np.pi * black.ravel(), 2 * np.pi * white.ravel()
    return np.stack(
        [-depths[0] * np.cos(b), -depths[0] * np.sin(b), depths[1] * np.cos(w), depths[1] * np.sin(w)], axis=1
    )
