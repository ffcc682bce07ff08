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

from ledpi.core.records import Floats, Mask, Rejected

UNFIT = Rejected(stage="identify", reason="unfit")

# Of the cells' mean light: less is no cell's own. LEDs that differ by 15 % (a deviation) keep to more than twice that;
# across a gap comes 0.05 to 0.15 where cells are 7 px, and 0.3 where they are 3 px.
UNLIT = 1.0 / 3.0
RARE_Z = 3.1  # deviations: noise goes further to one side in one case of a thousand


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


def erase_cells(evidence: Evidence, unlit: Mask) -> Evidence:
    """The evidence without what it holds of some cells (cells,): dead ones, and those that are wholly occluded.

    The light in such a cell comes from its neighbours, and has their bands. So it says nothing of the cell's class: in
    terms of codes it is an erasure, not an error.
    """
    if True not in unlit.tolist():
        return evidence
    size, cell = evidence.score.size, np.repeat(unlit, evidence.score.shape[1])
    information, score = evidence.information.reshape(size, size), evidence.score.reshape(size)
    ridge = 1e-9 * np.trace(information) / size + 1e-12
    own = information[np.ix_(cell, cell)] + ridge * np.eye(int(cell.sum()))
    taken = np.linalg.solve(own, np.column_stack([information[cell], score[cell]]))
    left = information - information[:, cell] @ taken[:, :-1]
    left[cell], left[:, cell] = 0.0, 0.0
    rest = np.where(cell, 0.0, score - information[:, cell] @ taken[:, -1])
    return evidence._replace(
        score=rest.reshape(evidence.score.shape), information=left.reshape(evidence.information.shape)
    )
