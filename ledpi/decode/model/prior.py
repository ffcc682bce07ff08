"""The knowledge of a panel's picture before it is seen: means and deviations of the fit's unknowns.

Light is in units of the panel's own, lengths along the panel in cells.
"""

from __future__ import annotations

import math
from functools import cache, lru_cache

import numpy as np

from ledpi.core.library import lib
from ledpi.core.records import Floats, Mask, read_only

# The layout of the unknowns (unknowns.h). The first WAYS are the homography's, COMMON the panel's; a cell has OWN.
WAYS, OWN, COMMON = lib.WAYS, lib.OWN, lib.COMMON
BLUR, GAP, RIM, SHAPE, PHASE, BESIDE = lib.BLUR, lib.GAP, lib.RIM, lib.SHAPE, lib.PHASE, lib.BESIDE
DARK, ASIDE, DEPTH, GLOW, SMEAR = lib.DARK, lib.ASIDE, lib.DEPTH, lib.GLOW, lib.SMEAR

BLUR_PX, BLUR_SPREAD = 0.8, 0.4  # of lens, pixel and interpolation; its logarithm's deviation
GAP_MEAN, GAP_SIGMA = 0.08, 0.08  # between cells: walls and rims of LEDs, 0 to a fifth of a cell
RIM_SIGMA = 0.03  # within the lattice's end, on each side: half a wall, or how exactly panels are cut
SHAPE_SIGMA = 0.5  # a hot spot of half the light has a first harmonic of half the mean
ASIDE_SIGMA = 0.05  # LEDs 3 % of a cell off its middle, of a spot of a quarter of the light
DEPTH_SIGMA = 0.05  # that walls stand before the diffuser, in cells
GLOW_MEAN, GLOW_SIGMA = 0.4, 0.2  # of a wall's face, over the diffuser beside it: plastic between black and white
SMEAR_SIGMA_PER_MS = 0.03  # logarithm of the blur along rows over the geometric mean: turning adds so much per exposure
BESIDE_SIGMA = 1.0  # what is beside a panel may be brighter than it is
DARK_SIGMA = 0.3  # the room's light on the panel
# Cycles: before, a grid of 24 phases a cycle (panel_phases.c) finds them to half a step. Faint bands tell no
# more: cells may show any mix of both waves, which would turn the phases at each step.
PHASE_SIGMA = 1.0 / 24.0 / math.sqrt(12.0)
NEVER = 1e-4  # where nothing of the kind is to be
GAIN_SIGMA = 0.5  # of cells, which may be dead
MIX_SIGMA = 0.7  # of either class's wave in a cell: 0 or 1

# Harmonics across and down of each of the profile's shapes; as panel.h has them.
HARMONICS = ((1, 0), (0, 1), (2, 0), (0, 2), (3, 0), (0, 3), (4, 0), (0, 4), (1, 1), (2, 1), (1, 2), (2, 2), (3, 3))


@cache
def built_in(cells: int) -> Mask:
    """(unknowns,) all but a panel's place, the picture's blur, phases, and the light beside and on it."""
    out = np.ones(COMMON + OWN * cells * cells, np.bool_)
    out[[*range(BLUR + 1), *range(PHASE, ASIDE), SMEAR]] = False
    return out


@lru_cache(maxsize=256)
def prior(
    cells: int,
    pitch_px: tuple[float, float],
    exposure_us: float,
    *,
    even: bool,
    faint: bool,
    compared: bool = False,
) -> Floats:
    """(2, unknowns): means, and one over the variances (0 where nothing is known), of `cells` × `cells`.

    `even`: cells are even about their middles, so that nothing but the corners moves the lattice. `faint`: so are the
    bands. `compared`: what is built into a panel does not differ. The mean of a phase is what the grid finds.
    """
    mean, sigma = np.zeros((2, COMMON + OWN * cells * cells))
    sigma[:] = math.inf
    mean[BLUR], sigma[BLUR] = math.log(BLUR_PX), BLUR_SPREAD
    mean[GAP], sigma[GAP] = GAP_MEAN, GAP_SIGMA
    sigma[RIM:SHAPE] = RIM_SIGMA
    number, cycles_px = np.hypot(*np.array(HARMONICS).T), np.hypot(*(np.array(HARMONICS) / pitch_px).T)
    blurred = np.exp(-2.0 * (np.pi * cycles_px * BLUR_PX) ** 2)
    sigma[SHAPE:PHASE] = np.maximum(SHAPE_SIGMA * blurred / number, NEVER)
    if faint:
        sigma[PHASE:BESIDE] = PHASE_SIGMA
    sigma[BESIDE:DARK], sigma[DARK], sigma[ASIDE:DEPTH] = BESIDE_SIGMA, DARK_SIGMA, NEVER if even else ASIDE_SIGMA
    sigma[DEPTH], mean[GLOW], sigma[GLOW] = NEVER if even else DEPTH_SIGMA, GLOW_MEAN, GLOW_SIGMA
    sigma[SMEAR] = NEVER if even else max(SMEAR_SIGMA_PER_MS * 1e-3 * exposure_us, NEVER)
    mean[COMMON::OWN], sigma[COMMON::OWN] = 1.0, GAIN_SIGMA
    sigma[COMMON + 1 :: OWN] = sigma[COMMON + 2 :: OWN] = MIX_SIGMA
    if compared:
        sigma[built_in(cells)] = NEVER
    return read_only(np.stack([mean, sigma**-2.0]))


def turned_unknown(unknown: Floats, quarter_turns: int) -> Floats:
    """The unknowns as they are where the corners' order begins so many corners later."""
    out = unknown.copy()
    n = math.isqrt((len(unknown) - COMMON) // OWN)
    swapped = [HARMONICS.index((y, x)) for x, y in HARMONICS]
    for _ in range(quarter_turns % 4):
        before = out.copy()
        for sides in (RIM, BESIDE):  # left, right, above, below
            out[sides : sides + 4] = before[[sides + 2, sides + 3, sides + 1, sides]]
        out[SHAPE:PHASE] = before[SHAPE:PHASE][swapped]
        out[ASIDE], out[ASIDE + 1] = before[ASIDE + 1], -before[ASIDE]
        out[COMMON:] = np.rot90(before[COMMON:].reshape(n, n, OWN)).reshape(-1)
    return out
