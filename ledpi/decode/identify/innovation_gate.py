"""Whether a frame denies, or confirms, what the frames of a track before it have shown."""

from __future__ import annotations

import numpy as np

from ledpi.core.records import Floats
from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.identify.codewords import gain_by_other_class

# A frame that is e^DOUBT times likelier without a panel's bands than with them does not show the panel. One that does
# show it looks so in less than 1 of 1,000, however much or little a frame can tell: with E = bands·information·bands/2,
# the log-likelihood ratio is normal with mean E and variance 2E, so (E + DOUBT)/√(2E) is at least √(2·DOUBT) = 3.2.
DOUBT = 5.0
# Where cells would rather be of the other class, by this much together, another panel has taken the place. Cells that
# are what they were gain by noise alone: 0.2 each on average, whatever their evidence E (mean of max(0, N(−E, 2E))).
# The rest is for bands that are not known exactly yet.
OTHER_CELLS = 16.0
# What confirms a panel says so many times as much for it as for cells of the other class. Where another word is shown
# that differs in a quarter of the cells, as DICT_4X4_50's do at least, both are alike.
CERTAIN = 4.0


def tells_of(evidence: Evidence, shown: Floats) -> float:
    """By how many nats, on average, evidence is for bands `shown` (cells, P) over none where these are shown."""
    return 0.5 * float((shown * (evidence.score - evidence.unexplained(shown))).sum())


def denies(added: Evidence | None, shown: Floats) -> bool:
    """Whether a frame has added evidence against bands `shown` (cells, P): for none, or for those of other cells."""
    if added is None:
        return False
    likelihood, of_others = _weighed(added, shown)
    return likelihood < -DOUBT or of_others > OTHER_CELLS


def confirms(alone: Evidence | None, shown: Floats) -> bool:
    """Whether what a frame says by itself is surely for bands `shown` (cells, P), and for none of other cells."""
    if alone is None:
        return False
    likelihood, of_others = _weighed(alone, shown)
    return likelihood > DOUBT + CERTAIN * of_others


def _weighed(evidence: Evidence, shown: Floats) -> tuple[float, float]:
    """Log-likelihood ratio of bands `shown` (cells, P) to none; and how much cells gain by being of the other class."""
    likelihood = 0.5 * float((shown * (evidence.score + evidence.unexplained(shown))).sum())
    return likelihood, float(np.maximum(gain_by_other_class(evidence, shown), 0.0).sum())
