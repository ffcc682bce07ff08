"""The innovation gate: whether a frame contradicts, or confirms, the bands that its track has shown so far."""

from __future__ import annotations

import numpy as np

from ledpi.core.records import Floats
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.identify.codewords import class_flip_gain
from ledpi.decode.identify.plausibility import MODEL_VARIANCE

# A frame that is e^5 times likelier without a panel's bands than with them does not show the panel. A frame that does
# show it is rejected less than once in 1,000 times, however much information it has: with E =
# bands·information·bands/2, the log-likelihood ratio is normal with mean E and variance 2E, so (E + 5)/√(2E) is at
# least √(2·5) = 3.2.
CONTRADICTION_NATS = 5.0
# If cells are more likely to be of the other class, by this much together, another panel has taken the place. Unchanged
# cells gain by noise alone: 0.2 each on average, whatever their evidence E (mean of max(0, N(−E, 2E))). The rest is for
# bands that are not known exactly yet. Cells' bands differ by a quarter of their depth besides (MODEL_VARIANCE).
OTHER_CLASS_NATS = 16.0
# To confirm a panel, the evidence for it must be so many times the evidence for other classes. If another codeword is
# there, which differs in a quarter of the cells or more (DICT_4X4_50), the two are about equal.
CONFIRMATION_RATIO = 4.0


def expected_log_likelihood_ratio(evidence: Evidence, cell_bands: Floats) -> float:
    """Mean log-likelihood ratio of `cell_bands` (cells, P) to no bands, if these bands are there; in nats."""
    return 0.5 * float((cell_bands * (evidence.score - evidence.unexplained(cell_bands))).sum())


def contradicts(added: Evidence | None, cell_bands: Floats) -> bool:
    """Tells whether added evidence is against `cell_bands` (cells, P): for no bands, or other classes in some cells."""
    if added is None:
        return False
    likelihood, of_others = _log_likelihood_ratios(added, cell_bands)
    most_of_others = OTHER_CLASS_NATS + MODEL_VARIANCE * expected_log_likelihood_ratio(added, cell_bands)
    return likelihood < -CONTRADICTION_NATS or of_others > most_of_others


def prefers_others(added: Evidence, cell_bands: Floats) -> bool:
    """Tells whether the cells that are likelier of the other class outweigh all cells together."""
    likelihood, of_others = _log_likelihood_ratios(added, cell_bands)
    return likelihood < of_others


def confirms(alone: Evidence | None, cell_bands: Floats) -> bool:
    """Tells whether one frame's evidence is clearly for `cell_bands` (cells, P), and for another class in no cells."""
    if alone is None:
        return False
    likelihood, of_others = _log_likelihood_ratios(alone, cell_bands)
    return likelihood > CONTRADICTION_NATS + CONFIRMATION_RATIO * of_others


def _log_likelihood_ratios(evidence: Evidence, cell_bands: Floats) -> tuple[float, float]:
    """Those of `cell_bands` (cells, P) to no bands; and, summed over cells, of the other class where it is likelier."""
    likelihood = 0.5 * float((cell_bands * (evidence.score + evidence.unexplained(cell_bands))).sum())
    return likelihood, float(np.maximum(class_flip_gain(evidence, cell_bands), 0.0).sum())
