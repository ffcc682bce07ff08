"""Whether cells meet where a square says: it may be a part of a panel, and its lattice lie amid that one's cells.

Where one cell ends and the next begins it is darker, for a wall, or as cells are brighter in their middles; and of one
panel about as much at each line. Of a part that is taken for a whole panel some lines of the lattice lie amid cells.
Bands are divided out: each cell's light is weighed with what its class shows in that row.
"""

from __future__ import annotations

import math
from functools import cache
from typing import NamedTuple

import cv2
import numpy as np

from ledpi.decode.corners.sides import as_points
from ledpi.decode.striped.light_window import Window
from ledpi.geometry import in_square
from ledpi.records import Floats, Integers, Mask, SeenBands, Singles

BESIDE, ON_A_SIDE = 0.22, 1e-6  # of a cell, to either side: what a line is compared with, and at it, but of one class
ALONG = np.linspace(0.2, 0.8, 4)  # of each cell, away from where four meet
AMID = 0.3  # of a cell, from a line between two of them: what is nearer sees that line, too
LEAST_LIT = 0.3  # of the squares of what the line that is lit best shows
# Of light beside it, by how much a line is darker or brighter; and of the root of what bands bring to the light's
# squares, as of deep ones more is left. Of even cells without walls it is nearly as much in a few frames.
LEAST_SEEN, LEAST_OF_BANDS = 0.1, 0.4
# Of what the line that differs most does, that each must be darker. Of 1,100 panels of all cases at 130 µs to 1 ms and
# 0.45 to 3 m it was 0.22 at least, but for two whose corners were wrong; of parts that were read as a word it was less
# than nothing.
AS_DARK = 0.1


def cells_meet(window: Window, corners_px: Floats, bands: SeenBands, cells: int) -> bool:
    """Whether light amid corners (4, 2) in the window is darker between all the cells, if lines are seen at all."""
    waves = window.waves_of(bands.spec, bands.shape)
    between, amid = _darker(window, corners_px, window.shown(waves, np.array(bands.phases)), bands.white, cells)
    most = max(float(np.abs(between).max(initial=0.0)), float(amid.max(initial=0.0)))
    seen = most > max(LEAST_SEEN, LEAST_OF_BANDS * math.sqrt(waves.share))
    return not seen or float(between.min(initial=math.inf)) > AS_DARK * most


def _darker(window: Window, corners_px: Floats, shown: Singles, white: Mask, cells: int) -> tuple[Floats, Floats]:
    """(lines,) by what share of the light beside it each line between cells is darker, and each amid cells where those
    of a part of a panel may meet; but for lines that dark bands hide.

    `shown` (2, rows) what either class shows in the window's rows, `white` (cells²,) of which each cell is.
    """
    places, of_cell = _places_about_lines(cells)
    at = window.within(as_points(in_square(corners_px, places.reshape(-1, 2)))).reshape(of_cell.shape)
    x, y = (np.asarray(part, np.float32).reshape(-1, 1) for part in (at.real, at.imag))
    light = cv2.remap(window.light, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).reshape(at.shape)
    row = np.round(at.imag).astype(np.int64).clip(0, len(window.light) - 1)
    expected = shown[white[of_cell].astype(np.int64), row]
    tells = np.square(expected).sum(axis=(3, 4))  # (2, lines, places across)
    level = (light * expected).sum(axis=(3, 4)) / np.maximum(tells, 1e-9)
    beside, on_line = level[..., 0] + level[..., 3], level[..., 1] + level[..., 2]
    darker, lit = 1.0 - on_line / np.maximum(beside, 1e-9), tells.min(axis=-1) > LEAST_LIT * tells.max()
    between, amid = np.s_[:, : cells - 1], np.s_[:, cells - 1 :]
    return darker[between][lit[between]], darker[amid][lit[amid]]


class _Places(NamedTuple):
    """(2, lines, places across, cells, places along) of the unit square: about lines across it, then down it.

    First those between its cells, then those of larger cells that are none of its own.
    """

    at: Floats  # (…, 2)
    of_cell: Integers  # in which cell each is, counted row by row


@cache
def _places_about_lines(cells: int) -> _Places:
    own = np.arange(1, cells)
    of_parts = {k * cells / few for few in range(2, cells) for k in range(1, few)}
    amid = sorted(line for line in of_parts if np.abs(line - own).min() > AMID)
    lines = np.array([*own, *amid])[:, None, None, None]
    across = lines + np.array([-BESIDE, -ON_A_SIDE, ON_A_SIDE, BESIDE])[:, None, None]
    along = np.arange(cells)[:, None] + ALONG
    u, v = np.broadcast_arrays(across, along)
    at = np.stack([np.stack([u, v], axis=-1), np.stack([v, u], axis=-1)])  # in cells
    column, row = np.floor(at).astype(np.int64).transpose(5, 0, 1, 2, 3, 4)
    return _Places(at / cells, row * cells + column)
