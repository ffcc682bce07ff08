"""Evidence of one picture on the bands in a panel's cells, by comparison of the cells with each other.

In C (single_frame.c). With d the light over the root of what each sample is expected to have, as shot noise has
the variance of the light, d is fitted by what cells share at each point (`shared_light`), a gain g of each cell, eight
ways s in which corners can be off, and bands x of its own in each cell: all linear. What they share is projected out;
of the normal equations of the rest, with blocks A for (g, s), B for x, and C between them,

    information = (B − CᵀA⁻¹C) / σ²,    score = (b − CᵀA⁻¹a) / σ²

are what is left for the bands, a and b being the right sides, and σ² the mean square of what no such fit explains.
"""

from __future__ import annotations

import numpy as np

from ledpi.core.records import Frame, PanelSpec, Rejected
from ledpi.decode.evidence.band_estimate import BandEstimate
from ledpi.decode.evidence.cells import CellSamples
from ledpi.decode.evidence.erasures import erase_unlit_cells
from ledpi.decode.evidence.evidence import UNFIT, Evidence
from ledpi.decode.evidence.shared_light import border_points, contributing_cells, sources_of
from ledpi.decode.evidence.waves import band_prior, class_waves
from ledpi.kernels.library import lib, pointer


def single_evidence(
    samples: CellSamples, frame: Frame, spec: PanelSpec, estimate: BandEstimate | None = None
) -> Evidence | Rejected:
    """The evidence of one picture.

    Where bands are deep, what cells have in common only shows once the bands are known: so with what is `estimate`
    the static picture is what is left when that is divided out, and evidence is on how far the bands differ from it.
    """
    waves = class_waves(samples, frame, spec) if estimate is None else estimate.waves
    cells, parameters, lattice = len(samples.light), len(waves), samples.lattice
    sources = sources_of(lattice.k, border_points(samples))
    estimated = (None, None, None) if estimate is None else (estimate.band_light(), estimate.light, estimate.white)
    score, free = np.empty((cells, parameters)), np.empty(1)
    information = np.empty((cells, parameters, cells, parameters))
    light, waves = np.ascontiguousarray(samples.light), np.ascontiguousarray(waves)
    fits = lib.ledpi_single_evidence(
        *(lattice.cells, lattice.k, parameters, pointer(light), pointer(samples.valid), pointer(waves)),
        *(pointer(lattice.along), len(sources.column), pointer(sources.column), pointer(sources.first)),
        *(pointer(contributing_cells(lattice.cells)), *map(pointer, estimated)),
        *(samples.independence, pointer(score), pointer(information), pointer(free)),
    )
    if not fits:
        return UNFIT
    residual = 0.5 * samples.independence * float(free[0])
    evidence = Evidence(score=score, information=information, prior=band_prior(frame, spec), residual=residual)
    if estimate is None:
        return evidence
    # From the difference to the estimate, to the bands themselves.
    of_estimate = np.einsum("cidj,dj->ci", evidence.information, estimate.bands)
    return erase_unlit_cells(evidence._replace(score=score + of_estimate), samples, estimate.band_light())
