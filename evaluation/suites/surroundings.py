"""The surroundings of a take's panels: a page behind them, something in the way, something bright that touches them.

Each draws from a stream of random numbers what a variation asks for, and nothing where it asks for nothing.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from evaluation.suites.conditions import Variation
from evaluation.suites.decoys import Placer, as_room_is, lamp
from ledpi.camera.simulate.scene import Light, Panel, Print, SimulatedSensor
from ledpi.camera.simulate.trajectory import Still
from ledpi.core.geometry import transform
from ledpi.core.records import Floats

# A page behind a panel: spots across it, its width in the panel's sides, the share of ink, levels of paper and ink.
PAGE_SPOTS, PAGE_SIDES, PAGE_INK, PAGE_WHITE, PAGE_BLACK = 20, 2.6, 0.35, (0.1, 0.25), (0.01, 0.05)
# Of a frame: share of the panel's light, and its width as a share of the panel's side.
FRAMES = {"bright": ((0.2, 0.6), (0.04, 0.2)), "white": ((0.8, 1.2), (0.01, 0.08))}
BEFORE = 0.8  # over the panel's distance: surely before it
TOUCHING_LEVEL = (0.1, 0.6)  # of what touches a panel, whose cells are at 0.35 to 0.7 in their middle


def pages(variation: Variation, shown: tuple[Panel, ...], extra: np.random.Generator) -> tuple[Print, ...]:
    """Behind each panel a page with spots anywhere, of paper that is grey beside the panel's rim."""
    pages = []
    for panel in shown if variation.on_a_page else ():
        page = page_behind(panel, PAGE_SPOTS, PAGE_SIDES, extra)
        white, black = (float(extra.uniform(*levels)) for levels in (PAGE_WHITE, PAGE_BLACK))
        pages.append(replace(page, white=white, black=black))
    return tuple(pages)


def page_behind(panel: Panel, spots: int, sides: float, rng: np.random.Generator, depth: float = 1.002) -> Print:
    """A page with so many spots across its width of so many sides of the panel, on the same lines of sight."""
    pose = panel.motion.scene_from_body(0.0).copy()
    pose[:3, 3] *= depth
    modules = rng.random((spots, spots)) > PAGE_INK
    return Print(modules=modules, width_m=sides * panel.spec.side_m, motion=Still(pose), white=1.0, black=0.0)


def occluders(variation: Variation, shown: tuple[Panel, ...], extra: np.random.Generator) -> tuple[Light, ...]:
    """Something dark before a corner or an edge of each panel, square to its sides."""
    hidden = []
    for panel in shown if variation.hidden else ():
        side, share = panel.spec.side_m, float(variation.hidden_share * extra.random())
        turn = int(extra.integers(4)) * math.pi / 2.0
        along, wide = (0.5, 2.0 * share) if variation.hidden == "corner" else (0.0, 1.4)
        at_m, size_m = (along * side, 0.5 * side), (wide * side, 2.0 * share * side)
        hidden.append(rectangle(panel, turn, at_m, size_m, depth=BEFORE))
    return tuple(hidden)


def touching(variation: Variation, shown: tuple[Panel, ...], extra: np.random.Generator) -> tuple[Light, ...]:
    """Something bright along a part of some sides of each panel, or more than all of it."""
    lights = []
    for panel in shown:
        side = panel.spec.side_m
        for turn in extra.permutation(4)[: variation.touching]:
            along, width, height = extra.uniform((-0.5, 0.3, 0.3), (0.5, 1.5, 1.0)) * side
            level = float(extra.uniform(*TOUCHING_LEVEL))
            at_m, size_m = (along, 0.5 * (side + height)), (float(width), float(height))
            lights.append(rectangle(panel, turn * math.pi / 2.0, at_m, size_m, depth=1.002, level=level))
    return tuple(lights)


def frames(variation: Variation, shown: tuple[Panel, ...], extra: np.random.Generator) -> tuple[Light, ...]:
    """A bright bezel around each panel: one that is white, or that the panel itself lights up."""
    if variation.bezel not in FRAMES:
        return ()
    share_of_light, share_of_side = FRAMES[variation.bezel]
    lights = []
    for panel in shown:
        level = float(panel.brightness * extra.uniform(*share_of_light))
        size_m = float(panel.spec.side_m * (1.0 + 2.0 * extra.uniform(*share_of_side)))
        lights.append(rectangle(panel, 0.0, (0.0, 0.0), (size_m, size_m), depth=1.002, level=level))
    return tuple(lights)


def rectangle(
    panel: Panel, turn: float, at_m: tuple[float, float], size_m: tuple[float, float], depth: float, level: float = 0.0
) -> Light:
    """A light at a place in the panel's frame, turned about its middle (rad), on the same lines of sight: `depth` times
    as far away, and as much larger.
    """
    c, s = math.cos(turn), math.sin(turn)
    centre = np.array([c * at_m[0] - s * at_m[1], s * at_m[0] + c * at_m[1], 0.0])
    in_panel = transform(np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]), centre)
    pose: Floats = panel.motion.scene_from_body(0.0) @ in_panel
    pose[:3, 3] *= depth
    width_m, height_m = size_m[0] * depth, size_m[1] * depth
    return Light(shape="rectangle", width_m=width_m, height_m=height_m, motion=Still(pose), level=level)


def lamps_beside(
    variation: Variation, shown: tuple[Panel, ...], sensor: SimulatedSensor, extra: np.random.Generator
) -> tuple[Light, ...]:
    """Other lamps that hide no panel, on the same mains as the room's."""
    placer = Placer(sensor, extra)
    for panel in shown:
        placer.keep_free(panel.motion.scene_from_body(0.0)[:3, 3], panel.spec.side_m)
    lamps, ripple = as_room_is(variation.lamps, lambda: lamp(placer, extra)), variation.room_ripple
    return lamps if ripple is None else tuple(replace(light, wave=ripple) for light in lamps)
