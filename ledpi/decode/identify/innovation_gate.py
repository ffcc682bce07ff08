"""Whether a frame denies, or confirms, what the frames of a track before it have cell_bands."""

from __future__ import annotations

import numpy as np

from ledpi.core.records import Floats
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.identify.codewords import class_flip_gain

# A frame that is e^CONTRADICTION_NATS times likelier without a panel's bands than with them does not show the panel.
# One that does show it looks so in less than 1 of 1,000, however much or little a frame can tell: with E =
# bands·information·bands/2, the log-likelihood ratio is normal with mean E and variance 2E, so (E +
# CONTRADICTION_NATS)/√(2E) is at least √(2·CONTRADICTION_NATS) = 3.2.
CONTRADICTION_NATS = 5.0
# Where cells would rather be of the other class, by this much together, another panel has taken the place. Cells that
# are what they were gain by noise alone: 0.2 each on average, whatever their evidence E (mean of max(0, N(−E, 2E))).
# The rest is for bands that are not known exactly yet.
OTHER_CLASS_NATS = 16.0
# What confirms a panel says so many times as much for it as for cells of the other class. Where another codeword is
# cell_bands that differs in a quarter of the cells, as DICT_4X4_50's do at least, both are alike.
CONFIRMATION_RATIO = 4.0


def expected_log_likelihood_ratio(evidence: Evidence, cell_bands: Floats) -> float:
    """By how many nats, on average, evidence is for bands `cell_bands` (cells, P) over none where these are
    cell_bands.
    """
    return 0.5 * float((cell_bands * (evidence.score - evidence.unexplained(cell_bands))).sum())


def contradicts(added: Evidence | None, cell_bands: Floats) -> bool:
    """Whether a frame has added evidence against bands `cell_bands` (cells, P): for none, or for those of other
    cells.
    """
    if added is None:
        return False
    likelihood, of_others = _log_likelihood_ratios(added, cell_bands)
    return likelihood < -CONTRADICTION_NATS or of_others > OTHER_CLASS_NATS


def confirms(alone: Evidence | None, cell_bands: Floats) -> bool:
    """Whether what a frame says by itself is surely for bands `cell_bands` (cells, P), and for none of other cells."""
    if alone is None:
        return False
    likelihood, of_others = _log_likelihood_ratios(alone, cell_bands)
    return likelihood > CONTRADICTION_NATS + CONFIRMATION_RATIO * of_others


def _log_likelihood_ratios(evidence: Evidence, cell_bands: Floats) -> tuple[float, float]:
    """Log-likelihood ratio of bands `cell_bands` (cells, P) to none; and how much cells gain by being of the other
    class.
    """
    likelihood = 0.5 * float((cell_bands * (evidence.score + evidence.unexplained(cell_bands))).sum())
    return likelihood, float(np.maximum(class_flip_gain(evidence, cell_bands), 0.0).sum())
