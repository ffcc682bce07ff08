"""What one picture says of the bands in a panel's cells, by comparison of the cells with each other.

`single_evidence` in C (kernels/single_frame.c) and, where there is no compiler, in numpy, which is the reference.
"""

from __future__ import annotations

import math
from functools import cache

import numpy as np

from ledpi.decode.cells import CellSamples
from ledpi.decode.evidence.believed import Believed
from ledpi.decode.evidence.evidence import Evidence, evidence_of, picture_slopes
from ledpi.decode.evidence.noise import lags_of
from ledpi.decode.evidence.normal import Normal, weighed, with_differences
from ledpi.decode.evidence.shared_light import (
    Sources,
    border_points,
    meeting_cells,
    shared_blinking_light,
    shared_light,
    sources_of,
)
from ledpi.decode.evidence.uncovered import darkens, without_covered
from ledpi.decode.evidence.unlit import without_unlit
from ledpi.decode.evidence.waves import band_prior, class_waves, is_deep_anywhere
from ledpi.kernels import evidence as kernel
from ledpi.kernels.library import compiled
from ledpi.records import Frame, Integers, PanelSpec, Rejected, Singles


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
    sources = sources_of(samples.lattice.k, border_points(samples))
    if believed is not None:
        waves = believed.waves
    elif waves is None:
        waves = class_waves(samples, frame, spec)
    how = _compiled_evidence if compiled() else _numpy_evidence
    evidence = evidence_of(how(samples, waves, believed, sources), samples, frame, spec, 1 + len(waves))
    if isinstance(evidence, Rejected):
        return evidence
    evidence = evidence.by(evidence.noise)
    if believed is not None:  # what says how far the bands differ from what is believed, as what says how they are
        believed_score = np.einsum("cidj,dj->ci", evidence.information, believed.bands)
        evidence = evidence._replace(score=evidence.score + believed_score)
    if not is_deep_anywhere(prior):
        return without_unlit(evidence, samples)
    return evidence if believed is None else without_unlit(evidence, samples, believed.own_light())


def _numpy_evidence(
    samples: CellSamples, waves: Singles, believed: Believed | None, sources: Sources
) -> kernel.Weighed | None:
    shown = None if believed is None else believed.own_light()
    gain, profile, light = _levels(samples, shown)
    # Shot noise has the variance of the light: over this root it is alike everywhere.
    even = np.sqrt(gain[:, None] * np.maximum(profile, np.float32(1e-3)))
    if believed is None or shown is None:
        root = even
        basis = shared_light(gain, samples.lattice.cells).take(sources.column, axis=1)  # (cells, P)
    else:
        root = even * np.sqrt(shown)
        basis = shared_blinking_light(gain, believed.white, believed.light, samples.lattice.cells, sources, root)
    seen = light / root
    parts = basis * (basis * seen.take(sources.point, axis=1)).sum(axis=0)
    static = np.asarray(np.add.reduceat(parts, sources.first, axis=1), np.float32)
    residual = np.asarray(seen - static, np.float32)
    np.maximum(static, np.float32(0.02), out=static)
    cells, points = samples.light.shape
    shapes = np.empty((cells, 1 + len(waves), points), np.float32)  # of a wrong gain, and of the bands
    shapes[:, 0] = static
    if shown is not None:
        static /= shown
    np.multiply(waves.transpose(1, 0, 2), static[:, None], out=shapes[:, 1:])
    slopes = picture_slopes(static * root, samples.lattice) * shapes[:, 0]
    if samples.valid is not None:
        residual *= samples.valid
        slopes *= samples.valid
        shapes *= samples.valid[:, None]
    fit = weighed(_without_shared_light(residual, shapes, slopes, basis, sources), samples.independence)
    if fit is None:
        return None
    found, nuisances, bands = fit
    of_cells = np.concatenate([nuisances[:cells, None], bands.reshape(cells, -1)], axis=1)
    left = residual - np.einsum("ci,cip->cp", of_cells, shapes) - np.einsum("f,fcp->cp", nuisances[cells:], slopes)
    left -= np.add.reduceat(basis * (basis * left.take(sources.point, axis=1)).sum(axis=0), sources.first, axis=1)
    return with_differences(found, left, samples)


def _compiled_evidence(
    samples: CellSamples, waves: Singles, believed: Believed | None, sources: Sources
) -> kernel.Weighed | None:
    """`_numpy_evidence`, in C."""
    return kernel.single_evidence(
        light=samples.light,
        valid=samples.valid,
        waves=waves,
        along=samples.lattice.along,
        column=sources.column,
        first=sources.first,
        met=meeting_cells(samples.lattice.cells),
        shown=None if believed is None else believed.own_light(),
        of_class=None if believed is None else believed.light,
        white=None if believed is None else believed.white,
        independence=samples.independence,
        lags=lags_of(samples),
    )


def _levels(samples: CellSamples, shown: Singles | None) -> tuple[Singles, Singles, Singles]:
    """Gain (cells,), of mean 1, profile (points,), and the light in the same unit, filled in where it is not valid."""
    light, valid = samples.light, samples.valid
    if shown is None and valid is None:
        gain = light.mean(axis=1)
        mean = gain.mean()
        return gain / mean, (light / gain[:, None]).mean(axis=0), light / mean
    share = np.ones_like(light) if shown is None else shown
    if valid is not None:
        share = share * valid
    gain = light.sum(axis=1) / share.sum(axis=1)
    for _ in range(3):  # what is missing or dark in one cell is not in another: neither is known without the other
        profile = light.sum(axis=0) / np.maximum((gain[:, None] * share).sum(axis=0), 1e-9)
        gain = light.sum(axis=1) / np.maximum((profile * share).sum(axis=1), 1e-9)
    if valid is not None:
        profile[~valid.any(axis=0)] = profile.max()
        light = np.where(valid, light, gain[:, None] * profile * (1.0 if shown is None else shown))
    mean = gain.mean()
    return gain / mean, profile, light / mean


def _without_shared_light(
    residual: Singles, shapes: Singles, slopes: Singles, basis: Singles, sources: Sources
) -> Normal:
    """The normal equations, once what the cells share at each point is projected out (of `residual` it has been)."""
    cells, each, _ = shapes.shape
    size = cells * each
    shared = np.empty((size + len(slopes), len(sources.point)), np.float32)
    np.multiply(shapes.take(sources.point, axis=2), basis[:, None], out=shared[:size].reshape(cells, each, -1))
    shared[size:] = np.einsum("fcp,cp->fp", slopes.take(sources.point, axis=2), basis)
    matrix = -(shared @ shared.T)
    blocks = matrix[:size, :size].reshape(cells, each, cells, each)
    own = np.arange(cells)
    blocks[own, :, own, :] += np.matmul(shapes, shapes.transpose(0, 2, 1))
    with_slopes = np.matmul(shapes, slopes.transpose(1, 2, 0)).reshape(size, -1)
    matrix[:size, size:] += with_slopes
    matrix[size:, :size] += with_slopes.T
    flat = slopes.reshape(len(slopes), -1)
    matrix[size:, size:] += flat @ flat.T
    right = np.concatenate([np.matmul(shapes, residual[..., None]).reshape(size), flat @ residual.reshape(-1)])
    nuisance, band = _split(cells, each, len(slopes))
    return Normal(
        of_nuisances=matrix[np.ix_(nuisance, nuisance)].astype(np.float64),
        of_both=matrix[np.ix_(band, nuisance)].T.astype(np.float64),
        of_bands=matrix[np.ix_(band, band)].astype(np.float64),
        nuisances=right[nuisance].astype(np.float64),
        bands=right[band].astype(np.float64),
        squares=float((residual * residual).sum()),
        freedom=int((shapes[:, 0] > 0).sum()) - len(sources.point) - len(nuisance) + 1 - len(band),
    )


@cache
def _split(cells: int, each: int, slopes: int) -> tuple[Integers, Integers]:
    """Where in the normal equations nuisances are, and where bands."""
    gains = each * np.arange(cells)
    bands = np.setdiff1d(np.arange(cells * each), gains)
    return np.concatenate([gains, cells * each + np.arange(slopes)]), bands
