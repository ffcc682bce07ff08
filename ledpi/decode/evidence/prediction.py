"""Predicts a panel's next frames, and compares a frame with that: far cheaper than reading it.

The mean picture of earlier frames and the bands of the codeword predict each sample, up to a wrong gain and wrong
corners (`memory`). The residual gives the noise, and so log-likelihood ratios of "these bands" to "none", or to "those
before" if that is likelier. They are for the whole panel and for each cell, so that another panel in the same place
does not pass by most of its cells. A mean of few frames still has their bands: a cell that blinks otherwise differs
from that picture as much as from the prediction, and only "none" detects it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ledpi.core.records import Floats, Frame, Singles
from ledpi.decode.cells import CellSamples, Lattice
from ledpi.decode.evidence.comparison import Mean
from ledpi.decode.evidence.memory import PanelMemory
from ledpi.kernels.library import doubles, lib, pointer

# A frame matches if it is e^6 times likelier with the bands than without, and if the cells against them add up to less
# than that. By noise alone each cell is against them by 0.2 on average, whatever its evidence E (mean of
# max(0, N(−E, 2E))).
MATCH_NATS = 6.0
# And it must have more than this share of the log-likelihood ratio of earlier frames, as five in six frames have at
# 0.45 m, nine in ten at 2 m, all from 3 m on. If another panel is near the place, the residual is no noise, and the
# ratio is chance: of the frames of such panels that reached 6 nats, three in four had a twentieth at most.
LEAST_SHARE = 1 / 8
# Below this share the residual is mostly no noise, and all cells' ratios are too small by the same factor. Then the
# cells against may have no more than so much of the whole; another codeword, in a quarter of the cells, would have
# twice as much. (Of 6,500 frames of panels, with and without an occluded edge, seven more are read again by this.)
UNLIKE, MOST_AGAINST = 0.25, 0.125
MIN_VALID = 0.75  # of each cell's samples: of a cell that is mostly saturated nothing is sure
RIDGE = 1e-6  # of a basis vector's square: one may be all but gone with what is saturated


@dataclass(frozen=True, slots=True, kw_only=True)
class Prediction:
    """What a panel's next frames should look like."""

    lattice: Lattice
    origin_ns: int  # when the bands' phases count from
    picture: Singles  # (cells, points) without what is left of bands in it
    root: Singles  # (cells, points) of the weights
    basis: Singles  # (9, cells·points) orthonormal: what a wrong gain and wrong corners would add, weighted
    residual_bands: Singles  # (cells, points) of the bands' mean that is still in the picture
    hz: Floats  # (cells,)
    depth: Singles  # (cells, 1)
    phase: Floats  # (cells,)
    noise_inflation: float  # by how much less than their number its samples tell (`Correlation.inflation`)
    typical_nats: float  # that each frame has added so far

    @classmethod
    def from_memory(cls, memory: PanelMemory, bands: Floats, typical_nats: float) -> Prediction:
        """From the frames in `memory`, with `bands` (cells, P): cosine and sine of each wave.

        Each frame has added `typical_nats` for them.
        """
        mean, lattice = memory.mean(), memory.newest[0].lattice
        root, basis, residual_bands = _linearise(mean, lattice.along, bands)
        by_wave = bands.reshape(len(bands), -1, 2)
        wave = by_wave.any(axis=2).argmax(axis=1)  # that a cell shows
        cosine, sine = by_wave[np.arange(len(bands)), wave].T
        return cls(
            lattice=lattice,
            origin_ns=memory.origin_ns,
            picture=mean.picture,
            root=root,
            basis=basis,
            residual_bands=residual_bands,
            hz=np.array(memory.spec.waves_hz)[wave],
            depth=np.hypot(cosine, sine).astype(np.float32)[:, None],
            phase=np.arctan2(sine, cosine),
            noise_inflation=memory.noise.inflation,
            typical_nats=typical_nats,
        )

    def matches(self, samples: CellSamples, frame: Frame) -> bool:
        """Whether a frame clearly shows it. If the panel's size in the picture has changed, it does not."""
        valid = samples.valid
        if samples.lattice is not self.lattice or (valid is not None and valid.mean(axis=1).min() < MIN_VALID):
            return False
        of_all, of_those_against = self.log_likelihood_ratios(samples, frame)
        if not (of_all > max(MATCH_NATS, LEAST_SHARE * self.typical_nats) and of_those_against < MATCH_NATS):
            return False
        return of_all > UNLIKE * self.typical_nats or of_those_against < MOST_AGAINST * of_all

    def is_contradicted_by(self, samples: CellSamples, frame: Frame) -> bool:
        """Whether the cells against it outweigh all cells together."""
        if samples.lattice is not self.lattice:
            return False
        of_all, of_those_against = self.log_likelihood_ratios(samples, frame)
        return of_all < of_those_against

    def log_likelihood_ratios(self, samples: CellSamples, frame: Frame) -> tuple[float, float]:
        """Of a frame with these bands to none, or to those before: of all cells, and of the cells against.

        The latter with the other sign.
        """
        since_s = (frame.row0_readout_ns - self.origin_ns) * 1e-9
        cells, points = self.picture.shape
        room, of = np.empty(4 * self.picture.size, np.float32), np.empty(2)
        lib.ledpi_weigh_prediction(
            *(
                cells,
                points,
                pointer(self.picture),
                pointer(self.root),
                pointer(self.basis),
                pointer(self.residual_bands),
            ),
            *(pointer(self.depth), pointer(self.hz), pointer(self.phase), since_s, frame.row_time_us * 1e-6),
            *(
                pointer(samples.light),
                pointer(samples.valid),
                pointer(samples.rows),
                samples.independence / self.noise_inflation,
                RIDGE,
            ),
            *(pointer(room), pointer(of)),
        )
        of_all, of_those_against = of.tolist()
        return of_all, of_those_against


def _linearise(mean: Mean, along: Singles, bands: Floats) -> tuple[Singles, Singles, Singles]:
    """`root`, `basis` and `residual_bands` of an `Prediction`; `bands` (cells, P), `along` is the lattice's."""
    (cells, points), samples = mean.picture.shape, mean.picture.size
    root, residual_bands = np.empty_like(mean.picture), np.empty_like(mean.picture)
    basis, room = np.empty((lib.LEDPI_NUISANCES, samples), np.float32), np.empty(3 * (samples + len(along)), np.float32)
    lib.ledpi_predict(
        *(math.isqrt(cells), math.isqrt(points), len(mean.waves)),
        *(pointer(np.ascontiguousarray(array)) for array in (mean.picture, mean.count, mean.waves, along)),
        *(pointer(doubles(bands)), pointer(root), pointer(basis), pointer(residual_bands), pointer(room)),
    )
    return root, basis, residual_bands


def nuisance_basis(picture: Singles, lattice: Lattice) -> Singles:
    """(9, cells·points) orthonormal: what a wrong gain and wrong corners add, weighted by the root of the light.

    To a `picture` (cells, points) above 0.
    """
    no_waves = np.empty((0, *picture.shape), np.float32)
    mean = Mean(picture=picture, count=np.ones_like(picture), waves=no_waves)
    return _linearise(mean, lattice.along, np.empty((len(picture), 0)))[1]
