"""What one picture says of the bands in a panel's cells, by comparison with the mean of those before.

In C (kernels/comparison.c): the picture's light over the mean's, less 1, is fitted by one gain, eight ways in which
corners can be off, and bands of its own in each cell, by the difference of the waves now and then. A mean of n frames
has a noise of its own: weights are n/(n + 1) of the light. The rest is as of one picture (`single_frame`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ledpi.core.records import Frame, PanelSpec, Rejected, Singles
from ledpi.decode.cells import CellSamples
from ledpi.decode.evidence.erasures import erase_unlit_cells
from ledpi.decode.evidence.evidence import Evidence, Weighed, evidence_of
from ledpi.decode.evidence.noise import lags_of
from ledpi.kernels.library import lib, pointer


@dataclass(frozen=True, slots=True, kw_only=True)
class Mean:
    """Some frames of one panel."""

    picture: Singles  # (cells, points) of mean 1, and above 0
    count: Singles  # (cells, points) how many showed it
    waves: Singles  # (P, cells, points) of what their waves were there


def compared_evidence(
    samples: CellSamples, frame: Frame, spec: PanelSpec, waves: Singles, mean: Mean
) -> tuple[float, Evidence | Rejected]:
    """What the samples' light is in the unit of the mean picture, and the evidence of how they differ from it.

    `waves` (P, cells, points) are the samples' own.
    """
    cells, parameters, lattice = len(samples.light), len(waves), samples.lattice
    score, numbers = np.empty((cells, parameters)), np.empty(4)
    information = np.empty((cells, parameters, cells, parameters))
    given = [np.ascontiguousarray(array) for array in (waves, mean.picture, mean.count, mean.waves)]
    fits = lib.ledpi_compared_evidence(
        *(lattice.cells, lattice.k, parameters, pointer(samples.light), pointer(samples.valid), *map(pointer, given)),
        *(pointer(lattice.along), samples.independence, *lags_of(samples)),
        *(pointer(score), pointer(information), pointer(numbers)),
    )
    scale, *rest = numbers.tolist()
    found = Weighed(score, information, *rest) if fits else None
    evidence = evidence_of(found, samples, frame, spec, len(waves))
    return scale, evidence if isinstance(evidence, Rejected) else erase_unlit_cells(evidence, samples)
