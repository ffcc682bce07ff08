"""What one picture says of the bands in a panel's cells, by comparison of the cells with each other.

In C (kernels/single_frame.c). With d the light over the root of what each sample is expected to have, as shot noise has
the variance of the light, d is fitted by what cells share at each point (`shared_light`), a gain g of each cell, eight
ways s in which corners can be off, and bands x of its own in each cell: all linear. What they share is projected out;
of the normal equations of the rest, with blocks A for (g, s), B for x, and C between them,

    information = (B − CᵀA⁻¹C) / σ²,    score = (b − CᵀA⁻¹a) / σ²

are what is left for the bands, a and b being the right sides, and σ² the mean square of what no such fit explains.
"""

from __future__ import annotations

import math

import numpy as np

from ledpi.core.records import Frame, PanelSpec, Rejected, Singles
from ledpi.decode.cells import CellSamples
from ledpi.decode.evidence.band_estimate import Believed
from ledpi.decode.evidence.evidence import Evidence, evidence_of
from ledpi.decode.evidence.noise import lags_of
from ledpi.decode.evidence.shared_light import border_points, meeting_cells, sources_of
from ledpi.decode.evidence.occlusion import darkens, without_covered
from ledpi.decode.evidence.erasures import without_unlit
from ledpi.decode.evidence.waves import band_prior, class_waves, is_deep_anywhere
from ledpi.kernels.evidence import Weighed
from ledpi.kernels.library import at, lib


def single_evidence(
    samples: CellSamples,
    frame: Frame,
    spec: PanelSpec,
    waves: Singles | None = None,
    believed: Believed | None = None,
) -> Evidence | Rejected:
    """The evidence of one picture; `waves` are its bands' shapes where it is no plain frame but a mean of several.

    Where bands are deep, what cells have in common only shows once the bands are known: so with what is `believed`
    the static picture is what is left when that is divided out, and evidence is on how far the bands differ from it.
    """
    prior = band_prior(frame, spec)
    if believed is None and not darkens(math.sqrt(2.0 * float(prior.max()))):
        samples = without_covered(samples)
    if believed is not None:
        waves = believed.waves
    elif waves is None:
        waves = class_waves(samples, frame, spec)
    evidence = evidence_of(weighed(samples, waves, believed), samples, frame, spec, 1 + len(waves))
    if isinstance(evidence, Rejected):
        return evidence
    evidence = evidence.by(evidence.noise)
    if believed is not None:  # what says how far the bands differ from what is believed, as what says how they are
        believed_score = np.einsum("cidj,dj->ci", evidence.information, believed.bands)
        evidence = evidence._replace(score=evidence.score + believed_score)
    if not is_deep_anywhere(prior):
        return without_unlit(evidence, samples)
    return evidence if believed is None else without_unlit(evidence, samples, believed.own_light())


def weighed(samples: CellSamples, waves: Singles, believed: Believed | None) -> Weighed | None:
    """Evidence on these waves (P, cells, points), whatever the noise is like; None where nothing fits."""
    cells, parameters, lattice = len(samples.light), len(waves), samples.lattice
    sources = sources_of(lattice.k, border_points(samples))
    shown = (None, None, None) if believed is None else (believed.own_light(), believed.light, believed.white)
    score, numbers = np.empty((cells, parameters)), np.empty(3)
    information = np.empty((cells, parameters, cells, parameters))
    light, waves = np.ascontiguousarray(samples.light), np.ascontiguousarray(waves)
    fits = lib.ledpi_single_evidence(
        *(lattice.cells, lattice.k, parameters, at(light), at(samples.valid), at(waves)),
        *(at(lattice.along), len(sources.column), at(sources.column), at(sources.first)),
        *(at(meeting_cells(lattice.cells)), *map(at, shown), samples.independence, *lags_of(samples)),
        *(at(score), at(information), at(numbers)),
    )
    return Weighed(score, information, *numbers.tolist()) if fits else None
