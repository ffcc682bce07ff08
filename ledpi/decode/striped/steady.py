"""What cells that are lit all the time explain of a square's light: if it is more than blinking ones, it is no panel.

At short exposures many a thing in a bright room is dark and bright within a few rows. A lattice of blinking cells
explains most of it, as any pattern of 16 patches would; but where it does not blink, steady patches explain more.
"""

from __future__ import annotations

import numpy as np

from ledpi.decode.corners.sides import Points
from ledpi.decode.striped.band_light import MOST, Bands
from ledpi.decode.striped.lattice import fine_lattice, lattice_places
from ledpi.decode.striped.light_window import Window

ROUNDS = 2  # of gains and profile, each without the other


def is_steady(window: Window, corners: Points, cells: int, bands: Bands) -> bool:
    """Whether cells of one profile, each with a gain of its own, explain the square better than these bands do.

    `corners` (4,) in the window. Of panels, from rough corners too, bands leave 0.7 of what steady cells leave at most.
    """
    lattice = fine_lattice(cells)
    x, y, _ = lattice_places(corners[None], lattice)
    height, width = window.light.shape
    row, column = (y[0] + 0.5).astype(np.int64).clip(0, height - 1), (x[0] + 0.5).astype(np.int64).clip(0, width - 1)
    light = np.clip((window.light[row, column] - bands.dark) / (bands.bright - bands.dark), 0.0, MOST)
    share = lattice.of_cells
    profile = np.ones(light.shape[1])
    for _ in range(ROUNDS):
        gain = (share * light * profile).sum(axis=1) / np.maximum((share * profile**2).sum(axis=1), 1e-9)
        profile = (share * light * gain[:, None]).sum(axis=0) / np.maximum((share.T * gain**2).sum(axis=1), 1e-9)
    left = float((share * np.square(light - gain[:, None] * profile)).sum())
    return left < (1.0 - bands.explained) * float((share * np.square(light)).sum())
