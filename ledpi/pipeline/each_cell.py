"""Evidence of each cell, for people to look at."""

from __future__ import annotations

import math

import numpy as np

from ledpi.core.codewords import Bits
from ledpi.core.records import Floats
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.identify.codewords import class_flip_gain
from ledpi.pipeline.trace import SquareTrace

FREE_PARAMETERS = 4  # of the bands of two frequencies: cosine and sine of each


def class_given_others(evidence: Evidence, cell_bands: Floats, codeword: Bits) -> Floats:
    """(cells,) by how much likelier all the light of a panel that was read is with this cell white than with it black.

    `cell_bands` (cells, P) are its bands, `codeword` (cells,) the cells that are white in it.
    """
    gain = class_flip_gain(evidence, cell_bands)
    return np.asarray(np.where(codeword, -gain, gain))


def class_alone(evidence: Evidence) -> Floats:
    """(cells,) log-likelihood ratio of white to black in each cell by itself, depth and phase integrated out.

    Of two frequencies.
    """
    nats = []
    for two in (slice(0, 2), slice(2, 4)):
        prior = np.diag(evidence.prior[two])
        own = evidence.own_information[:, two, two]
        b = evidence.score[:, two]
        fitted = np.linalg.solve(own + np.linalg.inv(prior), b[..., None])[..., 0]
        nats.append(0.5 * ((b * fitted).sum(axis=1) - np.linalg.slogdet(np.eye(2) + prior @ own)[1]))
    return np.asarray(nats[1] - nats[0])


def classes_unread(square: SquareTrace) -> Floats | None:
    """(n, n) `class_alone` of a square that was not read; None where no cell says anything by itself."""
    evidence = square.evidence
    if not isinstance(evidence, Evidence) or len(evidence.prior) != FREE_PARAMETERS:
        return None
    nats = class_alone(evidence)
    side = math.isqrt(len(nats))
    return nats.reshape(side, side)
