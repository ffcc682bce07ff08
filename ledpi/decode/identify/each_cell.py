"""What the evidence says of each cell, for people to look at."""

from __future__ import annotations

import numpy as np

from ledpi.core.records import Floats
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.identify.words import gain_by_other_class
from ledpi.markers.words import Bits


def given_others_for_white(evidence: Evidence, shown: Floats, word: Bits) -> Floats:
    """(cells,) by how much likelier all the light of a panel that was read is with this cell white than with it black.

    `shown` (cells, P) are its bands, `word` (cells,) which cells it shows as white.
    """
    gain = gain_by_other_class(evidence, shown)
    return np.asarray(np.where(word, -gain, gain))


def alone_for_white(evidence: Evidence) -> Floats:
    """(cells,) log-likelihood ratio of white to black in each cell by itself, depth and phase integrated out.

    Of two frequencies.
    """
    nats = []
    for two in (slice(0, 2), slice(2, 4)):
        prior = np.diag(evidence.prior[two])
        own = evidence.of_own_bands[:, two, two]
        b = evidence.score[:, two]
        fitted = np.linalg.solve(own + np.linalg.inv(prior), b[..., None])[..., 0]
        nats.append(0.5 * ((b * fitted).sum(axis=1) - np.linalg.slogdet(np.eye(2) + prior @ own)[1]))
    return np.asarray(nats[1] - nats[0])
