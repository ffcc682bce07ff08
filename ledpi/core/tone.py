"""From picture values to linear light."""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray

from ledpi.core.records import Transfer

SATURATED = 255  # the only value of an 8-bit picture that may stand for any amount of light


@cache
def linear_light(transfer: Transfer, *, mark_saturated: bool = True) -> NDArray[np.float32]:
    """Look-up table (256,) from picture value to linear light, 0..1; NaN where the value is saturated.

    `srgb` is IEC 61966-2-1's inverse. NaN passes through interpolation, so that whatever touched a saturated pixel
    is known to be worthless, at no further cost. Where only edges are sought, saturated light is 1.
    """
    value = np.arange(256) / 255.0
    if transfer == "srgb":
        value = np.where(value <= 0.04045, value / 12.92, ((value + 0.055) / 1.055) ** 2.4)
    table = value.astype(np.float32)
    if mark_saturated:
        table[SATURATED:] = np.nan
    table.flags.writeable = False
    return table
