"""The normal equations of a fit in numpy: what the compiled loops (kernels/normal.c, columns.c) are held to."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ledpi.decode.cells import CellSamples
from ledpi.decode.evidence.noise import lags_of
from ledpi.kernels.evidence import Weighed
from ledpi.records import Floats, Singles


@dataclass(frozen=True, slots=True, kw_only=True)
class Normal:
    """Normal equations of nuisances and bands, for a residual that is whitened up to a factor."""

    of_nuisances: Floats  # (n, n)
    of_both: Floats  # (n, cells·P)
    of_bands: Floats  # (cells·P, cells·P)
    nuisances: Floats  # (n,) residual against the nuisances
    bands: Floats  # (cells·P,) against the bands
    squares: float  # of the residual
    freedom: int  # samples, less what nuisances and bands take


def weighed(normal: Normal, independence: float) -> tuple[Weighed, Floats, Floats] | None:
    """Takes the nuisances off, and weighs the rest by the noise that is left when every cell has bands of its own.

    Also the nuisances (n,) and bands (cells·P,) that fit best, for `near` and `far`, which it leaves out.
    """
    if normal.freedom <= 0:
        return None
    right = np.column_stack([normal.of_both, normal.nuisances])
    taken = np.linalg.solve(_ridged(normal.of_nuisances), right)
    score = normal.bands - normal.of_both.T @ taken[:, -1]
    information = normal.of_bands - normal.of_both.T @ taken[:, :-1]
    squares = normal.squares - float(normal.nuisances @ taken[:, -1])
    bands = np.asarray(np.linalg.solve(_ridged(information), score), np.float64)
    variance = (squares - float(score @ bands)) / normal.freedom
    if not variance > 0:
        return None
    scale = independence / variance
    found = Weighed(score * scale, information * scale, normal.freedom, math.nan, math.nan)
    return found, np.asarray(taken[:, -1] - taken[:, :-1] @ bands, np.float64), bands


def with_differences(found: Weighed, left: Singles, samples: CellSamples) -> Weighed:
    """With sums of what is `left` (cells, points) of the light."""
    k, (aside, below, rim) = samples.lattice.k, lags_of(samples)
    of_cells = np.where(True if samples.valid is None else samples.valid, left, np.nan).reshape(-1, k, k)
    of_cells, k = of_cells[:, rim : k - rim, rim : k - rim], k - 2 * rim
    sums = []
    for times in (1, 2):
        across, down = times * aside, times * below
        apart = [of_cells[:, :, across:] - of_cells[:, :, : k - across], of_cells[:, down:] - of_cells[:, : k - down]]
        sums.append(sum(float(np.nansum(np.square(each))) for each in apart))
    return found._replace(near=sums[0], far=sums[1])


def _ridged(matrix: Floats) -> Floats:
    """What may be singular but for rounding, made solvable."""
    ridged = matrix.copy()
    diagonal = np.einsum("ii->i", ridged)  # a view
    diagonal += 1e-5 * diagonal.mean() + 1e-12
    return ridged
