"""The physical plausibility of a codeword: its bands are one panel's, and its cells share them."""

from __future__ import annotations

import math

import numpy as np

from ledpi.decode.evidence.classes import flip_classes
from ledpi.decode.evidence.evidence import RARE_Z, Evidence
from ledpi.decode.identify.codewords import Fit

# No square wave leaves deeper bands than `shutter.harmonic_amplitude` of duty 0.5 by more than π/2 (a duty near 0), and
# the classes of one panel are thinned alike by whatever light does not blink; where that is three times the panel's
# own, the panel is no longer seen to be lit. Texture knows of none of this.
MIN_DEPTH, MAX_DEPTH = 0.25, math.pi / 2
MAX_DEPTH_RATIO = 2.5


def is_plausible(amplitude: list[float], deviation: list[float], evidence: Evidence) -> bool:
    """Tells whether square waves, seen through this exposure, can look like these waves of one panel."""
    expected = [math.sqrt(2.0 * variance) for variance in evidence.prior[::2].tolist()]
    most = [(a + RARE_Z * d) / e for a, d, e in zip(amplitude, deviation, expected, strict=True)]
    least = [(a - RARE_Z * d) / e for a, d, e in zip(amplitude, deviation, expected, strict=True)]
    if max(least) > MAX_DEPTH or min(most) < MIN_DEPTH:
        return False
    return least[0] <= MAX_DEPTH_RATIO * most[-1] and least[-1] <= MAX_DEPTH_RATIO * most[0]


def has_other_class(evidence: Evidence, fit: Fit, needed: float) -> bool:
    """Tells whether a cell surely shows the class that the codeword does not say, over its own and over no bands.

    What a dictionary corrects are cells in doubt: hidden, dark, blurred. None of these blinks at the other frequency; a
    part of another panel does.
    """
    other, own = flip_classes(fit.cell_bands), evidence.own_information
    of_cell = evidence.unexplained(fit.cell_bands) + np.einsum("cij,cj->ci", own, fit.cell_bands)
    over_none = (other * (of_cell - 0.5 * np.einsum("cij,cj->ci", own, other))).sum(axis=1)
    return bool((np.minimum(over_none, fit.gain) > needed).any())


def may_end_in_the_dark(fit: Fit) -> bool:
    """Tells whether half of a row of cells at the rim, or more, is dark.

    A lattice that lies a row or a column off takes what is beside the panel for cells. These are dark but for one that
    reaches into the panel; and the others may be the better part of another codeword.
    """
    if fit.erased is None:
        return False
    side = math.isqrt(len(fit.gain))
    erased = fit.erased.reshape(side, side)
    return any(2 * np.count_nonzero(end) >= side for end in (erased[0], erased[-1], erased[:, 0], erased[:, -1]))
