"""Decoys, which look like a panel and are none: nothing in their scenes may be reported. And places before the camera.

There things are wholly in view, and do not hide each other.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Literal, TypeVar

import numpy as np

from ledpi.camera.simulate.optics import project
from ledpi.camera.simulate.render import panel_corners_m
from ledpi.camera.simulate.scene import Light, Panel, SimulatedSensor, SquareWave
from ledpi.camera.simulate.trajectory import Still, facing_camera
from ledpi.config.panels import PanelSettings
from ledpi.core.codewords import Bits, Dictionary
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.lens import undistort
from ledpi.core.records import Floats, Phase

MARGIN_PX = 16.0  # between a panel's corner and the picture's edge
_TRIES = 30
Thing = TypeVar("Thing")


class NoRoomError(Exception):
    """No free place was found."""


def as_room_is(count: int, make: Callable[[], Thing]) -> tuple[Thing, ...]:
    """So many things, but for those that find no room."""
    made = []
    for _ in range(count):
        with suppress(NoRoomError):
            made.append(make())
    return tuple(made)


def turned_from_sight(position_m: Floats, angle_deg: float, roll_deg: float) -> Floats:
    """Pose of a panel, rolled, whose normal makes `angle_deg` with the line of sight; positive: it faces the left."""
    x, y, z = position_m.tolist()
    yaw_deg, pitch_deg = math.degrees(math.atan2(x, z)), -math.degrees(math.atan2(y, math.hypot(x, z)))
    sight = facing_camera(position_m, yaw_deg=yaw_deg, pitch_deg=pitch_deg) @ np.diag([1.0, -1.0, -1.0, 1.0])
    return np.asarray(sight @ facing_camera(np.zeros(3), yaw_deg=angle_deg, roll_deg=roll_deg))


def place_in_view(
    panels: Sequence[tuple[float, float, float]],
    distance_m: float,
    angle_deg: float,
    offset_px: Floats,
    sensor: SimulatedSensor,
) -> list[Floats]:
    """Poses of panels (shift to the right in metres, side in metres, roll in degrees), `offset_px` off the middle.

    The offset is cut down until all are in view; without one they stand in the middle, in view or not.
    """
    lens = sensor.intrinsics
    middle = np.array([(lens.width - 1) / 2.0, (lens.height - 1) / 2.0])
    poses: list[Floats] = []
    for share in (1.0, 0.75, 0.5, 0.25, 0.0):
        ray = np.append(undistort((middle + share * offset_px)[None], lens)[0], 1.0)
        centre_m = distance_m * ray / np.linalg.norm(ray)
        centres_m = [centre_m + np.array([shift_m, 0.0, 0.0]) for shift_m, _, _ in panels]
        poses = [turned_from_sight(at, angle_deg, roll) for at, (_, _, roll) in zip(centres_m, panels, strict=True)]
        if all(_is_in_view(pose, side, sensor) for pose, (_, side, _) in zip(poses, panels, strict=True)):
            break
    return poses


def _is_in_view(pose: Floats, side_m: float, sensor: SimulatedSensor) -> bool:
    pixels = project(panel_corners_m(side_m), pose, sensor.intrinsics)
    far = np.array([sensor.intrinsics.width, sensor.intrinsics.height]) - 1.0 - MARGIN_PX
    return bool(np.all(pixels >= MARGIN_PX) and np.all(pixels <= far))


class Placer:
    """Finds free places in one picture. What has a place is taken as a disc around its centre."""

    def __init__(self, sensor: SimulatedSensor, rng: np.random.Generator) -> None:
        self._sensor = sensor
        self._rng = rng
        self._taken: list[tuple[Floats, float]] = []  # centre and radius in pixels

    def keep_free(self, position_m: Floats, size_m: float) -> None:
        """Nothing is put where this is."""
        lens = self._sensor.intrinsics
        centre = project(position_m[None], np.eye(4), lens)[0]
        self._taken.append((centre, _radius_px(size_m * lens.fx / float(position_m[2]))))

    def place(self, size_m: float, size_px: float) -> Floats:
        """(3,) m where a thing of that size has room, and is so large in the picture. Raises NoRoomError."""
        lens = self._sensor.intrinsics
        radius = _radius_px(size_px)
        inset = 0.8 * min(radius, lens.height / 2.5)  # a few are cut by the picture's edge
        for _ in range(_TRIES):
            centre = self._rng.uniform((inset, inset), (lens.width - inset, lens.height - inset))
            if all(np.hypot(*(centre - other)) > radius + taken for other, taken in self._taken):
                self._taken.append((centre, radius))
                return np.asarray(size_m * lens.fx / size_px * np.append(undistort(centre[None], lens)[0], 1.0))
        raise NoRoomError


def _radius_px(size_px: float) -> float:
    """Returns that of the disc that a square of that size turns in, its bezel included, and a little more."""
    return 0.8 * size_px + 4.0


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
