"""The faces of panels and lights as textures: what each point sends out, and what it hides.

A surface's frame is the marker's: x right, y up, z out of its front. A texture's row 0 is its top. Each of
its planes is the light of one class while that class is on; the last plane is opacity.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from ledpi.camera.simulate.scene import Light, Panel, Print, Room, SquareWave, Wave
from ledpi.camera.simulate.trajectory import Trajectory
from ledpi.core.codewords import Bits
from ledpi.core.records import Floats

Image = NDArray[np.float32]
PANEL_TEXELS = 512  # across the lit grid: finer than three samples a pixel on panels of up to 170 pixels
PRINT_TEXELS = 2048  # across a print, at most
LIGHT_TEXELS = 256


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Surface:
    """A flat thing that shines, hides what is behind it, or both."""

    planes: tuple[Image, ...]  # (H, W) each: the classes, then opacity
    size_m: tuple[float, float]  # width and height that the texture covers, around the origin
    waves: tuple[Wave | None, ...]  # of each class; None: always on
    reflected: float  # level of what an opaque point returns of the room
    motion: Trajectory
    antiphase: bool = False  # the second class is the first one's, half a cycle later; else each has its own oscillator
    _levels: dict[tuple[int, int], tuple[Image, ...]] = field(default_factory=dict)

    def outline_m(self) -> Floats:
        """(4, 3) corners of the texture, from the top left clockwise."""
        x, y = self.size_m[0] / 2.0, self.size_m[1] / 2.0
        return np.array([[-x, y, 0.0], [x, y, 0.0], [x, -y, 0.0], [-x, -y, 0.0]])

    def shrunk(self, columns: float, rows: float) -> tuple[Image, ...]:
        """The texture averaged down, by powers of √2, to not less than `columns` × `rows`; made once."""
        height, width = self.planes[0].shape
        steps = (_steps(width / max(columns, 1.0)), _steps(height / max(rows, 1.0)))
        if steps not in self._levels:
            size = (max(1, round(width / 2 ** (steps[0] / 2))), max(1, round(height / 2 ** (steps[1] / 2))))
            smaller = (cv2.resize(plane, size, interpolation=cv2.INTER_AREA) for plane in self.planes)
            self._levels[steps] = tuple(np.asarray(plane, np.float32) for plane in smaller)
        return self._levels[steps]


def _steps(ratio: float) -> int:
    return max(0, math.floor(2.0 * math.log2(max(ratio, 1.0))))


def panel_surface(panel: Panel, room: Room, seen_from_m: Floats | None = None) -> Surface:
    """A panel: the light of each group of cells that blink alike, and its opaque face with the bezel.

    `seen_from_m` (3,): the camera's place in the panel's frame, for what walls that stand out hide; None: far ahead.
    """
    cells = len(panel.codeword)
    texels = max(32, PANEL_TEXELS // cells)  # a cell
    bezel = round(panel.appearance.bezel * texels)
    pitch_m = panel.spec.side_m / cells
    eye = None if seen_from_m is None else seen_from_m / pitch_m
    on = panel.brightness / panel.spec.duty * panel.appearance.lights(cells, texels, eye)
    if panel.cell_gains is not None:
        on = on * np.kron(panel.cell_gains, np.ones((texels, texels)))
    groups, waves = _groups(panel)
    own_texels = (np.kron(own, np.ones((texels, texels), bool)) for own in groups)
    classes = [np.pad(np.where(own, on, 0.0), bezel).astype(np.float32) for own in own_texels]
    size_m = panel.spec.side_m * len(classes[0]) / (cells * texels)
    return Surface(
        planes=(*classes, np.ones_like(classes[0])),
        size_m=(size_m, size_m),
        waves=waves,
        reflected=panel.appearance.albedo * room.level,
        motion=panel.motion,
        antiphase=panel.spec.phase == "antiphase" and panel.cell_waves is None,
    )


def _groups(panel: Panel) -> tuple[list[Bits], tuple[Wave, ...]]:
    """The (n, n) cells that share a wave, and the wave: the codeword's black and white, or as they were traced."""
    if panel.cell_waves is None:
        frequencies = (panel.spec.black_hz, panel.spec.white_hz)
        return [~panel.codeword, panel.codeword], tuple(
            SquareWave(frequency_hz=f, duty=panel.spec.duty) for f in frequencies
        )
    waves = tuple({id(wave): wave for wave in panel.cell_waves}.values())
    own = [np.array([each is wave for each in panel.cell_waves]).reshape(panel.codeword.shape) for wave in waves]
    return own, waves


def light_surface(light: Light) -> Surface:
    """A lamp, a window, or something in the way."""
    position = (np.arange(LIGHT_TEXELS) + 0.5) / LIGHT_TEXELS
    on = opacity = np.ones((LIGHT_TEXELS, LIGHT_TEXELS))
    if light.shape == "disc":
        distance = np.hypot(position[:, None] - 0.5, position[None, :] - 0.5)
        on = opacity = np.clip((0.5 - distance) * LIGHT_TEXELS + 0.5, 0.0, 1.0)
    elif light.shape == "lattice":
        clear = [_bar_pattern(position * panes, light.bar) for panes in light.panes]
        on = np.outer(clear[1], clear[0])
    duty = light.wave.duty if isinstance(light.wave, SquareWave) else 1.0
    return Surface(
        planes=((light.level / duty * on).astype(np.float32), opacity.astype(np.float32)),
        size_m=(light.width_m, light.height_m),
        waves=(light.wave,),
        reflected=0.0,
        motion=light.motion,
    )


def print_surface(printed: Print, room: Room) -> Surface:
    """Prints something: as the paper and the ink return the room's light."""
    modules = np.pad(printed.modules, printed.quiet_modules, constant_values=True)
    columns = printed.modules.shape[1]
    texels = min(max(32, PANEL_TEXELS // columns), max(1, PRINT_TEXELS // columns))  # a module
    level = np.kron(np.where(modules, printed.white, printed.black), np.ones((texels, texels))).astype(np.float32)
    module_m = printed.width_m / columns
    return Surface(
        planes=(level, np.ones_like(level)),
        size_m=(module_m * modules.shape[1], module_m * modules.shape[0]),
        waves=(room.ripple,),
        reflected=0.0,
        motion=printed.motion,
    )


def _bar_pattern(position: Floats, bar: float) -> Floats:
    """1 on the panes, 0 on the bars around each, half a bar's width in every pane; `position` in panes."""
    to_edge = 0.5 - np.abs(position - np.floor(position) - 0.5)
    texels = 1.0 / (position[1] - position[0])  # a pane
    return np.asarray(np.clip((to_edge - bar / 2.0) * texels + 0.5, 0.0, 1.0))
