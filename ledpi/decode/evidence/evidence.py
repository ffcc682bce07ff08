"""Evidence of the bands in a panel's cells, from their light in one frame.

The light of cell c at lattice point s and picture row y is

    I[c, s] = a[c, s] · (1 + m_k(c) · cos(2π f_k t − φ_k(c))) + noise,    t: when row y was exposed

with the cell's static picture a and the class k(c) of the cell, black or white. The cells of a class share one
oscillator: one frequency, one phase (in antiphase both classes do, as `classes` says). Of a single frame a is not
known; but all cells are built alike and seen through one lens, so but for a gain g they all send the same to point s of
their own, and across a border near s to a neighbour:

    a[c, s] = g_c · (p_s + Σ_m r_{m,s}) + Σ_n g_n · q_{n,s},    n: neighbours of c beyond a border near s

and m the sides near s where there is no neighbour: at a panel's rim stands no wall, or another one than between cells.
For known gains that is linear in p, q and r, at each point by itself. What it can explain is taken off, and with it
what a wrong gain and wrong corners would add (the picture's slope times the shift that each corner's error makes
there). What is left is correlated with a cosine and a sine of each wave, in each cell.

`single_frame` does so, with deep bands. `light` has the corners, walls and gains of a fit instead, and all that it does
not know free; `memory` adds up several frames, where a is learnt from the frames before.
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
    residual: float  # log-likelihood of what no bands explain; noise if the model is right

    @property
    def own_information(self) -> Floats:
        """(cells, P, P) the blocks of the information that concern one cell each."""
        return np.asarray(np.einsum("cicj->cij", self.information))

    def unexplained(self, bands: Floats) -> Floats:
        """(cells, P) the score that these bands (cells, P) leave: score − information·bands."""
        residual: Floats = self.score - (self.information.reshape(bands.size, -1) @ bands.reshape(-1)).reshape(
            bands.shape
        )
        return residual
