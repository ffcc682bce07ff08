"""Panels of which one is built, hung, lit or photographed wrongly, and what a person should be told of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from ledpi.camera.simulate.scene import Light, Panel, Room, Scene
from ledpi.camera.simulate.scenes import still_scene
from ledpi.camera.simulate.trajectory import Still, facing_camera
from ledpi.camera.simulated import SimulatedCamera, simulated_sensor
from ledpi.config.settings import Config, load_config
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.records import PanelValues

DICTIONARY = "DICT_4X4_50"
WORD = load_dictionary(DICTIONARY).codeword(11)
AWAY_M, ASIDE_M = 1.0, 0.12  # of the panel that is wrong; the other one, 7, hangs as far to the left
# Pixels: where it is seen, and its side.
PLACE_PX, SIDE_PX = (319.5 + 2.56 + 643 * ASIDE_M, 239.5 - 1.92), 103.0


@dataclass(frozen=True, kw_only=True)
class Fault:
    """A thing that is other than it should be. `says`: in the words that a person is told."""

    says: str
    panel: Mapping[str, Any] = field(default_factory=dict)  # of panel 11
    blinks: Mapping[str, float] = field(default_factory=dict)  # of panel 11, other than configured
    sensor: Mapping[str, Any] = field(default_factory=dict)
    settings: tuple[str, ...] = ()
    lights: tuple[Light, ...] = ()
    room: Room | None = None
    alone: bool = False  # panel 7 is not there, as it were not read either


def _before(left_share: float) -> Light:
    """Something dark before all but so much of panel 11, along its left side."""
    left_m = ASIDE_M + (left_share - 0.5) * 0.16
    at = np.array([left_m + 0.06, 0.0, 0.97 * AWAY_M])
    return Light(shape="rectangle", width_m=0.12, height_m=0.24, motion=Still(facing_camera(at)), level=0.0)


RIGHT = Fault(says="")  # nothing is
FAULTS: dict[str, Fault] = {
    "swapped": Fault(
        says="looks like ID 11 with its two frequencies swapped", blinks={"black_hz": 2450.0, "white_hz": 1250.0}
    ),
    "other frequencies": Fault(
        says="looks like ID 11 that blinks at about 16", blinks={"black_hz": 1650.0, "white_hz": 3050.0}
    ),
    "mirrored": Fault(says="looks like ID 11 mirrored", panel={"codeword": WORD[:, ::-1]}),
    "other dictionary": Fault(
        says="looks like ID 200 of DICT_4X4_250", panel={"codeword": load_dictionary("DICT_4X4_250").codeword(200)}
    ),
    "other grid": Fault(
        says="looks like ID 11 of DICT_5X5_50", panel={"codeword": load_dictionary("DICT_5X5_50").codeword(11)}
    ),
    "not listed": Fault(says="this is ID 11, which panels.ids does not list", settings=("panels.ids=[7, 3]",)),
    "like a part": Fault(
        says="this is ID 3, or a part or a reflection of a panel",
        panel={"codeword": load_dictionary(DICTIONARY).codeword(3)},
    ),
    "half hidden": Fault(says="partly hidden", lights=(_before(0.5),)),
    "out of focus": Fault(says="out of focus", sensor={"defocus_px": 22.0}, alone=True),
    "too dim": Fault(says="too dim", panel={"brightness": 0.006}, room=Room(level=0.001)),
    "saturated": Fault(says="too bright", panel={"brightness": 3.0}),
    "null": Fault(
        says="is at a null of 1250 Hz and 2500 Hz",
        settings=("panels.white_hz=2500", "camera.exposure_us=9600"),
        blinks={"black_hz": 1250.0, "white_hz": 2500.0},
        alone=True,
    ),
}


def config_of(fault: Fault, *settings: str) -> Config:
    """Returns what the daemon is told."""
    return load_config(None, ("panels.side_m=0.16", "camera.source=simulated", *fault.settings, *settings))


def scene_of(fault: Fault, config: Config) -> Scene:
    """Panel 7 to the left, as it should be, and panel 11 to the right."""
    sensor = replace(simulated_sensor(config.camera, config.panels), **fault.sensor)
    right = config.panels.spec()
    wrong = replace(right, **fault.blinks)
    scene = still_scene(sensor, {7: right, 11: wrong}, DICTIONARY, distance_m=AWAY_M, angle_deg=0.0)
    seven, eleven = scene.panels
    panels: tuple[Panel, ...] = (replace(eleven, **fault.panel),)
    return replace(
        scene,
        panels=panels if fault.alone else (seven, *panels),
        lights=fault.lights,
        room=scene.room if fault.room is None else fault.room,
    )


def camera_of(fault: Fault, config: Config, *, paced: bool) -> SimulatedCamera:
    """That sees it, at rest."""
    values = PanelValues(dictionary=config.panels.dictionary, **asdict(config.panels.spec()))
    return SimulatedCamera(scene_of(fault, config), seed=3, paced=paced, panel=values)
