"""Evidence of the bands in a panel's cells, from their light in one frame.

The light of cell c at lattice point s and picture row y is

    I[c, s] = a[c, s] · (1 + m_k(c) · cos(2π f_k t − φ_k(c))) + noise,    t: when row y was exposed

with the cell's static picture a and the class k(c) of the cell, black or white. The cells of a class share one
oscillator: one frequency, one phase (in antiphase both classes do, as `classes` says). What else is not known of a
frame, `light` leaves free and eliminates, with the corners, walls and gains of a fit; `memory` adds up several frames,
where a is learnt from the frames before.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ledpi.core.records import Floats, Rejected

UNFIT = Rejected(stage="identify", reason="unfit")


class Evidence(NamedTuple):
    """Evidence of the samples on every cell and wave: quadratic in the bands, so codewords and frames only add up.

    The log-likelihood of bands x, cosine and sine of each wave in each cell, is `score·x − xᵀ·information·x/2`. There
    are P of them to a cell: 4 where the classes blink at two frequencies, 2 in antiphase.
    """

    score: Floats  # (cells, P)
    information: Floats  # (cells, P, cells, P)
    prior: Floats  # (P,) expected variance of x

    @property
    def own_information(self) -> Floats:
        """(cells, P, P) the blocks of the information that concern one cell each."""
        return np.asarray(np.einsum("cicj->cij", self.information))

    def divided(self, inflation: float) -> Evidence:
        """The evidence, if noise has so many times the variance."""
        return self._replace(score=self.score / inflation, information=self.information / inflation)

    def unexplained(self, bands: Floats) -> Floats:
        """(cells, P) the score that these bands (cells, P) leave: score − information·bands."""
        residual: Floats = self.score - (self.information.reshape(bands.size, -1) @ bands.reshape(-1)).reshape(
            bands.shape
        )
        return residual
