"""Whether a frame denies what the frames of a track before it have shown."""

from __future__ import annotations

import numpy as np

from ledpi.decode.evidence.evidence import Evidence
from ledpi.decode.identify.words import gain_by_other_class
from ledpi.records import Floats

# A frame that is e^DOUBT times likelier without a panel's bands than with them does not show the panel. One that does
# show it looks so in less than 1 of 1,000, however much or little a frame can tell: with E = bands·information·bands/2,
# the log-likelihood ratio is normal with mean E and variance 2E, so (E + DOUBT)/√(2E) is at least √(2·DOUBT) = 3.2.
DOUBT = 5.0
# Where cells would rather be of the other class, by this much together, another panel has taken the place. Cells that
# are what they were gain by noise alone: 0.2 each on average, whatever their evidence E (mean of max(0, N(−E, 2E))).
# The rest is for bands that are not known exactly yet.
OTHER_CELLS = 16.0


def tells_of(evidence: Evidence, shown: Floats) -> float:
    """By how many nats, on average, evidence is for bands `shown` (cells, P) over none where these are shown."""
    return 0.5 * float((shown * (evidence.score - evidence.unexplained(shown))).sum())


def denies(added: Evidence | None, shown: Floats) -> bool:
    """Whether a frame has added evidence against bands `shown` (cells, P): for none, or for those of other cells."""
    if added is None:
        return False
    likelihood = 0.5 * float((shown * (added.score + added.unexplained(shown))).sum())  # over that of no bands
    of_others = float(np.maximum(gain_by_other_class(added, shown), 0.0).sum())
    return likelihood < -DOUBT or of_others > OTHER_CELLS
