"""Light over the cells of a panel's face: diffuser, LEDs that shine through it, and the walls between.

Walls may stand out before the diffuser, by `PanelAppearance.depth`. What is seen through a cell's opening then depends
on where the camera is: the line of sight through the point p of the opening ends on the diffuser, at p + depth · (p −
eye) / eye_z, or before that on a wall's face. Lengths are in pitches of a cell.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ledpi.core.records import Floats
from ledpi.simulate.scene import PanelAppearance


class _Axis(NamedTuple):
    """The lines of sight through the texels of one axis, (n·texels,) each; places in cells of the lattice of walls."""

    open_share: Floats  # of each texel: 0 on a wall's front
    seen_share: Floats  # of what is seen through it: 1 on the diffuser, 0 on a wall's face
    offset: Floats  # of where it ends, from the middle of its cell


def cell_lights(cells: int, texels: int, appearance: PanelAppearance, eye: Floats | None = None) -> Floats:
    """(n·texels, n·texels) light of cells of peak 1, row 0 at the top.

    `eye` (3,): the camera in the panel's frame (x right, y up, z out of its front); None: far ahead. A wall's face
    is lit by the diffuser's edge that it stands on, and returns `wall_glow` of that.
    """
    x, y, z = (0.0, 0.0, np.inf) if eye is None else eye.tolist()
    across = _axis(cells, texels, appearance, cells / 2.0 + x, z)
    down = _axis(cells, texels, appearance, cells / 2.0 - y, z)
    light = _diffused(across.offset, down.offset, appearance)
    seen = np.outer(down.seen_share, across.seen_share)
    light *= appearance.wall_glow + (1.0 - appearance.wall_glow) * seen
    return np.asarray(light * np.outer(down.open_share, across.open_share))


def _axis(cells: int, texels: int, appearance: PanelAppearance, eye_at: float, eye_z: float) -> _Axis:
    front = (np.arange(cells * texels) + 0.5) / texels
    behind = front + appearance.depth / eye_z * (front - eye_at)
    if appearance.equal_cells:  # of a lattice with half a wall more at either end
        front, behind = (appearance.gap / 2.0 + place * (cells - appearance.gap) / cells for place in (front, behind))
    cell = np.floor(front)
    rim = appearance.gap / 2.0 if appearance.equal_cells else 0.0  # the outermost walls stand around the panel's side
    low = np.where(cell == 0, rim, cell + appearance.gap / 2.0)
    high = np.where(cell == cells - 1, cells - rim, cell + 1.0 - appearance.gap / 2.0)
    open_share, seen_share = (
        np.clip(np.minimum(at - low, high - at) * texels + 0.5, 0.0, 1.0) for at in (front, behind)
    )
    return _Axis(open_share, seen_share, np.clip(behind, low, high) - cell - 0.5)


def _diffused(across: Floats, down: Floats, appearance: PanelAppearance) -> Floats:
    """(rows, columns) light of the diffuser at these offsets from the middles of cells."""
    diffuse = 1.0 - appearance.falloff * (down[:, None] ** 2 + across[None, :] ** 2) / 0.5
    led = (np.arange(appearance.leds) + 0.5) / appearance.leds - 0.5  # along either axis
    spots = [
        np.exp(-((at[:, None] - led) ** 2) / (2.0 * appearance.hot_spot_sigma**2)).sum(axis=1) for at in (down, across)
    ]
    brightest = np.exp(-((led[:, None] - led) ** 2) / (2.0 * appearance.hot_spot_sigma**2)).sum(axis=1).max()
    spot = np.outer(*spots) / brightest**2
    return np.asarray((1.0 - appearance.hot_spot) * diffuse + appearance.hot_spot * spot)
