"""Things that look like a panel and are none: nothing in these scenes may be reported."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal

import numpy as np

from evaluation.suites.placing import Placer, as_room_is, turned_from_sight
from ledpi.camera.simulate.scene import Light, Panel, SimulatedSensor, SquareWave
from ledpi.camera.simulate.trajectory import Still
from ledpi.config.panels import PanelSettings
from ledpi.core.codewords import Bits, Dictionary
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.records import Floats, Phase

THINGS = (3, 6)  # in a scene, from to
SIZE_PX = (14.0, 220.0)  # of lamps and panels in the picture
NEAR_CELLS = (2, 4)  # that differ from a codeword, from to: the patterns that are easiest to mistake
OFF = 2  # cells by which these differ from every codeword


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Decoys:
    """Panels here have no marker_id: they have no truth."""

    panels: tuple[Panel, ...] = ()
    lights: tuple[Light, ...] = ()


def decoys(kind: str, sensor: SimulatedSensor, panels: PanelSettings, rng: np.random.Generator) -> Decoys:
    """A few decoys of one kind, none before the other."""
    placer = Placer(sensor, rng)
    count = int(rng.integers(THINGS[0], THINGS[1] + 1))
    if kind in _LIGHTS:
        return Decoys(lights=as_room_is(count, lambda: _LIGHTS[kind](placer, rng)))
    if kind == "dead":
        lit = as_room_is(count // 2, lambda: _lit_for_good(placer, panels, rng))
        dark = as_room_is(count - count // 2, lambda: _panel(np.zeros(0, bool), placer, panels, rng))
        return Decoys(panels=dark, lights=lit)
    dictionary = load_dictionary(panels.dictionary)
    shown = as_room_is(count, lambda: _panel(_PATTERNS[kind](dictionary, panels.phase, rng), placer, panels, rng))
    return Decoys(panels=tuple(_part_of(panel, rng) for panel in shown) if kind == "parts" else shown)


def lamp(placer: Placer, rng: np.random.Generator) -> Light:
    """A steady disc or rectangle, a third of them too bright. Raises NoRoomError."""
    shape: Literal["disc", "rectangle"] = "disc" if rng.random() < 0.5 else "rectangle"
    aspect = float(rng.choice((1.0, rng.uniform(0.2, 1.0))))
    level = float(rng.uniform(0.15, 1.4))
    return _light(placer, rng, Light(shape=shape, width_m=1.0, height_m=aspect, motion=Still(), level=level))


def _window(placer: Placer, rng: np.random.Generator) -> Light:
    aspect, level = float(rng.uniform(0.5, 2.0)), float(rng.uniform(0.3, 1.2))
    return _light(placer, rng, Light(shape="rectangle", width_m=1.0, height_m=aspect, motion=Still(), level=level))


def _window_grid(placer: Placer, rng: np.random.Generator) -> Light:
    """Half of them square, 4 × 4: what a panel looks like to whoever sees no bands."""
    panes = (4, 4) if rng.random() < 0.5 else (int(rng.integers(2, 7)), int(rng.integers(2, 7)))
    level, bar = float(rng.uniform(0.2, 0.9)), float(rng.uniform(0.04, 0.2))
    high = panes[1] / panes[0]
    grid = Light(shape="lattice", width_m=1.0, height_m=high, motion=Still(), level=level, panes=panes, bar=bar)
    return _light(placer, rng, grid)


def _pwm_light(placer: Placer, rng: np.random.Generator) -> Light:
    light = (lamp, _window, _window_grid)[int(rng.integers(3))](placer, rng)
    hz = math.exp(rng.uniform(math.log(100.0), math.log(20_000.0)))
    wave = SquareWave(frequency_hz=hz, duty=float(rng.uniform(0.1, 0.9)))
    return replace(light, wave=wave, level=0.6 * light.level)


_LIGHTS: dict[str, Callable[[Placer, np.random.Generator], Light]] = {
    "lamps": lamp,
    "windows": _window,
    "window_grids": _window_grid,
    "pwm_lights": _pwm_light,
}


def _light(placer: Placer, rng: np.random.Generator, shape: Light) -> Light:
    """`shape`, whose width is 1, at some size and place; it faces the camera within 50°."""
    size_m = float(np.exp(rng.uniform(math.log(0.05), math.log(1.0))))
    pose = _pose(size_m * max(1.0, shape.height_m), placer, rng)
    return replace(shape, width_m=size_m, height_m=size_m * shape.height_m, motion=Still(pose))


def _pose(size_m: float, placer: Placer, rng: np.random.Generator) -> Floats:
    """Somewhere in the picture, of a size in SIZE_PX."""
    position = placer.place(size_m, math.exp(rng.uniform(math.log(SIZE_PX[0]), math.log(SIZE_PX[1]))))
    return turned_from_sight(position, float(rng.uniform(-50.0, 50.0)), float(rng.uniform(-180.0, 180.0)))


def _panel(codeword: Bits, placer: Placer, panels: PanelSettings, rng: np.random.Generator) -> Panel:
    """A panel that shows `codeword`; an empty codeword is a panel that is switched off."""
    pose = _pose(panels.side_m, placer, rng)
    n = load_dictionary(panels.dictionary).cells_per_side
    level = float(rng.uniform(0.15, 0.45))
    return Panel(
        codeword=codeword.reshape(n, n) if codeword.size else np.zeros((n, n), bool),
        spec=panels.spec(),
        motion=Still(pose),
        marker_id=None,
        brightness=level if codeword.size else 0.0,
        cell_gains=np.maximum(1.0 + 0.05 * rng.standard_normal((n, n)), 0.05),
    )


def _lit_for_good(placer: Placer, panels: PanelSettings, rng: np.random.Generator) -> Light:
    """A panel whose LEDs do not blink."""
    pose, side = _pose(panels.side_m, placer, rng), panels.side_m
    n = load_dictionary(panels.dictionary).cells_per_side
    level = float(rng.uniform(0.2, 0.9))
    return Light(shape="lattice", width_m=side, height_m=side, motion=Still(pose), level=level, panes=(n, n), bar=0.06)


def _single_class(dictionary: Dictionary, _: Phase, rng: np.random.Generator) -> Bits:
    n = dictionary.cells_per_side
    return np.full((n, n), rng.random() < 0.5)


def _near_codeword(dictionary: Dictionary, phase: Phase, rng: np.random.Generator, off: int = OFF) -> Bits:
    """A codeword with a few cells changed so that `off` or more differ from any codeword."""
    while True:
        codeword = dictionary.codewords[rng.integers(len(dictionary.codewords))].copy()
        changed = rng.permutation(codeword.size)[: int(rng.integers(NEAR_CELLS[0], NEAR_CELLS[1] + 1))]
        codeword.ravel()[changed] ^= True
        if _distance(codeword, dictionary, phase) >= off:
            return np.asarray(codeword)


def _mirrored(dictionary: Dictionary, phase: Phase, rng: np.random.Generator) -> Bits:
    while True:
        codeword = dictionary.codewords[rng.integers(len(dictionary.codewords)), :, ::-1]
        if _distance(codeword, dictionary, phase) > 0:
            return np.asarray(codeword)


def _codeword(dictionary: Dictionary, _: Phase, rng: np.random.Generator) -> Bits:
    return np.asarray(dictionary.codewords[rng.integers(len(dictionary.codewords))])


def _part_of(panel: Panel, rng: np.random.Generator) -> Panel:
    """The panel with all cells dark but for a block of two cells to half of them."""
    n = len(panel.codeword)
    while True:
        rows, columns = rng.integers(1, n + 1, 2)
        if 2 <= rows * columns <= n * n // 2:
            break
    row, column = rng.integers(n - rows + 1), rng.integers(n - columns + 1)
    lit = np.zeros((n, n), bool)
    lit[row : row + rows, column : column + columns] = True
    return replace(panel, cell_gains=lit * (1.0 if panel.cell_gains is None else panel.cell_gains))


def _distance(codeword: Bits, dictionary: Dictionary, phase: Phase) -> int:
    """The number of cells off the nearest codeword, in any rotation; in antiphase, off its negative too."""
    differ = (dictionary.rotated_codewords() != codeword).sum(axis=(2, 3))
    return int(differ.min() if phase == "free" else np.minimum(differ, codeword.size - differ).min())


_PATTERNS: dict[str, Callable[[Dictionary, Phase, np.random.Generator], Bits]] = {
    "single_class": _single_class,
    "near_words": _near_codeword,
    "mirrored": _mirrored,
    "parts": _codeword,
    "hidden_strip": _near_codeword,
    "dead_cell": partial(_near_codeword, off=OFF + 1),  # none still when one of its cells cannot be seen
}
