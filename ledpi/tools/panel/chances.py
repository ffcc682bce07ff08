"""Chances that a panel is read: the decoder's own decision on evidence drawn from its own error model.

Of a panel that shows the codeword w with bands x, the score of the evidence is normal with mean I·X and covariance I,
with X = the bands of each cell's class, and I the information of `information.evidence_of`. The draws go through
`decode.decision.decide` as a camera's do. What the model leaves out: whether the square is found at all, corners that
are off by more than their first order, harmonics of the wave, what the optics mix between cells.
"""

from __future__ import annotations

import numpy as np

from ledpi.core.records import Floats, Rejected
from ledpi.decode.evidence.classes import wave_shares
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.identify import decision
from ledpi.decode.identify.codebook import Codebook


def chance_of_reading(
    evidence: Evidence,
    codebook: Codebook,
    depths: tuple[float, float],
    false_id_rate: float,
    *,
    draws: int,
) -> float:
    """The share of draws (ID, phases, noise) that are read as what they are; `depths` as in `separation_nats`."""
    rng = np.random.default_rng(0)
    size = evidence.score.size
    information = evidence.information.reshape(size, size)
    values, vectors = np.linalg.eigh(information)
    root = vectors * np.sqrt(np.maximum(values, 0.0))
    right = 0
    for _ in range(draws):
        shown = int(rng.integers(len(codebook.white)))
        bands = _bands(codebook.white[shown].astype(np.float64), depths, rng, len(evidence.prior) // 2)
        score = information @ bands.ravel() + root @ rng.standard_normal(size)
        drawn = evidence._replace(score=score.reshape(evidence.score.shape))
        read = decision.decide(drawn, codebook, false_id_rate)
        if not isinstance(read, Rejected):
            right += read.id == codebook.ids[shown] and read.quarter_turns == codebook.quarter_turns[shown]
    return right / draws


def _bands(white: Floats, depths: tuple[float, float], rng: np.random.Generator, waves: int) -> Floats:
    """(cells, 2·waves) cosine and sine of what each cell shows, at random phases."""
    shares = wave_shares(white, waves)
    out = np.zeros((len(white), 2 * waves))
    for k in range(waves):
        phase = 2 * np.pi * rng.random()
        out[:, 2 * k] = depths[k] * np.cos(phase) * shares[:, k]
        out[:, 2 * k + 1] = depths[k] * np.sin(phase) * shares[:, k]
    return out
