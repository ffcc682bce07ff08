"""The light that a panel's waves leave in a cell, by its class.

Evidence is of *waves*, a cosine and a sine of each. Where the classes blink at two frequencies, black shows the first
wave and white the second. Of an antiphase panel there is one wave: black shows it, and white its negative, which is
the same half a cycle later.
"""

from __future__ import annotations

from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from ledpi.core.records import Floats

Real = TypeVar("Real", bound=np.floating[Any])


def wave_shares(white: NDArray[Real], waves: int) -> NDArray[Real]:
    """(…, waves): how much of each wave cells show that are of class white (…) by 1, or black by 0."""
    one = white.dtype.type(1)
    return np.stack([one - white, white], axis=-1) if waves == 2 else (one - white - white)[..., None]


def band_shares(white: Floats, parameters: int) -> Floats:
    """(…, parameters): the same for cosine and sine of each wave."""
    return wave_shares(white, parameters // 2).repeat(2, axis=-1)


def flip_classes(cell_bands: Floats) -> Floats:
    """(cells, parameters): what each cell would show if it were of the other class; `cell_bands` is what it shows.

    Of two waves one that no cell shows is not known, and taken for none.
    """
    if cell_bands.shape[1] == 2:
        return -cell_bands
    shows = cell_bands.any(axis=0)
    bands = np.zeros(cell_bands.shape[1])
    first = (cell_bands[:, shows] != 0).argmax(axis=0)
    bands[shows] = cell_bands[first, np.flatnonzero(shows)]
    return np.where(cell_bands != 0, 0.0, bands)
