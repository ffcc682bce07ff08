"""Draws one take of a condition: what stands where, in which room, seen by which sensor. Seeded.

Every take has its own ID, roll, place in the picture (so the sub-pixel position), room, brightness, cell gains and
oscillator phases. Take 17 at one distance and angle is the same for every case, exposure and tone, but for what these
change, so that small differences between their rates mean something.
"""

from __future__ import annotations

import math
import zlib
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from evaluation.simulated import BuiltAppearance
from evaluation.suites.conditions import Condition, Variation
from evaluation.suites.decoys import decoys, place_in_view
from evaluation.suites.surroundings import frames, lamps_beside, occluders, pages, touching
from ledpi.camera.simulate.scene import OV5647_ROW_TIME_US, Panel, Room, Scene, SimulatedSensor
from ledpi.camera.simulate.trajectory import Gliding, Still, Trajectory
from ledpi.camera.simulated import simulated_sensor
from ledpi.config.panels import PanelSettings
from ledpi.config.settings import CameraSettings
from ledpi.core import shutter
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.errors import ConfigError
from ledpi.core.records import Floats, PanelSpec
from ledpi.workshop.evaluate.scoring import FRAMES_A_TAKE

OFFSET_PX = (80.0, 60.0)  # how far from the picture's middle a panel is put, at most
HUNG_BY_HAND_DEG = 3.0
APART_SIDES = (1.6, 2.4)  # of two panels' centres; turned by 45°, with their bezels, they need 1.53
_PLACE, _EXTRA, _RENDERER = 0, 1, 2  # independent streams of random numbers


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Take:
    """A scene to be photographed, and what the driver says of its sensor."""

    scene: Scene
    peak_level: float  # of the panels: what is printed in their place is as bright
    seed: int  # the renderer's
    reported_row_time: float  # over the truth


def draw_take(
    condition: Condition, panels: PanelSettings, seed: int, number: int, frame_duration_us: float | None = None
) -> Take:
    """Take `number` of a condition. `frame_duration_us` None: as the daemon would choose it."""
    streams = [_stream(condition, seed, number, purpose) for purpose in (_PLACE, _EXTRA, _RENDERER)]
    place, extra = np.random.default_rng(streams[0]), np.random.default_rng(streams[1])
    variation = condition.variation
    sensor = _sensor(condition, panels, frame_duration_us)
    room = Room(
        level=float(place.uniform(*variation.room_level)),
        distance_m=max(4.0, (condition.distance_m or 0.0) + 1.5),
        texture=int(place.integers(2**31)),
        ripple=variation.room_ripple,
    )
    peak = float(place.uniform(*variation.peak_level))
    if condition.suite == "decoys":
        found = decoys(condition.case, sensor, panels, place)
        dead = variation.dead_cells
        shown = tuple(replace(each, cell_gains=_kill_cells(each.cell_gains, dead, extra)) for each in found.panels)
        lights = (*found.lights, *occluders(variation, shown, extra))
        scene = Scene(sensor=sensor, room=room, panels=shown, lights=lights)
    else:
        shown = _panels(condition, panels, sensor, peak, place, extra)
        scene = Scene(
            sensor=sensor,
            room=room,
            panels=shown,
            prints=pages(variation, shown, extra),
            lights=(
                *occluders(variation, shown, extra),
                *touching(variation, shown, extra),
                *frames(variation, shown, extra),
                *lamps_beside(variation, shown, sensor, extra),
            ),
            camera_motion=_camera_motion(variation, sensor, extra),
        )
    return Take(
        scene=scene,
        peak_level=peak,
        seed=int(streams[2].generate_state(1, np.uint64)[0]),
        reported_row_time=variation.reported_row_time,
    )


def _stream(condition: Condition, seed: int, number: int, purpose: int) -> np.random.SeedSequence:
    where = condition.case if condition.suite == "decoys" else f"{condition.distance_m} {condition.angle_deg}"
    return np.random.SeedSequence(seed, spawn_key=(zlib.crc32(where.encode()), number, purpose))


def _sensor(condition: Condition, panels: PanelSettings, frame_duration_us: float | None) -> SimulatedSensor:
    """Returns the exposure and frame period that the daemon would choose, by the row time that the driver reports."""
    variation = condition.variation
    assert condition.transfer != "any"
    true_us = variation.row_time_us or OV5647_ROW_TIME_US
    settings = CameraSettings(
        source="simulated",
        exposure_us=condition.exposure_us,
        transfer=condition.transfer,
        row_time_us=true_us * variation.reported_row_time,
        frame_duration_us=variation.frame_period_us or frame_duration_us or "auto",
    )
    chosen = simulated_sensor(settings, panels)  # the sensor keeps to these rows, whatever time each takes
    return replace(
        chosen,
        row_time_us=true_us,
        exposure_us=chosen.exposure_us / variation.reported_row_time,
        tone_contrast=variation.tone_contrast,
        sharpening=variation.sharpening,
    )


def _panels(
    condition: Condition,
    panels: PanelSettings,
    sensor: SimulatedSensor,
    peak: float,
    place: np.random.Generator,
    extra: np.random.Generator,
) -> tuple[Panel, ...]:
    """The panels in view, each at its own codeword, gains and roll; together they are somewhere near the middle."""
    variation, dictionary = condition.variation, load_dictionary(panels.dictionary)
    assert condition.distance_m is not None
    assert condition.angle_deg is not None
    ids = _shuffled_ids(panels, place)[: max(2, variation.panels)]
    n = dictionary.cells_per_side
    gains = 1.0 + variation.gain_deviation * place.standard_normal((len(ids), n, n))
    span_deg = 180.0 if condition.any_roll else HUNG_BY_HAND_DEG
    rolls_deg = span_deg * place.uniform(-1.0, 1.0, len(ids))
    offset_px = place.uniform(-1.0, 1.0, 2) * OFFSET_PX
    specs = [panels.spec(int(marker_id)) for marker_id in ids[: variation.panels]]
    pitch_m = float(extra.uniform(*APART_SIDES)) * max(spec.side_m for spec in specs)
    shifts_m = [(k - (len(specs) - 1) / 2.0) * pitch_m for k in range(len(specs))]
    poses = place_in_view(
        [(shift_m, spec.side_m, roll) for shift_m, spec, roll in zip(shifts_m, specs, rolls_deg, strict=False)],
        condition.distance_m,
        condition.angle_deg,
        offset_px,
        sensor,
    )
    return tuple(
        Panel(
            codeword=dictionary.codeword(int(marker_id)),
            spec=_apply_tolerances(spec, variation, extra),
            motion=Still(pose),
            marker_id=int(marker_id),
            brightness=brightness_of(peak, spec, sensor),
            cell_gains=_kill_cells(np.maximum(own_gains, 0.05), variation.dead_cells, extra),
            appearance=_appearance(variation),
        )
        for marker_id, spec, pose, own_gains in zip(ids, specs, poses, gains, strict=False)
    )


def drawable_ids(panels: PanelSettings) -> list[int]:
    """The IDs that exist and can be read, rising. Raises ConfigError where there is none."""
    existing = panels.existing_ids()
    ids = [i for i in load_dictionary(panels.dictionary).readable_ids(panels.phase) if i in existing]
    if not ids:
        raise ConfigError("panels.ids: has none that can be read; at least one must be drawn")
    return ids


def _shuffled_ids(panels: PanelSettings, place: np.random.Generator) -> NDArray[np.int64]:
    """Those that can be drawn. Shuffled with all others, so that which exist changes nothing else of a take."""
    order = place.permutation(load_dictionary(panels.dictionary).readable_ids(panels.phase))
    return order[np.isin(order, drawable_ids(panels))]


def _appearance(variation: Variation) -> BuiltAppearance:
    appearance = BuiltAppearance(
        gap=variation.gap,
        equal_cells=variation.equal_cells,
        hot_spot=variation.hot_spot,
        hot_spot_sigma=variation.hot_spot_sigma,
        falloff=variation.falloff,
    )
    without = variation.on_a_page or variation.touching or variation.bezel != "black"
    return replace(appearance, bezel=0.0) if without else appearance


def _kill_cells(gains: Floats | None, dead: int, extra: np.random.Generator) -> Floats:
    assert gains is not None, "each panel that is drawn has gains of its own"
    gains.ravel()[extra.permutation(gains.size)[:dead]] = 0.0
    return gains


def brightness_of(peak_level: float, spec: PanelSpec, sensor: SimulatedSensor) -> float:
    """The level, averaged over the blinking, whose brightest band is at `peak_level`: deep bands need room above."""
    depth = max(shutter.contrast(hz, sensor.exposure_us, spec.duty) for hz in (spec.black_hz, spec.white_hz))
    return peak_level / (1.0 + depth / 2.0)


def _apply_tolerances(spec: PanelSpec, variation: Variation, extra: np.random.Generator) -> PanelSpec:
    off = 1.0 + variation.oscillator_error * extra.choice((-1.0, 1.0), 2)
    return spec.retune([hz * own for hz, own in zip(spec.waves_hz, off.tolist(), strict=False)])


def _camera_motion(variation: Variation, sensor: SimulatedSensor, extra: np.random.Generator) -> Trajectory:
    """Over the floor, and at the scene's origin in the middle of the take."""
    direction, speed = 2.0 * math.pi * extra.random(), variation.speed_m_s * extra.random()
    turn = variation.turn_rad_s * extra.uniform(-1.0, 1.0)
    if not (speed or turn):
        return Still()
    middle_s = sensor.mid_exposure_s(FRAMES_A_TAKE // 2, sensor.intrinsics.height / 2.0)
    return Gliding(
        start=np.eye(4),
        velocity_m_s=speed * np.array([math.sin(direction), 0.0, math.cos(direction)]),
        angular_velocity_rad_s=np.array([0.0, turn, 0.0]),
        start_s=middle_s,
    )
