"""The innovation gate: whether a frame contradicts, or confirms, the bands that its track has shown so far."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from ledpi.core.records import Floats
from ledpi.decode.evidence.evidence import RARE_Z, Evidence
from ledpi.decode.identify.codewords import class_flip_gain
from ledpi.decode.identify.model_error import MODEL_VARIANCE

# A frame that is e^5 times likelier without a panel's bands than with them does not show the panel. A frame that does
# show it is rejected less than once in 1,000 times, however much information it has: with E =
# bands·information·bands/2, the log-likelihood ratio is normal with mean E and variance 2E, so (E + 5)/√(2E) is at
# least √(2·5) = 3.2.
CONTRADICTION_NATS = 5.0
# If cells are more likely to be of the other class, by this much together, another panel has taken the place. Unchanged
# cells gain by noise alone: 0.2 each on average, whatever their evidence E (mean of max(0, N(−E, 2E))). The rest is for
# bands that are not known exactly yet. Cells' bands differ by a quarter of their depth besides (MODEL_VARIANCE).
OTHER_CLASS_NATS = 16.0
UNCHANGED_NATS = 0.2
# To confirm a panel, the evidence for it must be so many times the evidence for other classes. If another codeword is
# there, which differs in a quarter of the cells or more (DICT_4X4_50), the two are about equal.
CONFIRMATION_RATIO = 4.0


class Innovation(NamedTuple):
    """Log-likelihood ratios that a frame gives to the bands of a panel, in nats."""

    likelihood: float  # of these bands to none
    expected: float  # its mean, if these bands are there
    of_others: float  # of the other class, summed over the cells where that is likelier

    @property
    def contradicts(self) -> bool:
        """Tells whether it is against the bands: for none, or for other classes in some cells."""
        most_of_others = OTHER_CLASS_NATS + MODEL_VARIANCE * self.expected
        return self.likelihood < -CONTRADICTION_NATS or self.of_others > most_of_others

    @property
    def prefers_others(self) -> bool:
        """Tells whether the cells that are likelier of the other class outweigh all cells together."""
        return self.likelihood < self.of_others

    @property
    def confirms(self) -> bool:
        """Tells whether it is clearly for the bands, and for another class in no cells."""
        return self.likelihood > CONTRADICTION_NATS + CONFIRMATION_RATIO * self.of_others


def innovation_of(evidence: Evidence, cell_bands: Floats) -> Innovation:
    """A frame's, by its evidence alone; `cell_bands` (cells, P) are the panel's so far."""
    left = evidence.unexplained(cell_bands)
    return Innovation(
        likelihood=0.5 * float((cell_bands * (evidence.score + left)).sum()),
        expected=0.5 * float((cell_bands * (evidence.score - left)).sum()),
        of_others=float(np.maximum(class_flip_gain(evidence, cell_bands), 0.0).sum()),
    )


def contradicts(added: Evidence | None, cell_bands: Floats) -> bool:
    """Tells whether added evidence, if any, is against `cell_bands` (cells, P)."""
    return added is not None and innovation_of(added, cell_bands).contradicts


def confirms(alone: Evidence | None, cell_bands: Floats) -> bool:
    """Tells whether there is one frame's evidence, and clearly for `cell_bands` (cells, P)."""
    return alone is not None and innovation_of(alone, cell_bands).confirms


def enough_to_confirm(cells: int) -> float:
    """Log-likelihood ratio to no bands, in nats, at which all frames but one in 1,000 confirm a panel of so many cells.

    It is normal with mean E and variance 2E: the E of which E − RARE_Z·√(2E) is as much as is asked for.
    """
    asked = CONTRADICTION_NATS + CONFIRMATION_RATIO * UNCHANGED_NATS * cells
    return 0.5 * (RARE_Z + math.sqrt(RARE_Z**2 + 2.0 * asked)) ** 2
