"""Whether a square is a part of a panel: its cells do not meet where it says, or its bands go on beyond its sides.

Where a panel's cells shine in their middles only, or something hides some of them, others may be found by themselves.
Four by four cells laid over two by four of a panel, turned away by 60°, explain their light about as well, and among
patterns whose neighbours are alike there are words. But what is beside a whole panel shows none of its bands, however
bright it is.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from ledpi.decode.corners.sides import as_points
from ledpi.decode.striped.fitted_square import STEADY
from ledpi.decode.striped.inner_walls import cells_meet
from ledpi.decode.striped.light_window import Window
from ledpi.decode.striped.panel_fit import pitches
from ledpi.geometry import in_square
from ledpi.records import Floats, Quad, Rejected, SeenBands, Singles

PART = Rejected(stage="edges", reason="part_of_panel")

# Of a cell's longer side, that is looked at beyond a side of the square: but for what lens and walls blur at the side
# itself, and not as far as another panel may hang. Within it as much of a cell, whichever way it lies.
NEAREST, FURTHEST = 0.1, 0.6
POINTS = 7, 14  # across that, and along a cell
# What bands explain beyond a side, over what they do within sides. Of panels at 150 µs that hang before pages, in white
# frames, or touch something bright it is 0.12 at most; of parts of panels 0.15 at least, and mostly above 0.3.
MOST_BEYOND = 0.135


def is_part(window: Window, quad: Quad, seen: SeenBands, cells: int) -> bool:
    """Whether the light in the window says so of a square with these bands."""
    return not cells_meet(window, quad.corners_px, seen, cells) or _goes_on(window, quad, seen, cells)


def _goes_on(window: Window, quad: Quad, seen: SeenBands, cells: int) -> bool:
    """Whether what is beside a square in the window shows its bands. Few rows, or steady cells, do not tell."""
    if (waves := window.waves_of(seen.spec, seen.shape)).least > STEADY:
        return False
    across, down = pitches(as_points(quad.corners_px), cells)
    # What is seen in fewer rows than half a period of the slower class is like many a step in light.
    half_period = 0.5 / (window.shrink * float(waves.cycles_a_row.min()))
    longer = max(across, down)
    reach = max(FURTHEST * longer, NEAREST * longer + half_period * window.shrink)
    places = _beside_sides(cells, *(np.round(reach / (FURTHEST * np.array([down, across])), 1).tolist()))
    at = window.within(as_points(in_square(quad.corners_px, places.reshape(-1, 2)))).reshape(places.shape[:-1])
    height, width = window.light.shape
    column, row = (np.round(part).astype(np.int64) for part in (at.real, at.imag))
    inside = (column >= 0) & (column < width) & (row >= 0) & (row < height)
    column, row = column.clip(0, width - 1), row.clip(0, height - 1)
    light = np.where(inside, window.light[row, column], np.nan)
    explained = _explained(light, window.shown(waves, np.array(seen.phases))[:, row])
    beyond, within = explained.sum(axis=-1)
    tells = np.ptp(row[0], axis=-1).mean(axis=-1) + 1 >= half_period
    if seen.hidden is not None:  # beyond what stands there it may be as bright as bands
        tells[seen.hidden.side] = False
        within = np.delete(within, seen.hidden.side)
    return bool((beyond * tells).max() > MOST_BEYOND * within.mean())


def _explained(light: Singles, shown: Singles) -> Floats:
    """(2, 4, n) of the squares of light (2, 4, n, P) about its mean, what either class (2, …) explains. 0 if unseen."""
    about_mean = light - light.mean(axis=-1, keepdims=True)
    waves = shown - shown.mean(axis=-1, keepdims=True)
    alike = np.maximum((about_mean * waves).sum(axis=-1), 0.0)
    explained: Floats = np.nan_to_num((np.square(alike) / np.maximum(np.square(waves).sum(axis=-1), 1e-9)).max(axis=0))
    return explained


@lru_cache(maxsize=64)
def _beside_sides(cells: int, above: float, beside: float) -> Floats:
    """(2, 4, n, P, 2) places of the unit square beyond each side and within, by cells; P points at each.

    `above`, `beside`: by how much further beyond sides 0 and 2, and beyond 1 and 3.
    """
    away = np.linspace(NEAREST, FURTHEST, POINTS[0]) / cells
    along = (np.arange(cells)[:, None] + np.linspace(NEAREST, 1 - NEAREST, POINTS[1])) / cells  # (n, points)
    s = np.repeat(along[:, None], POINTS[0], axis=1)

    def of_sides(from_first: Floats, from_second: Floats) -> Floats:
        """(4, n, P, 2) of each side, so far within sides 0 and 2, and 1 and 3 (points,)."""
        t, r = (np.broadcast_to(way[:, None], s.shape) for way in (from_first, from_second))
        places = [(s, t), (1 - r, s), (s, 1 - t), (r, s)]
        return np.stack([np.stack(place, axis=-1) for place in places]).reshape(4, cells, -1, 2)

    return np.stack([of_sides(-above * away, -beside * away), of_sides(away, away)])
