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

`single_frame` does so with one picture; `memory` over several frames, where a is learnt from the frames before.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ledpi.core.records import Floats, Frame, PanelSpec, Rejected
from ledpi.decode.evidence.cells import CellSamples
from ledpi.decode.evidence.noise import WHITE, Correlation, lags_of, white_noise_expected
from ledpi.decode.evidence.waves import band_prior

UNFIT = Rejected(stage="identify", reason="unfit")


class Weighed(NamedTuple):
    """Evidence of one fit, and what that has left of the light."""

    score: Floats  # (cells, P)
    information: Floats  # (cells, P, cells, P)
    free: float  # samples, less what is fitted
    near: float  # sum of the squared differences of samples of a cell a lag apart
    far: float  # and of those two lags apart


class Evidence(NamedTuple):
    """Evidence of the samples on every cell and wave: quadratic in the bands, so codewords and frames only add up.

    The log-likelihood of bands x, cosine and sine of each wave in each cell, is `score·x − xᵀ·information·x/2`. There
    are P of them to a cell: 4 where the classes blink at two frequencies, 2 in antiphase.
    """

    score: Floats  # (cells, P)
    information: Floats  # (cells, P, cells, P)
    prior: Floats  # (P,) expected variance of x
    residual: float  # log-likelihood of what no bands explain; noise if the model is right
    noise: Correlation = WHITE  # of the noise that it was weighed by

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

    def discount(self, noise: Correlation) -> Evidence:
        """The evidence with the variance inflated for correlated noise: divided by `inflation`."""
        inflation = noise.inflation
        if inflation == 1.0:
            return self
        return self._replace(
            score=self.score / inflation,
            information=self.information / inflation,
            residual=self.residual / inflation,
            noise=WHITE,
        )


def evidence_of(
    found: Weighed | None, samples: CellSamples, frame: Frame, spec: PanelSpec, fitted: int
) -> Evidence | Rejected:
    """Evidence for which `fitted` functions were fitted to each cell."""
    if found is None:
        return UNFIT
    cells, parameters = len(samples.light), 2 * len(spec.waves_hz)
    return Evidence(
        score=found.score.reshape(cells, parameters),
        information=found.information.reshape(cells, parameters, cells, parameters),
        prior=band_prior(frame, spec),
        residual=0.5 * samples.independence * found.free,
        noise=white_noise_expected(samples, lags_of(samples), fitted).correlation(found.near, found.far, found.free),
    )
