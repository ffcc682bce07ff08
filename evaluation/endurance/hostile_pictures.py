"""Pictures that were made to bring a decoder down: what is drawn in them. `hostile_frames.py` gives them to one."""

from __future__ import annotations

import string
from collections.abc import Callable
from functools import partial

import cv2
import numpy as np

from ledpi.core.codewords import Bits
from ledpi.core.dictionaries import load_dictionary
from ledpi.core.records import Floats, Pixels, Singles

Rng = np.random.Generator


class Drawing:
    """Light that is steady, that blinks as black cells do, and that blinks as white ones do: (3, height, width)."""

    def __init__(self, width: int, height: int, dictionary: str) -> None:
        self.light: Singles = np.zeros((3, height, width), np.float32)
        self.codewords = load_dictionary(dictionary).codewords

    def add(self, light: Singles, layer: int | np.integer) -> None:
        """This, where it is brighter than what is there."""
        self.light[layer] = np.maximum(self.light[layer], light)

    def draw(self, shape: Callable[[Pixels], object], layer: int | np.integer) -> None:
        """Draws `shape` at 255 into an empty picture."""
        picture = np.zeros(self.light.shape[1:], np.uint8)
        shape(picture)
        self.add(picture.astype(np.float32) / np.float32(255), layer)


def noise(drawing: Drawing, rng: Rng) -> None:
    """Draws it in pixels, or in larger grains."""
    grain, layer = int(rng.integers(1, 9)), rng.integers(3)
    _, height, width = drawing.light.shape
    grains = rng.random((height // grain + 1, width // grain + 1), np.float32)
    drawing.light[layer] += rng.uniform(0, 1.5) * np.kron(grains, np.ones((grain, grain)))[:height, :width] ** 3


def flat(drawing: Drawing, rng: Rng) -> None:
    """All over the picture, up to far too bright; or rising along it."""
    light = drawing.light[rng.integers(3)]
    light += rng.choice((0.0, 0.3, 1.0, 5.0)) * (np.linspace(0, 1, light.shape[1]) if rng.random() < 0.5 else 1.0)


def grid(drawing: Drawing, rng: Rng, pitch: float, filled: float, least: int) -> None:
    """Squares side by side, at least so many a side, each of a layer of its own; seen at a slant."""
    cells = rng.integers(least, least + 9, 2)
    layers = rng.integers(3, size=cells) if rng.random() < 0.7 else np.full(cells, rng.integers(3))
    place = _slanted(pitch * cells[::-1], drawing, rng)
    for layer in range(3):
        unit = np.zeros((int(8 * cells[0]), int(8 * cells[1])), np.float32)
        inner = max(int(8 * filled), 1)
        for row, column in np.argwhere(layers == layer):
            unit[8 * row : 8 * row + inner, 8 * column : 8 * column + inner] = 1.0
        _put(drawing, unit, place, layer, rng.uniform(0.2, 1.5))


def packed(drawing: Drawing, rng: Rng) -> None:
    """A grid that leaves no room."""
    grid(drawing, rng, rng.uniform(4, 24), rng.uniform(0.5, 1.0), 16)


def window(drawing: Drawing, rng: Rng) -> None:
    """Panes."""
    grid(drawing, rng, rng.uniform(30, 110), rng.uniform(0.8, 1.0), 3)


def matrix(drawing: Drawing, rng: Rng) -> None:
    """Single LEDs."""
    grid(drawing, rng, rng.uniform(3, 12), 0.3, 6)


def panel(drawing: Drawing, rng: Rng) -> None:
    """A word of the dictionary; of some size that can be read, or from a few pixels to more than the picture."""
    codeword = drawing.codewords[rng.integers(len(drawing.codewords))]
    side, inner = len(codeword), int(rng.integers(4, 9))
    least, most = (30, 300) if rng.random() < 0.6 else (6, 1500)
    place = _slanted(np.full(2, np.exp(rng.uniform(np.log(least), np.log(most)))), drawing, rng)
    bright = rng.uniform(0.1, 2.0)
    for layer, shows in ((1, ~codeword), (2, codeword)):
        unit = np.zeros((8 * side, 8 * side), np.float32)
        for row, column in np.argwhere(shows):
            unit[8 * row : 8 * row + inner, 8 * column : 8 * column + inner] = 1.0
        _put(drawing, unit, place, layer, bright)


def tiny(drawing: Drawing, rng: Rng) -> None:
    """Four corners within a few pixels, also in a line or in one point."""
    _, height, width = drawing.light.shape
    for _ in range(rng.integers(1, 80)):
        corners = rng.uniform(0, (width, height)) + rng.integers(0, rng.integers(2, 12), (4, 2))
        points = np.rint(corners).astype(np.int32)
        drawing.draw(partial(cv2.fillPoly, pts=[points], color=255), rng.integers(3))


def text(drawing: Drawing, rng: Rng) -> None:
    """Lines of letters and signs."""
    _, height, width = drawing.light.shape
    for _ in range(rng.integers(1, 12)):
        codewords = "".join(rng.choice(list(string.printable[:94]), rng.integers(1, 40)))
        at = (int(rng.integers(-20, width)), int(rng.integers(0, height + 20)))
        put = partial(
            cv2.putText,
            text=codewords,
            org=at,
            fontFace=cv2.FONT_HERSHEY_SIMPLEX,
            fontScale=float(rng.uniform(0.2, 4)),
            color=255,
            thickness=int(rng.integers(1, 8)),
        )
        drawing.draw(put, rng.integers(3))


def squares(drawing: Drawing, rng: Rng) -> None:
    """128 bright ones, apart from each other: each looks like a panel at first."""
    _, height, width = drawing.light.shape
    layer, share = rng.integers(3), rng.uniform(0.4, 0.8)
    for row, column in np.ndindex(8, 16):
        x, y = (int(np.ceil((at + 0.5 - share / 2) * step)) for at, step in ((column, width / 16), (row, height / 8)))
        drawing.light[layer, y : y + int(share * height / 8), x : x + int(share * width / 16)] = 1.0


def keyboard(drawing: Drawing, rng: Rng) -> None:
    """Rows of bright keys, with dark gaps between them; each row begins further right, the first one has long keys."""
    height = drawing.light.shape[1]
    key, first = rng.uniform(0.03, 0.15) * height, rng.uniform(-0.2, 0.5) * height
    for row in range(int(rng.integers(3, 7))):
        long = 40 if row == 0 else 8
        unit = np.zeros((8, 8 * int(rng.integers(6, 16))), np.float32)
        for start in range(0, unit.shape[1], long):
            unit[1:7, start + 1 : start + long - 1] = 1.0
        left, top = key * (0.4 * row + rng.uniform(-1, 1)), first + key * row
        right, bottom = left + key * unit.shape[1] / 8, top + key
        place = np.array([[left, top], [right, top], [right, bottom], [left, bottom]], np.float32)
        _put(drawing, unit, place, 0, rng.uniform(0.3, 1.2))


def stripes(drawing: Drawing, rng: Rng) -> None:
    """Lit rows, or columns, of one pixel or a few: like the bands of a panel, but not."""
    light = drawing.light[rng.integers(3)]
    step, wide = int(rng.integers(2, 24)), int(rng.integers(1, 3))
    for offset in range(wide):
        if rng.random() < 0.7:
            light[offset::step] = 1.0
        else:
            light[:, offset::step] = 1.0


def readable(drawing: Drawing, rng: Rng) -> None:
    """A panel that can be read, before whatever is there; near the middle."""
    codeword = drawing.codewords[rng.integers(len(drawing.codewords))]
    size = rng.uniform(0.2, 0.5) * min(drawing.light.shape[1:])
    corners = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]) * size
    corners += np.array(drawing.light.shape[:0:-1]) / 2 + rng.uniform(-0.04, 0.04, (4, 2)) * size
    put_panel(drawing, corners, codeword)


def put_panel(drawing: Drawing, corners: Floats, codeword: Bits) -> None:
    """A panel with these corners (4, 2) that can be read, with some dark around it."""
    place = corners.astype(np.float32)
    around = np.rint((corners - corners.mean(axis=0)) * 1.15 + corners.mean(axis=0)).astype(np.int32)
    for light in drawing.light:
        cv2.fillPoly(light, [around], 0.0)
    for layer, shows in ((1, ~codeword), (2, codeword)):
        unit = np.kron(shows, np.pad(np.ones((7, 7)), (0, 1))).astype(np.float32)
        _put(drawing, unit, place, layer, 0.4)


KINDS: tuple[Callable[[Drawing, Rng], None], ...] = (
    *(noise, flat, packed, window, matrix, panel, tiny, text, squares, keyboard, stripes),
)


def _slanted(size: Singles, drawing: Drawing, rng: Rng) -> Singles:
    """Corners (4, 2) of a rectangle of that size in pixels, turned and slanted, its middle anywhere in the picture."""
    _, height, width = drawing.light.shape
    corners = (np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) - 0.5) * size
    angle = rng.uniform(-np.pi, np.pi) if rng.random() < 0.5 else 0.0
    turned = corners @ np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    slant = rng.choice((0.0, 0.05, 0.05, 0.4)) * rng.uniform(-1, 1, (4, 2)) * size
    return np.asarray(turned + slant + rng.uniform(0, (width, height)), np.float32)


def _put(drawing: Drawing, unit: Singles, place: Singles, layer: int, bright: float) -> None:
    rows, columns = unit.shape
    own = np.array([[0, 0], [columns, 0], [columns, rows], [0, rows]], np.float32) - 0.5
    warp = cv2.getPerspectiveTransform(own, place)
    _, height, width = drawing.light.shape
    warped = cv2.warpPerspective(unit, warp, (width, height), flags=cv2.INTER_AREA)
    drawing.add(bright * warped, layer)
